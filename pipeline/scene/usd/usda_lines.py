"""Line numbers in .usda text: of prims, properties, time samples and assets.

While parsing, Sdf drops line numbers and the first of two equal statements. To show the place of a valid but wrong
value, the text is scanned again; names, brackets and strings are enough. On the way, numbers that USD would silently
cut are noted: literals with a fraction for integer types, and anything but 0 and 1 for bool.
"""

import re
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from pxr import Ar, Sdf

# An unclosed string extends to the end of the line or the text; otherwise each of a million would be searched for.
_TOKEN = re.compile(
    r"""(?P<string>\"{3}(?:\\.|[^\\])*?(?:\"{3}|\Z)|'{3}(?:\\.|[^\\])*?(?:'{3}|\Z)
                  |"(?:\\.|[^"\\\n])*"?|'(?:\\.|[^'\\\n])*'?)
      | (?P<comment>\#[^\n]*|//[^\n]*|/\*.*?(?:\*/|\Z))
      | (?P<asset>@@@.*?(?:@@@|\Z)|@[^@\n]*@?)
      | (?P<path><[^>\n]*>?)
      | (?P<word>[A-Za-z_][\w:.]*(?:\[\])?)
      | (?P<number>[-+]?[\d.][\w.+-]*)
      | (?P<numbers>\[(?=[\s(]*+[\d.+-])[\s\d,().eE+-]++\])
      | (?P<punct>[{}()\[\]=,;:])
      | (?P<newline>\n)""",
    re.VERBOSE | re.DOTALL,
)
"""Pattern of tokens. A large mesh is mostly arrays of numbers: a whole array is one token, `numbers`."""
_PRIM_WORDS = ("def", "over", "class", "variantSet")
_LIST_EDITS = ("prepend", "append", "add", "delete", "reorder")
SUFFIX = re.compile(r"\.(timeSamples|connect|spline)$")
"""Suffixes that usda writes after the name of an attribute."""
_WHOLE = re.compile(r"(?:u?int(?:64)?|uchar|int[234]|(?P<bool>bool))(?:\[\])?")
_DIGITS = re.compile(r"[\s\d,()[\]-]*")
_NUMBER = re.compile(r"[-+]?[\d.][\w.+-]*")


@dataclass(slots=True)
class TextMap:
    """Lines of statements in one file.

    Attributes
    ----------
    lines : dict
        Line of `/A`, `/A.x`, `/A.x[3]` (the time sample at 3) and, for paths inside variants, `/A{set=name}B`.
    repeated : list
        (path, what, line) of statements that overwrite an earlier one: USD silently keeps the last.
    assets : dict
        Line of the first mention of each asset path.
    bodies : dict
        Offset in the text [characters] of the end of the "{" of each prim; for "" of the "(" of the layer's metadata.
    metadata : dict
        Lines of the metadata of the layer.
    cut : list
        (path, what, value in USD, line) of numbers that USD would cut to whole ones.
    """

    lines: dict[str, int] = field(default_factory=dict)
    repeated: list[tuple[str, str, int]] = field(default_factory=list)
    assets: dict[str, int] = field(default_factory=dict)
    bodies: dict[str, int] = field(default_factory=dict)
    metadata: dict[str, int] = field(default_factory=dict)
    cut: list[tuple[str, str, str, int]] = field(default_factory=list)


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


def map_of(data: bytes) -> TextMap:
    """Map of the bytes of a layer; empty if they are not text."""
    return _Scanner().scan(data.decode("utf-8", errors="replace")) if data.startswith(b"#usda") else TextMap()


@lru_cache(maxsize=64)
def _scanned(path: str, _mtime_ns: int) -> TextMap:
    return map_of(_member(path) if Ar.IsPackageRelativePath(path) else _content(Path(path)))


def _content(path: Path) -> bytes:
    """Bytes of a text file; for a package those of its first member, its default layer."""
    with path.open("rb") as stream:
        head = stream.read(5)
    if head == b"#usda":
        return path.read_bytes()
    if head[:2] == b"PK" and (package := Sdf.ZipFile.Open(str(path))):
        return _member(Ar.JoinPackageRelativePath([str(path), *package.GetFileNames()[:1]]))
    return b""


def _member(path: str) -> bytes:
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    return bytes(asset.GetBuffer()) if asset else b""


class _Scanner:
    """One pass over the tokens, with a stack of open brackets.

    An entry of the stack is ("prim" | "set" | "variant", name), ("samples", property path) inside `timeSamples`, or
    None for a bracket that does not change the path: metadata, values, dictionaries.
    """

    def __init__(self) -> None:
        self.map = TextMap()
        self.seen: set[str] = set()
        self.stack: list[tuple[str, str] | None] = []
        self.words: list[tuple[str, int]] = []  # of the statement so far
        self.opening: tuple[str, str, int, int] | None = None  # a prim or variant before its "{"
        self.samples: str | None = None  # a property with timeSamples, before their "{"
        self.number: tuple[str, int] | None = None  # the number before a ":"
        self.end = 0  # offset of the end of the token in the text
        self.values = CutNumbers(self.map.cut)

    def scan(self, text: str) -> TextMap:
        line, position = 1, 0
        for match in _TOKEN.finditer(text):
            line += text.count("\n", position, match.start())
            position, self.end = match.start(), match.end()
            self._token(match.lastgroup or "", match.group(), line)
        return self.map

    def _token(self, kind: str, token: str, line: int) -> None:
        self.values.token(kind, token, line, len(self.stack))
        if kind == "word":
            self.words.append((token, line))
        elif kind == "number":
            self.number = (token, line)
        elif kind == "numbers":
            self.words = []
        elif kind == "string":
            self._string(token.strip("\"'"), line)
        elif kind == "punct":
            self._punctuation(token)
        else:
            if kind == "asset":
                self.map.assets.setdefault(token.strip("@"), line)
            # After a comment, asset, path or end of line the name before it is complete.
            if self.words and self.words[0][0] not in _PRIM_WORDS:
                self._property()
                self.words = []

    def _string(self, name: str, line: int) -> None:
        depth = len(self.stack)
        if self.words and self.words[0][0] in _PRIM_WORDS:
            word, line = self.words[0]
            self.opening = ("set" if word == "variantSet" else "prim", name, line, depth)
            self.words = []
        elif not self.words and self.stack and (self.stack[-1] or "")[:1] == ("set",):
            self.opening = ("variant", name, line, depth)

    def _punctuation(self, token: str) -> None:
        if token == "{":
            self._open_brace()
        elif token in "([":
            if token == "(" and not self.stack and not self.map.lines and not self.opening:
                self.map.bodies.setdefault("", self.end)
            if self.words and token == "(":
                self._property()
            self.stack.append(None)
        elif token in "})]":
            if self.stack:
                self.stack.pop()
        elif token == "=":
            self._property()
            self.values.begin(self._path(), len(self.stack))
        elif token == ":":
            self._sample()
        else:
            return
        self.words = []

    def _open_brace(self) -> None:
        # The depth tells the body of a prim from a dictionary inside ( ... ).
        if self.opening and len(self.stack) == self.opening[3]:
            kind, name, line, _ = self.opening
            self.stack.append((kind, name))
            self.map.lines.setdefault(self._path(), line)
            self.map.bodies.setdefault(self._path(), self.end)
            self.opening = None
        elif self.samples:
            self.stack.append(("samples", self.samples))
            self.samples = None
        else:
            self.stack.append(None)

    def _property(self) -> None:
        path = self._path()
        if self.stack == [None] and self.words:
            self.map.metadata.setdefault(*self.words[-1])
        if len(self.words) < 2 or not path:
            return
        name, line = self.words[-1]
        bare = SUFFIX.sub("", name)
        self.map.lines.setdefault(f"{path}.{bare}", line)
        edit = next((word for word, _ in self.words if word in _LIST_EDITS), "")
        self._note(f"{path}.{bare}", f"{edit} {name}".strip(), f'"{name}" is written twice', line)
        self.samples = f"{path}.{bare}" if name.endswith(".timeSamples") else None

    def _sample(self) -> None:
        top = self.stack[-1] if self.stack else None
        if top and top[0] == "samples" and self.number:
            token, line = self.number
            try:
                key = sample_key(float(token))
            except ValueError:
                return  # USD reports it
            self.map.lines.setdefault(top[1] + key, line)
            self._note(top[1], key, f"the time sample at {token} is written twice", line)

    def _note(self, path: str, key: str, what: str, line: int) -> None:
        full = f"{path} {key}"
        if full in self.seen:
            self.map.repeated.append((path, what, line))
        self.seen.add(full)

    def _path(self) -> str:
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


@dataclass(slots=True)
class CutNumbers:
    """Follower of the tokens of a text, which knows where the value of a statement begins and ends.

    Attributes
    ----------
    cut : list
        (path, message, value in USD, line) of numbers that USD would replace.
    """

    cut: list[tuple[str, str, str, int]] = field(default_factory=list)
    _words: list[str] = field(default_factory=list)
    _path: str = ""
    _name: str = ""
    _is_bool: bool = False
    _depth: int | None = None
    _number: tuple[str, int] | None = None

    def begin(self, prim: str, depth: int) -> None:
        """Begin a value after the "=" of a statement, in the body of a prim or, without a path, elsewhere."""
        *types, name = self._words or [""]
        match = _WHOLE.fullmatch(types[-1]) if types else None
        self._depth = depth if match else None
        if match:
            self._name, self._is_bool = SUFFIX.sub("", name), bool(match["bool"])
            self._path = f"{prim}.{self._name}" if prim else ""

    def token(self, kind: str, token: str, line: int, depth: int) -> None:
        """Process the next token, with `depth` open brackets before it."""
        if kind == "word":
            self._words.append(token)
        elif token not in ("[", "]", "="):  # int [] is a type, too
            self._words = []
        if self._depth is not None and kind == "numbers":
            self._array(token, line, depth)
        elif self._depth is not None and kind not in ("newline", "comment"):
            self._value(kind, token, line, depth)

    def _array(self, token: str, line: int, depth: int) -> None:
        """Process an array of plain numbers with its brackets."""
        assert self._depth is not None
        if self._is_bool or not _DIGITS.fullmatch(token):  # most tokens are digits: large meshes have millions
            for offset, text in enumerate(token.split("\n")):
                for number in _NUMBER.findall(text):
                    self._judge(number, line + offset)
        self._number = None
        if depth <= self._depth:
            self._depth = None

    def _value(self, kind: str, token: str, line: int, depth: int) -> None:
        assert self._depth is not None
        if self._number and token != ":":  # otherwise it was the time of a sample
            self._judge(*self._number)
        self._number = None
        if kind == "number" and depth > self._depth:
            self._number = (token, line)
        elif kind == "number":
            self._judge(token, line)
        closes = token in ("}", ")", "]") and kind == "punct" and depth - 1 <= self._depth
        opens = token in ("{", "(", "[") and kind == "punct"
        if closes or (depth <= self._depth and not opens):
            self._depth = None

    def _judge(self, token: str, line: int) -> None:
        try:
            number = float(token)
        except ValueError:
            return  # USD reports it
        if self._is_bool and number not in (0.0, 1.0):
            self.cut.append((self._path, f'"{self._name}" must be true or false, not {token}', "true", line))
        elif not self._is_bool and number - number == 0 and not number.is_integer():
            message = f'"{self._name}" must hold whole numbers, not {token}'
            self.cut.append((self._path, message, str(int(number)), line))
