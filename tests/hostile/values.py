"""Every attribute of the schemas, and of USD what is used of it, with every hostile value of its type."""

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from hostile.pictures import PICTURES
from hostile.scenes import SCENES, inputs_of, metadata, path_of, put, xform_ops
from pxr import Sdf, Usd, Vt

from pipeline import formats
from pipeline.scene.usd.values import range_of

FLOATS = (0.0, -0.0, 5e-324, 1e-30, -1.0, -1e-9, 1e9, 1e155, -1e155, 1.7e308, math.inf, -math.inf, math.nan)
INTS = (0, -1, 1, 7, 65536, 2**31 - 1, -(2**31))
LONG = "n" * 100_000
TEXTS = ("", "bogus", LONG, "a\x1b[31m\x07\r\nb", "\u202eabc", "Ünïcode", "../../x", "%s{}")
FILES = ("", "./nowhere.png", "./dataset.usda", "/dev/zero", *(f"./{name}" for name in PICTURES))
LENGTHS = (0, 1, 2, 1_000, 100_000)
WITHOUT_VALUES = ("opaque", "pathExpression")
"""Types whose values Python has no type for."""
BACK = "/Scene/Back.custom:rel"
"""A relationship that points at whatever points at it."""
LINKS: tuple[list[str], ...] = (
    [],
    ["/Nowhere"],
    ["/Scene"],
    ["/Scene/Board", "/Scene/Board"],
    ["/Scene/Camera", "/Scene/Board", "/Scene/Screen"],
    ["/Scene/Board.plen:white"],
    [f"/Scene/N{number}" for number in range(1000)],
    [BACK],
)
"""Beside these, every relationship is pointed at its own prim and at itself."""
ORDERS = (
    [],
    ["xformOp:translate"] * 2,
    ["!invert!xformOp:translate"],
    ["!resetXformStack!", "xformOp:translate"],
    ["bogus"],
    [LONG],
    ["a"] * 1000,
)
SPLINES = (
    "{ 1: %s; post linear, 2: -1 }",
    "{ 1: 1e308; post linear, 2: -1e308 }",
    "{ bezier, 1: %s; post curve (0.5, 1e9), 2: %s }",
    "{ bezier, pre: linear, post: linear, 1: %s; post curve (1, 0), 1.0000001: 9; pre (1, 0); post linear }",
    "{ post: loop repeat, 1: %s; post linear, 1.000001: 1; post linear }",
    "{ 0: %s; post none, 5: 1 }",
    "{ 1: %s & 1e9; post held }",
    "{}",
)
"""Splines of a scalar, with its usual value in place of %s."""
ARRAYS = ("edit [minsize 100000]", "edit [write 1 to [999]]", "edit [erase [0]]", "AnimationBlock")
"""Values of an array that change that of a weaker file, where there is one."""
METADATA = ('allowedTokens = ["x"]', 'colorSpace = "\\x1b[31m"')
"""Metadata of a property."""
RATES = ("nan", "inf", "0", "-1", "1e-320", "1e308")
"""Numbers of a stage that stands above another one."""
WRITTEN = {
    str: lambda: [_quoted(text) for text in TEXTS],
    float: lambda: [*(repr(number) for number in FLOATS), "2000000000", "1.5", '"text"', "None"],
    bool: lambda: ["0", "7", '"text"', "None"],
    Sdf.AssetPath: lambda: ["@@", "@./nowhere.ocio@", "@/dev/zero@", '"text"'],
    list: lambda: ["[]", "[@@]", "[@./nowhere.usda@]", "[@./dataset.usda@]", '"text"'],
    dict: lambda: ["{}", '{ string a = "b" }', "{ string a = 1 }", '"text"', "None"],
}
"""Metadata of a stage as usda has it, by the type of a usual value."""


@dataclass(frozen=True)
class Attempt:
    """One property of one scene with one hostile value."""

    scene: str
    at: str
    name: str
    type_name: str
    value: Any

    def text(self) -> str:
        stage = SCENES[self.scene].stage()
        if self.type_name == "above":
            lines = f'defaultPrim = "Scene"\n{self.name} = {self.value}\nsubLayers = [@./whole.usda@]'
            return f"#usda 1.0\n(\n{lines}\n)\n"
        if self.type_name == "line":
            return _with_line(stage, path_of(stage, self.at), self.name, self.value)
        if self.type_name == "metadata":
            return _with_metadata(stage, self.name, self.value)
        self.put(stage)
        return stage.GetRootLayer().ExportToString()

    def put(self, stage: Usd.Stage) -> None:
        """Author this value alone."""
        prim = path_of(stage, self.at)
        if self.type_name == "rel":
            put(stage, self.at, self.name, [Sdf.Path(path) for path in self.value])
            if BACK in self.value:
                back = stage.DefinePrim(Sdf.Path(BACK).GetPrimPath()).CreateRelationship("custom:rel")
                back.SetTargets([prim.GetPath().AppendProperty(self.name)])
        else:
            attribute = prim.GetAttribute(self.name)
            if not attribute or self.type_name == "wrong":
                kind = Sdf.ValueTypeNames.String if self.type_name == "wrong" else _type(self.type_name)
                spec = stage.GetRootLayer().GetPrimAtPath(prim.GetPath())
                if self.name in spec.properties:
                    del spec.properties[self.name]
                Sdf.AttributeSpec(spec, self.name, kind).default = self.value
            else:
                attribute.Set(self.value)
            if self.name.startswith("xformOp:"):
                prim.GetAttribute("xformOpOrder").Set(["xformOp:translate", *{self.name} - {"xformOp:translate"}])

    def __str__(self) -> str:
        shown = repr(self.value)
        return f"{self.scene}: {self.at}.{self.name} = {shown if len(shown) < 60 else shown[:60] + '…'}"


@functools.cache
def attempts() -> tuple[Attempt, ...]:
    """All of them, in the same order at every run."""
    found = [one for name in SCENES for one in _of_scene(name)]
    for at in ("Board", "Camera", "Screen"):
        operations = xform_ops(every=at == "Board")
        found += [Attempt("conventional", at, name, kind, v) for name, kind in operations.items() for v in values(kind)]
        found += [Attempt("conventional", at, "xformOpOrder", "token[]", order) for order in ORDERS]
        found += [
            Attempt(scene, at, name, "line", line)
            for scene in ("conventional", "shutter")[: 1 + (at != "Screen")]
            for name, kind in operations.items()
            for line in _lines(kind, name)
        ]
    keys = ("metersPerUnit", "timeCodesPerSecond", "framesPerSecond", "startTimeCode", "endTimeCode")
    found += [Attempt(scene, "", key, "above", rate) for scene in ("shutter", "lit") for key in keys for rate in RATES]
    for key, usual in metadata().items():
        kind = next((kind for kind in WRITTEN if isinstance(usual, kind)), float)
        found += [Attempt("conventional", "", key, "metadata", text) for text in WRITTEN[kind]()]
    return tuple(found)


def _of_scene(scene: str) -> Iterator[Attempt]:
    stage = SCENES[scene].stage()
    for at, name in SCENES[scene].tried():
        prim = path_of(stage, at)
        definition = prim.GetPrimDefinition()
        shader = inputs_of(prim).get(name.removeprefix("inputs:"))
        attribute = definition.GetAttributeDefinition(name) or (not shader and prim.GetAttribute(name))
        if not (attribute or shader):
            links = [*LINKS, [str(prim.GetPath())], [f"{prim.GetPath()}.{name}"]]
            yield from (Attempt(scene, at, name, "rel", link) for link in links)
            continue
        kind = str(shader.GetTypeAsSdfType().GetSdfType() if shader else attribute.GetTypeName())
        if kind in WITHOUT_VALUES:
            continue
        doc = definition.GetPropertyMetadata(name, "documentation") or ""
        tokens = definition.GetPropertyMetadata(name, "allowedTokens") or ()
        tokens = formats.names() if name == "plen:exports" else tokens
        tokens = [token for token, _ in shader.GetOptions()] if shader else tokens
        usual = prim.GetAttribute(name).Get(1) if prim.GetAttribute(name) else None
        for value in [*values(kind, doc, usual), *_tokens(kind, tokens)]:
            yield Attempt(scene, at, name, kind, value)
        yield Attempt(scene, at, name, "wrong", "a text")
        yield from (Attempt(scene, at, name, "line", line) for line in _lines(kind, name))


def values(kind: str, doc: str = "", usual: Any = None) -> list[Any]:
    """Hostile values of a type: of numbers also the ends of their range, of arrays many lengths."""
    scalar, is_array = kind.removesuffix("[]"), kind.endswith("[]")
    ends = _ends(doc, scalar)
    items = [_item(scalar, number) for number in [*_numbers(scalar), *ends]]
    if not is_array:
        return items
    good = usual[0] if usual else items[-1] if ends else _item(scalar, 1)
    if scalar in ("token", "string"):
        lists: list[list[Any]] = [[f"n{i}" for i in range(length)] for length in LENGTHS]
        return [*lists, ["same"] * 3, *([text] for text in TEXTS)]
    lists = [[good] * length for length in LENGTHS]
    lists += [[*list(usual)[1:], item] if usual else [item] for item in items]
    return [_type(kind).type.pythonClass(found) for found in lists]


def _lines(kind: str, name: str) -> Iterator[str]:
    """Statements about a property beside a plain value."""
    if kind in ("double", "float", "half"):
        yield from (f"{kind} {name}.spline = {spline.replace('%s', '2.5')}" for spline in SPLINES)
    yield from (f"{kind} {name} = {edit}" for edit in (ARRAYS if kind.endswith("[]") else ARRAYS[-1:]))
    yield from (f"{kind} {name} (\n{entry}\n)" for entry in METADATA)


def _with_line(stage: Usd.Stage, prim: Usd.Prim, name: str, line: str) -> str:
    """The stage with a property as text: there is no other way to write some."""
    spec = stage.GetRootLayer().GetPrimAtPath(prim.GetPath())
    if name in spec.properties:
        del spec.properties[name]
    Sdf.AttributeSpec(spec, "marker", Sdf.ValueTypeNames.Bool)
    if name.startswith("xformOp:"):
        prim.GetAttribute("xformOpOrder").Set(["xformOp:translate", *{name} - {"xformOp:translate"}])
    return stage.GetRootLayer().ExportToString().replace("bool marker", line)


def _numbers(scalar: str) -> tuple[Any, ...]:
    if scalar in ("token", "string"):
        return TEXTS
    if scalar == "asset":
        return FILES
    return (False, True) if scalar == "bool" else INTS if scalar.startswith("int") else FLOATS


def _ends(doc: str, scalar: str) -> list[float]:
    """Both ends of a documented range, the numbers next to zero that it allows, and those just inside open ends."""
    span = range_of(doc)
    if span is None:
        return []
    low = math.nextafter(span.low, math.inf) if span.low_open else span.low
    high = math.nextafter(span.high, -math.inf) if span.high_open else span.high
    found = [low, high, *([span.gap, -span.gap] if span.gap else [])]
    return [int(number) for number in found] if scalar.startswith("int") else found


def _item(scalar: str, number: Any) -> Any:
    """A value whose every number is the one given."""
    if scalar in ("token", "string", "bool", "int", "int64", "double", "float", "half"):
        return number
    if scalar == "asset":
        return Sdf.AssetPath(number)
    kind = _type(scalar).type.pythonClass
    if scalar.startswith("quat"):
        return kind(number, number, number, number)
    if scalar == "matrix4d":
        return kind(*[number] * 16)
    return kind(*[number] * int(next(letter for letter in scalar if letter in "234")))


def _tokens(kind: str, tokens: Any) -> list[Any]:
    if not kind.endswith("[]"):
        return list(tokens)
    return [Vt.TokenArray([token]) for token in tokens] + ([Vt.TokenArray(list(tokens) * 2)] if tokens else [])


def type_of(definition: Usd.PrimDefinition, name: str) -> str:
    attribute = definition.GetAttributeDefinition(name)
    return str(attribute.GetTypeName()) if attribute else ""


def _type(name: str) -> Sdf.ValueTypeName:
    return Sdf.ValueTypeNames.Find(name)


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace("\r\n", "\\n") + '"'


def _with_metadata(stage: Usd.Stage, key: str, written: str) -> str:
    """The stage with one line of its metadata as text: USD itself would refuse to author some."""
    lines = stage.GetRootLayer().ExportToString().split("\n")
    kept = [line for line in lines if not line.startswith(f"    {key} =")]
    return "\n".join([*kept[:2], f"    {key} = {written}", *kept[2:]])
