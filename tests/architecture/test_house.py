"""Rules of the house, each a few lines: sizes of modules and functions, parameters, what a room of tasks holds."""

import ast
import functools
import re
from itertools import zip_longest
from pathlib import Path

from places import ROOT

PACKAGE = ROOT / "pipeline"
MODULES = sorted(path for path in PACKAGE.rglob("*.py"))
MOST_LINES, LONGEST = 400, 60
"""Lines of a module, lines of a function without its docstring."""
MOST_PARAMETERS, MOST_OF_A_KERNEL = 6, 8
"""Parameters of a function, and of one that Numba compiles."""
KERNELS = {"kernel", "opaque", "unit", "inline", "DeviceKernel"}


@functools.cache
def tree_of(path: Path) -> ast.Module:
    """The syntax tree of a file, parsed once however many rules ask for it."""
    return ast.parse(path.read_bytes())


@functools.cache
def functions_of(path: Path) -> list[ast.FunctionDef]:
    """Functions and methods of a module, nested ones, too."""
    return [node for node in ast.walk(tree_of(path)) if isinstance(node, ast.FunctionDef)]


def test_no_module_or_function_is_long():
    offenders = [str(path) for path in MODULES if len(path.read_text(encoding="utf-8").splitlines()) > MOST_LINES]
    for path in MODULES:
        for node in functions_of(path):
            first = node.body[0]
            docstring = first.end_lineno - first.lineno + 1 if ast.get_docstring(node, clean=False) else 0
            lines = node.end_lineno - node.lineno + 1 - docstring
            offenders += [f"{path}:{node.name}: {lines} lines"] * (lines > LONGEST)
    assert offenders == []


def test_functions_take_few_parameters():
    """But verbs, whose parameters are the options of a command line."""
    offenders = []
    for path in MODULES:
        is_of_verbs = path.parent.name == "verbs" or path.stem in ("cli", "verbs")
        for node in functions_of(path):
            arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            count = len(arguments) - (arguments[:1] != [] and arguments[0].arg in ("self", "cls"))
            is_kernel = bool({getattr(decorator, "id", "") for decorator in node.decorator_list} & KERNELS)
            most = MOST_OF_A_KERNEL if is_kernel else MOST_PARAMETERS
            is_verb = is_of_verbs and not node.name.startswith("_")
            offenders += [f"{path}:{node.name}: {count} parameters"] * (count > most and not is_verb)
    assert offenders == []


def test_modules_are_imported_by_name_in_few_places_and_no_message_is_read():
    """`import_module` hides an import from the contract; words of a message are for people."""
    known = {"__init__.py", "engine/running/execute.py", "jit/device.py"}
    known |= {"tasks/export.py"}  # the code that makes keys is no part of them
    users = {str(path.relative_to(PACKAGE)) for path in MODULES if "import_module" in path.read_text(encoding="utf-8")}
    assert users <= known
    readers = [
        str(path) for path in MODULES if re.search(r'" in \w*\.?error\.message', path.read_text(encoding="utf-8"))
    ]
    assert readers == []


def test_packages_but_the_top_one_are_empty_or_say_why():
    """The fingerprint of a task's code follows imports."""
    full = [str(path.relative_to(PACKAGE)) for path in MODULES if path.name == "__init__.py" and path.stat().st_size]
    assert full == ["__init__.py", "scene/__init__.py"]


def is_made_of_numbers(value: ast.expr) -> bool:
    """Whether an expression is made of numbers, other constants and functions of libraries, and of nothing else."""
    known = (ast.Tuple, ast.List, ast.Dict, ast.UnaryOp, ast.BinOp, ast.Call, ast.keyword, ast.Attribute, ast.Name)
    parts = [node for node in ast.walk(value) if isinstance(node, ast.expr | ast.keyword)]
    values = [node.value for node in parts if isinstance(node, ast.Constant)]
    has_name = any(isinstance(node, ast.Name) and node.id.isupper() for node in parts)
    return (
        all(isinstance(node, (*known, ast.Constant)) for node in parts)
        and all(type(number) in (int, float) for number in values)
        and bool(values or has_name)
    )


def test_numbers_have_reasons():
    """A docstring below a constant, or a comment, has its unit and why it has that value."""
    offenders = []
    for path in MODULES:
        tree, lines = tree_of(path), path.read_text(encoding="utf-8").splitlines()
        for node, below in zip_longest(tree.body, tree.body[1:]):
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value and is_made_of_numbers(node.value):
                text = below.value if isinstance(below, ast.Expr) else None
                has_comment = "  # " in lines[node.end_lineno - 1] or lines[node.lineno - 2].startswith("# ")
                if not (has_comment or (isinstance(text, ast.Constant) and isinstance(text.value, str))):
                    offenders.append(f"{path.relative_to(PACKAGE)}:{node.lineno}: {ast.unparse(node)}")
    assert offenders == []
