"""Small mistakes that a programmer could make in a module: every one that this catalogue knows, one at a time.

A mistake replaces the text of one expression or statement; nothing else of the file changes.
"""

import ast
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

_OPERATORS = {
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
    ast.FloorDiv: (ast.Div,),
    ast.Mod: (ast.Mult,),
}
_COMPARISONS = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.GtE),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_NAMES = {"sin": "cos", "min": "max", "minimum": "maximum", "fmin": "fmax", "floor": "ceil", "any": "all"}
_NAMES |= {other: name for name, other in _NAMES.items()}
"""Functions that are always at hand; of other names only those that a module uses are taken for one another."""
_AXES = {"x": "y", "y": "x", "near": "far", "far": "near", "width": "height", "height": "width", "row": "column"}
_AXES |= {"k": "l", "l": "k", "column": "row", "columns": "rows", "rows": "columns"}
_SCALE = 1.05
JITTED = ("kernel", "unit", "inline", "buffers")
"""Decorators of `pipeline.jit.decorators`."""
_SILENT = (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom)
"""What no sentence about light depends on: messages, and checks that only a programmer meets."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """One mistake in one file.

    Attributes
    ----------
    original : str
        The file without it.
    begin, end : int
        Which bytes it replaces.
    text : str
        By what.
    in_kernel : bool
        Whether it changes what Numba compiles: it stands in a kernel, or outside of all functions and classes.
    """

    original: str
    begin: int
    end: int
    text: str
    in_kernel: bool

    @property
    def source(self) -> str:
        """The whole file with the mistake."""
        whole = self.original.encode()
        return (whole[: self.begin] + self.text.encode() + whole[self.end :]).decode()

    @property
    def place(self) -> tuple[int, str, str]:
        """The first line that differs, counted from 1, and its text without and with the mistake, stripped."""
        pairs = zip(self.original.splitlines(), self.source.splitlines(), strict=False)
        return next((line, a.strip(), b.strip()) for line, (a, b) in enumerate(pairs, start=1) if a != b)


def mutants(source: str) -> list[Mutant]:
    """All mistakes that can be made in a module, in the order of its text; a few are nonsense, see `parses`."""
    tree, known = ast.parse(source), set(re.findall(r"\w+", source))
    whole, starts = source.encode(), [0]  # columns of a node count bytes
    for line in source.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = []
    for node, function in _walk(tree, None):
        for text in sorted(set(_mistakes(node, known))):
            begin = starts[node.lineno - 1] + node.col_offset
            end = starts[node.end_lineno - 1] + node.end_col_offset
            if whole[begin:end].decode() != text:
                found.append(Mutant(source, begin, end, text, _compiled(function)))
    return found


def _walk(node: ast.AST, function: ast.AST | None) -> Iterator[tuple[ast.AST, ast.AST | None]]:
    """Expressions and statements with the outermost function or class around them; no types, decorators, docstrings."""
    for name, value in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list", "type_params", "bases", "keywords"} and not (
            name == "keywords" and isinstance(node, ast.Call)
        ):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, _SILENT) or _is_text(child):
                continue
            inside = child if function is None and isinstance(child, ast.FunctionDef | ast.ClassDef) else function
            yield child, inside
            yield from _walk(child, inside)


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)


def _compiled(function: ast.AST | None) -> bool:
    if function is None:
        return True
    marks = function.decorator_list if isinstance(function, ast.FunctionDef) else []
    return any(isinstance(mark, ast.Name) and mark.id in JITTED for mark in marks)


def _mistakes(node: ast.AST, known: set[str]) -> Iterator[str]:
    """Texts that may stand in place of a node, in a module that knows some names."""
    match node:
        case ast.BinOp(left, operator, right):
            for other in _OPERATORS.get(type(operator), ()):
                yield _text(ast.BinOp(left, other(), right))
            if isinstance(operator, ast.Add | ast.Sub):
                yield _text(left)
            if isinstance(operator, ast.MatMult):
                yield _text(ast.BinOp(right, operator, left))
        case ast.UnaryOp(ast.USub() | ast.Not() | ast.Invert(), operand):
            yield _text(operand)
        case ast.Compare(left, [operator], [right]):
            for other in _COMPARISONS[type(operator)]:
                yield _text(ast.Compare(left, [other()], [right]))
        case ast.BoolOp(operator, values):
            yield _text(ast.BoolOp(ast.Or() if isinstance(operator, ast.And) else ast.And(), values))
        case ast.Constant(bool() as value):
            yield str(not value)
        case ast.Constant(int() as value):
            yield str(1 - value if value in (0, 1) else value + 1)
        case ast.Constant(float() as value):
            yield f"{value * _SCALE:.9g}" if value else "1.0"
        case ast.Attribute(value, "T"):
            yield _text(value)
        case ast.Attribute(value, name):
            yield from (_text(ast.Attribute(value, other)) for other in _confused(name, known))
        case ast.Name(name, ast.Load()):
            yield from _confused(name, known)
        case ast.AugAssign(target, ast.Add() | ast.Sub() as operator, value):
            other = ast.Sub() if isinstance(operator, ast.Add) else ast.Add()
            yield _text(ast.AugAssign(target, other, value))
        case ast.IfExp(test, body, other):
            yield _text(ast.IfExp(test, other, body))


def _confused(name: str, known: set[str]) -> list[str]:
    """Names that are easily taken for another: x_px for y_px, near for far, sin for cos."""
    if name in _NAMES:
        return [_NAMES[name]]
    parts = name.split("_")
    others = ["_".join([*parts[:i], _AXES[part], *parts[i + 1 :]]) for i, part in enumerate(parts) if part in _AXES]
    return [other for other in others if other in known]


def _text(node: ast.AST) -> str:
    text = ast.unparse(ast.fix_missing_locations(node))
    return text if isinstance(node, ast.stmt | ast.Name | ast.Constant | ast.Attribute) else f"({text})"


def parses(mutant: Mutant) -> bool:
    """Whether Python takes a mistake for a program, without a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", SyntaxWarning)
        try:
            compile(mutant.source, "mutant", "exec")
        except SyntaxError:
            return False
    return True
