"""Numbers of the house: modules, lines and functions of every room. `--write` puts them into CONTRIBUTING.md.

python docs/house.py [--write]
"""

import ast
import functools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from inserted import print_or_write

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "CONTRIBUTING.md"
LONG_FUNCTION = 40
"""Lines of a function, docstring and signature counted, beyond which the sheet counts it."""
MOST_PARAMETERS, MOST_OF_A_KERNEL = 6, 8
"""Parameters of a function, and of one that Numba compiles; a test allows no more."""
KERNELS = ("kernel", "unit", "inline", "buffers", "DeviceKernel")
HEAD = (
    *("room", "modules", "lines", "median", "largest", f"functions > {LONG_FUNCTION} lines"),
    *(f"> {MOST_PARAMETERS} parameters", f"kernels > {MOST_OF_A_KERNEL}", "docstrings"),
)


@dataclass(frozen=True, slots=True)
class Function:
    """A function: its name, its lines, its parameters without `self`, and whether Numba compiles it."""

    name: str
    lines: int
    parameters: int
    is_kernel: bool

    @property
    def takes_too_many(self) -> bool:
        """Whether a record should take the place of some of its parameters."""
        return self.parameters > (MOST_OF_A_KERNEL if self.is_kernel else MOST_PARAMETERS)


@dataclass(frozen=True, slots=True)
class Module:
    """A module: its path below the package, lines in all and of docstrings, and its functions."""

    path: Path
    lines: int
    docstring_lines: int
    functions: tuple[Function, ...]

    @property
    def room(self) -> str:
        """The folder that it stands in."""
        return "/".join(self.path.parts[:-1]) or "."


def modules() -> list[Module]:
    """All modules of the package that hold something."""
    package = ROOT / "pipeline"
    paths = sorted(path for path in package.rglob("*.py") if path.stat().st_size)
    return [_module(path, path.relative_to(package)) for path in paths]


@functools.cache
def tree_of(path: Path) -> ast.Module:
    """The syntax tree of a file, parsed once however many rules ask for it."""
    return ast.parse(path.read_bytes())


def functions_of(tree: ast.AST) -> Iterator[Function]:
    """Functions and methods of a syntax tree, nested ones, too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            asked = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            count = len(asked) - sum(one.arg in ("self", "cls") for one in asked[:1])
            decorators = {getattr(one, "id", "") for one in node.decorator_list}
            lines = (node.end_lineno or node.lineno) - node.lineno + 1
            yield Function(node.name, lines, count, bool(decorators & set(KERNELS)))


def sheet() -> str:
    """The table, one row per room and one for all."""
    found = modules()
    rooms = sorted({module.room for module in found})
    rows = [_row(room, [module for module in found if module.room == room]) for room in rooms]
    lines = [HEAD, ("---",) * len(HEAD), *rows, _row("all", found)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _module(path: Path, name: Path) -> Module:
    text = path.read_text(encoding="utf-8")
    tree = tree_of(path)
    return Module(name, len(text.splitlines()), sum(_docstring_lines(tree)), tuple(functions_of(tree)))


def _docstring_lines(tree: ast.AST) -> Iterator[int]:
    for node in ast.walk(tree):
        for one in getattr(node, "body", []) if isinstance(getattr(node, "body", None), list) else []:
            if isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant) and isinstance(one.value.value, str):
                yield (one.end_lineno or one.lineno) - one.lineno + 1


def _row(room: str, found: list[Module]) -> tuple[str, ...]:
    functions = [function for module in found for function in module.functions]
    sizes = [module.lines for module in found]
    largest = max(found, key=lambda module: module.lines)
    numbers = (
        sum(function.lines > LONG_FUNCTION for function in functions),
        sum(function.takes_too_many and not function.is_kernel for function in functions),
        sum(function.takes_too_many and function.is_kernel for function in functions),
    )
    share = sum(module.docstring_lines for module in found) / sum(sizes)
    name = room if room == "all" else f"`{room}`"
    shown = (str(len(found)), f"{sum(sizes):,}", f"{median(sizes):.0f}", f"{largest.lines} ({largest.path.stem})")
    return (name, *shown, *map(str, numbers), f"{share:.0%}")


if __name__ == "__main__":
    print_or_write(__doc__ or "", sheet, PAGE, "docs/house.py")
