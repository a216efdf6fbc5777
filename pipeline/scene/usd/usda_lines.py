"""Line numbers in .usda text: of prims, properties, time samples and assets.

Sdf drops line numbers, the first of two equal statements, and the fractions of whole numbers. To find the line of a
valid but wrong value, the text is scanned again; names, brackets and strings are enough.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from pxr import Ar, Sdf

_COMMENT = r"\#[^\n]*|//[^\n]*|/\*.*?(?:\*/|\Z)"
# An unclosed string extends to the end of the line or the text; otherwise each of a million would be searched for.
_TOKEN = re.compile(
    rf"""(?P<string>\"{{3}}(?:\\.|[^\\])*?(?:\"{{3}}|\Z)|'{{3}}(?:\\.|[^\\])*?(?:'{{3}}|\Z)
                  |"(?:\\.|[^"\\\n])*"?|'(?:\\.|[^'\\\n])*'?)
      | (?P<comment>{_COMMENT})
      | (?P<asset>@@@.*?(?:@@@|\Z)|@[^@\n]*@?)
      | (?P<path><[^>\n]*>?)
      | (?P<word>[A-Za-z_][\w:.]*(?:\[\])?)
      | (?P<number>[-+]?[\d.][\w.+-]*)
      | (?P<numbers>\[(?=[\s(]*+[\d.+-])[\s\d,().eE+-]++\])
      | (?P<punct>[{{}}()\[\]=,;:])
      | (?P<newline>\n)""",
    re.VERBOSE | re.DOTALL,
)
"""Pattern of tokens. A large mesh is mostly arrays of numbers: a whole array is one token, `numbers`."""
_PRIM_WORDS = ("def", "over", "class", "variantSet")
_LIST_EDITS = ("prepend", "append", "add", "delete", "reorder")
_SUFFIX = r"\.(?:timeSamples|connect|spline)$"
"""Suffixes that usda writes after the name of an attribute."""
_WHOLE = re.compile(r"\b(?:u?int(?:64)?|uchar|int[234]|(?P<bool>bool))\s*(?:\[\s*\])?\s+(?P<name>[A-Za-z_][\w:.]*)\s*$")
"""A declaration of whole numbers or flags, at the end of a text."""
_LONGEST_NAME = 300
"""Longest declaration that is recognised [characters]."""
_VALUE = re.compile(
    rf"\s*(?:\{{(?:[^}}#/]++|{_COMMENT}|/)*+\}}|\[(?:[^\]#/]++|{_COMMENT}|/)*+\]|\([^)]*\)|[-+\d.][\w.+-]*)", re.DOTALL
)
_DIGITS = re.compile(r"[\s\d,()[\]-]*")
_NUMBER = re.compile(rf"{_COMMENT}|(?P<number>[-+]?[\d.][\w.+-]*+)(?!\s*:)", re.DOTALL)
"""A number that is not the time of a sample, or a comment."""


class Flaw(NamedTuple):
    """A valid statement that USD silently changes."""

    code: str
    path: str
    message: str
    hint: str
    line: int


@dataclass(slots=True)
class TextMap:
    """Lines of statements in one file: of `/A`, `/A.x`, `/A.x[3]` (the time sample, or knot, at 3) and, inside
    variants, `/A{set=name}B`; of the first mention of each asset path; and of the metadata of the layer.
    """

    lines: dict[str, int] = field(default_factory=dict)
    flaws: list[Flaw] = field(default_factory=list)
    assets: dict[str, int] = field(default_factory=dict)
    metadata: dict[str, int] = field(default_factory=dict)


def line_of(file: str | Path, spec_path: str) -> int | None:
    """Line of a spec, from 1; if it is not found, that of its property or prim."""
    lines = text_map(file).lines
    without_sample = re.sub(r"\[[^\]]*\]$", "", spec_path)
    return lines.get(spec_path) or lines.get(without_sample) or lines.get(without_sample.split(".")[0])


def line_of_metadata(file: str | Path, key: str) -> int:
    """Line of layer metadata in a .usda file, from 1; 1 if it is not found."""
    return text_map(file).metadata.get(key, 1)


def sample_key(time: float) -> str:
    """A time as written in the keys of `TextMap.lines`."""
    return f"[{float(time)!r}]"


def text_map(file: str | Path) -> TextMap:
    """Map of a .usda file or of a member of a package; empty if it is not text."""
    # For USD package.usdz[member] is a member of a package, even if a file has that name.
    path = Path(Ar.SplitPackageRelativePathOuter(str(file))[0] if Ar.IsPackageRelativePath(str(file)) else file)
    return _scanned(str(file), path.stat().st_mtime_ns) if path.is_file() else TextMap()


@lru_cache(maxsize=64)
def _scanned(path: str, _mtime_ns: int) -> TextMap:
    """Map of a text, scanned once until the file changes."""
    content = _content(path)
    return _Scanner(content.decode("utf-8", errors="replace")).map if content.startswith(b"#usda") else TextMap()


def _content(path: str) -> bytes:
    """Bytes of a text file or a member of a package; for a package those of its first member, its default layer."""
    if not Ar.IsPackageRelativePath(path):
        with Path(path).open("rb") as stream:
            head = stream.read(5)
        package = Sdf.ZipFile.Open(path) if head[:2] == b"PK" else None
        if not package:
            return Path(path).read_bytes() if head == b"#usda" else b""
        path = Ar.JoinPackageRelativePath([path, *package.GetFileNames()[:1]])
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    return bytes(asset.GetBuffer()) if asset else b""


def _cut_numbers(text: str, start: int, line: int, is_bool: bool) -> Iterator[tuple[str, int]]:
    """Literals of a value that is no whole number or no flag, with their lines; the value is at `start`."""
    value = _VALUE.match(text, start)
    if not value or (not is_bool and _DIGITS.fullmatch(value[0])):
        return  # most values are digits: large meshes have millions
    position = start
    for match in _NUMBER.finditer(text, start, value.end()):
        line, position = line + text.count("\n", position, match.start()), match.start()
        try:
            number = float(match["number"] or 0)
        except ValueError:
            continue  # USD reports it
        if number not in (0.0, 1.0) if is_bool else number - number == 0 and not number.is_integer():
            yield match["number"], line


class _Scanner:
    """One pass over the tokens, with a stack of open brackets.

    An entry of the stack is ("prim" | "set" | "variant", name), ("samples", property path) inside `timeSamples` or a
    spline, or None for a bracket that does not change the path: metadata, values, dictionaries.
    """

    def __init__(self, text: str) -> None:
        self.map = TextMap()
        self.text = text
        self.statements: set[str] = set()  # to find those that are written twice
        self.stack: list[tuple[str, str] | None] = []
        self.words: list[tuple[str, int]] = []  # of the statement so far
        self.opening: tuple[str, str, int, int] | None = None  # a prim or variant before its "{"
        self.samples: str | None = None  # a property with timeSamples or a spline, before their "{"
        self.number: tuple[str, int] | None = None  # the number before a ":"
        self.end = 0  # offset of the end of the token in the text
        line, position = 1, 0
        for match in _TOKEN.finditer(text):
            line += text.count("\n", position, match.start())
            position, self.end = match.start(), match.end()
            self._token(match.lastgroup or "", match.group(), line)

    def _token(self, kind: str, token: str, line: int) -> None:
        """Go on by one token of the text; its kind is a group of `_TOKEN`."""
        if kind == "word":
            self.words.append((token, line))
            self.number = None  # `post: held` of a spline is no time
        elif kind == "number":
            self.number = (token, line)
        elif kind == "numbers":
            self.words = []
        elif kind == "string":
            self._string(token.strip("\"'"), line)
        elif kind == "punct":
            self._punctuation(token, line)
        else:
            if kind == "asset":
                self.map.assets.setdefault(token.strip("@"), line)
            # After a comment, asset, path or end of line the name before it is complete.
            if self.words and self.words[0][0] not in _PRIM_WORDS:
                self._property()
                self.words = []

    def _string(self, name: str, line: int) -> None:
        """A string names a prim or a set of variants after their words, and a variant inside a set."""
        depth = len(self.stack)
        if self.words and self.words[0][0] in _PRIM_WORDS:
            word, line = self.words[0]
            self.opening = ("set" if word == "variantSet" else "prim", name, line, depth)
            self.words = []
        elif not self.words and self.stack and (self.stack[-1] or "")[:1] == ("set",):
            self.opening = ("variant", name, line, depth)

    def _punctuation(self, token: str, line: int) -> None:
        """A bracket opens or closes an entry of the stack; `=` ends the name of a property, `:` a time of a sample."""
        if token == "{":
            self._open_brace()
        elif token in "([":
            if self.words and token == "(":
                self._property()
            self.stack.append(None)
        elif token in "})]":
            if self.stack:
                self.stack.pop()
        elif token == "=":
            self._property()
            self._value(line)
        elif token == ":":
            self._sample()
        else:
            return
        self.words = []

    def _open_brace(self) -> None:
        """A brace opens a prim, a set or a variant, or the samples of a property, or something without a path."""
        # The depth tells the body of a prim from a dictionary inside ( ... ).
        if self.opening and len(self.stack) == self.opening[3]:
            kind, name, line, _ = self.opening
            self.stack.append((kind, name))
            self.map.lines.setdefault(self._path(), line)
            self.opening = None
        elif self.samples:
            self.stack.append(("samples", self.samples))
            self.samples = None
        else:
            self.stack.append(None)

    def _property(self) -> None:
        """Note the line of the property that the last word names, or of metadata of the layer."""
        path = self._path()
        if self.stack == [None] and self.words:
            self.map.metadata.setdefault(*self.words[-1])
        if len(self.words) < 2 or not path or (self.stack[-1] or "")[:1] == ("samples",):  # such as `post linear`
            return
        name, line = self.words[-1]
        bare = f"{path}.{re.sub(_SUFFIX, '', name)}"
        self.map.lines.setdefault(bare, line)
        edit = next((word for word, _ in self.words if word in _LIST_EDITS), "")
        self._note_once(bare, f"{edit} {name}".strip(), f'"{name}" is written twice', line)
        self.samples = bare if name.endswith((".timeSamples", ".spline")) else None

    def _value(self, line: int) -> None:
        """Note the numbers after the "=" of a statement that USD would cut."""
        start = max(self.text.rfind("\n", 0, self.end) + 1, self.end - _LONGEST_NAME)
        if not (declared := _WHOLE.search(self.text[start : self.end - 1])):
            return
        prim, name = self._path(), re.sub(_SUFFIX, "", declared["name"])
        for literal, its_line in _cut_numbers(self.text, self.end, line, bool(declared["bool"])):
            wanted = "be true or false" if declared["bool"] else "hold whole numbers"
            rounded = "true" if declared["bool"] else str(int(float(literal)))
            message, hint = f'"{name}" must {wanted}, not {literal}', f"USD would silently use {rounded}"
            self.map.flaws.append(Flaw("not-whole", f"{prim}.{name}" if prim else "", message, hint, its_line))

    def _sample(self) -> None:
        """Note the line of a time sample; the number before the ":" is its time."""
        top = self.stack[-1] if self.stack else None
        if top and top[0] == "samples" and self.number:
            token, line = self.number
            try:
                key = sample_key(float(token))
            except ValueError:
                return  # USD reports it
            self.map.lines.setdefault(top[1] + key, line)
            self._note_once(top[1], key, f"the time sample at {token} is written twice", line)

    def _note_once(self, path: str, key: str, message: str, line: int) -> None:
        """Note a statement about a path; a flaw with this message if it was written before."""
        full = f"{path} {key}"
        if full in self.statements:
            hint = "USD silently keeps the last one; remove one"
            self.map.flaws.append(Flaw("written-twice", path, message, hint, line))
        self.statements.add(full)

    def _path(self) -> str:
        """Path of the prim or variant in whose body the text is; empty elsewhere."""
        path = set_name = ""
        for entry in self.stack:
            if entry is None:
                return ""
            kind, name = entry
            if kind == "set":
                set_name = name
            elif kind == "variant":
                path += f"{{{set_name}={name}}}"
            elif kind == "prim":
                path += name if path.endswith("}") else "/" + name
        return path
