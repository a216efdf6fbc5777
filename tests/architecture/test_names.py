"""What travels has a name: functions take few parameters, and records are read by field, never by number."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import house

ROOT = Path(__file__).parents[2]
PHYSICS = ("camera", "optics", "render", "targets")
RECORDS = {
    *("anchor", "arrays", "artwork", "beams", "blocks", "bounds", "camera", "drawing", "fan", "hit", "labels"),
    *("mosaic", "optics", "packet", "pencils", "rays", "region", "regions", "samples", "sectors", "sheet"),
    *("spokes", "squares", "start", "starts", "surface", "ways"),
}
"""Names of NamedTuples that kernels take."""
TABLES = {"detail", "lenses", "own", "row"}
"""Names of arrays whose columns have names."""


def trees(*rooms: str) -> Iterator[tuple[str, ast.Module]]:
    """Modules of some rooms, or of all, by their path below the package."""
    package = ROOT / "pipeline"
    assert all((package / room).is_dir() for room in rooms)
    for path in sorted(package.rglob("*.py")):
        name = path.relative_to(package).as_posix()
        if not rooms or name.split("/")[0] in rooms:
            yield name, house.tree_of(path)


def is_verb(module: house.Module, function: house.Function) -> bool:
    """Whether the parameters of a function are the options of a command line."""
    return (module.path.parent.name == "verbs" or module.path.stem == "cli") and not function.name.startswith("_")


def test_functions_take_few_parameters() -> None:
    """Counted as the sheet of the house counts them."""
    too_many = [
        f"{module.path.stem}.{function.name}"
        for module in house.modules()
        for function in module.functions
        if function.takes_too_many and not is_verb(module, function)
    ]
    assert too_many == []


def is_number(node: ast.expr) -> bool:
    node = node.operand if isinstance(node, ast.UnaryOp) else node
    return isinstance(node, ast.Constant) and isinstance(node.value, int)


def read_by_number(node: ast.AST) -> bool:
    """Whether a record is subscripted with a number, or the column of a table is one."""
    if not isinstance(node, ast.Subscript):
        return False
    place, name = node.slice, node.value.attr if isinstance(node.value, ast.Attribute) else ""
    name = node.value.id if isinstance(node.value, ast.Name) else name
    column = place.elts[-1] if isinstance(place, ast.Tuple) else place
    return (name in RECORDS and is_number(place)) or (name in TABLES and is_number(column))


def test_no_record_is_read_by_number() -> None:
    found = [
        f"{name}:{node.lineno}: {ast.unparse(node)}"
        for name, tree in trees(*PHYSICS)
        for node in ast.walk(tree)
        if read_by_number(node)
    ]
    assert found == []


def test_a_row_of_a_microlens_is_not_called_a_lens() -> None:
    """As the table of words in CONVENTIONS.md has it: a lens is the main lens."""
    found = []
    for name, tree in trees("camera", "render", "truth"):
        for node in ast.walk(tree):
            named = node.arg if isinstance(node, ast.arg) else ""
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                named = node.target.id
            if named == "lens" and re.search(r"\b(ndarray|int)\b", ast.unparse(node.annotation or ast.Constant(""))):
                found.append(f"{name}:{node.lineno}")
    assert found == []


FORBIDDEN = {"lenslet", "pitch", "apex", "iris", "interface", "proxies", "board_corner"}
"""Names that the table Words of CONVENTIONS.md lists under "not"."""
MAIN_LENS = {"FirstOrder", "Prescription"}


def test_parameters_keep_the_words_of_the_conventions() -> None:
    """In the physics `lens` is the main lens; the row of a microlens is `microlens`."""
    found = [
        f"{name}:{node.name}: {argument.arg}"
        for name, tree in trees("camera", "optics", "render", "targets", "truth")
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        for argument in (*node.args.args, *node.args.kwonlyargs)
        if argument.arg in FORBIDDEN
        or (argument.arg == "lens" and name.split("/")[0] in ("camera", "truth") and not is_main_lens(argument))
    ]
    assert found == []


def test_functions_and_records_keep_the_words_of_the_conventions() -> None:
    """A function or a record of the physics has no forbidden word in its name, in whatever case."""
    found = [
        f"{name}: {node.name}"
        for name, tree in trees("camera", "optics", "render", "targets", "truth")
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        and any(word in node.name.lower() for word in FORBIDDEN - {"pitch", "interface"})
    ]
    assert found == []


def is_main_lens(argument: ast.arg) -> bool:
    return argument.annotation is not None and ast.unparse(argument.annotation) in MAIN_LENS


def test_no_test_imports_another_one() -> None:
    """Helpers stand in modules of helpers."""
    tests = [
        path for path in sorted((ROOT / "tests").rglob("*.py")) if re.search(rb"from \S*\btest_", path.read_bytes())
    ]
    nodes = [(path, node) for path in tests for node in ast.walk(ast.parse(path.read_bytes()))]
    froms = [(path, node.module) for path, node in nodes if isinstance(node, ast.ImportFrom) and node.module]
    assert [(path.name, module) for path, module in froms if module.split(".")[-1].startswith("test_")] == []
