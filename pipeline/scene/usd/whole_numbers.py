"""Numbers that USD would cut: literals with a fraction for integer types, and anything but 0 and 1 for bool. Sdf
silently keeps the rest, so the text is checked.
"""

import re
from dataclasses import dataclass, field

SUFFIX = re.compile(r"\.(timeSamples|connect|spline)$")
"""Suffixes that usda writes after the name of an attribute."""
_WHOLE = re.compile(r"(?:u?int(?:64)?|uchar|int[234]|(?P<bool>bool))(?:\[\])?")
_DIGITS = re.compile(r"[\s\d,()[\]-]*")
_NUMBER = re.compile(r"[-+]?[\d.][\w.+-]*")


@dataclass(slots=True)
class CutNumbers:
    """Follower of the tokens of `usda_lines`, which knows where the value of a statement begins and ends.

    Attributes
    ----------
    found : list
        (path, what, hint, line) of numbers that USD would replace.
    """

    found: list[tuple[str, str, str, int]] = field(default_factory=list)
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
            self.found.append((self._path, f'"{self._name}" must be true or false, not {token}', "true", line))
        elif not self._is_bool and number - number == 0 and not number.is_integer():
            what = f'"{self._name}" must hold whole numbers, not {token}'
            self.found.append((self._path, what, str(int(number)), line))
