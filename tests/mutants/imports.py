"""Which modules of the package and of the tests import which."""

import ast
from pathlib import Path


def module_of(file: str) -> str:
    """Dotted name of a file of the package or of the tests, as they import one another."""
    return ".".join(Path(file.removeprefix("tests/")).with_suffix("").parts)


class Imports:
    """Which modules of the package and of the tests import which."""

    def __init__(self, tree: Path) -> None:
        files = [*(tree / "pipeline").rglob("*.py"), *(tree / "tests").rglob("*.py")]
        self.of = {module_of(str(file.relative_to(tree))): _imported(file) for file in files}

    def distances(self, module: str) -> dict[str, int]:
        """Modules that a module reaches, and through how many imports."""
        found, newest = {module: 0}, {module}
        while newest:
            newest = {name for name, imported in self.of.items() if imported & newest} - found.keys()
            found |= dict.fromkeys(newest, max(found.values()) + 1)
        return found


def _imported(file: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names
