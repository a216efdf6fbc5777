"""Edits of a stage in a user's terms: attribute, frame, line, old and new value."""

import json
from dataclasses import dataclass
from typing import Any

_LONGEST = 60
"""Longest value in a message [characters]."""
_OF_A_VECTOR = 4
"""Most numbers that count as a vector: a longer list is an array."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """One value replaced by another.

    `at` is the path of a prim or property on the composed stage, or `/` for its layer. `field` names edited metadata
    (`references`, `endTimeCode`); it is None for a value, and for a whole prim, whose value is its type. `time` is that
    of an edited sample. `old` and `new` are JSON values, None where nothing is authored. `file` and `line` are the
    location as messages show it; for a removed statement, that of the prim that held it.
    """

    at: str
    field: str | None = None
    time: float | None = None
    old: Any = None
    new: Any = None
    file: str | None = None
    line: int | None = None

    @property
    def subject(self) -> str:
        """The edited thing, without its time."""
        if self.at == "/":
            return f"{self.field} of the layer"
        return f"<{self.at}>" + (f" {self.field}" if self.field else "")

    def __str__(self) -> str:
        location = "".join(f"{part}:" for part in (self.file, self.line) if part is not None)
        when = "" if self.time is None else f" at frame {self.time:g}"
        return f"{location} {self.subject}{when}{self._change()}".lstrip()

    def _change(self) -> str:
        """The change as text; for an array in which one entry differs, that entry alone."""
        old, new = self.old, self.new
        if "." not in self.at and self.field is None and (old is None or new is None):
            return f": new, {new}" if old is None else f": gone, was {old}"
        if isinstance(old, list) and isinstance(new, list) and len(old) == len(new) > _OF_A_VECTOR:
            changed = [index for index, pair in enumerate(zip(old, new, strict=True)) if pair[0] != pair[1]]
            if len(changed) == 1:
                (index,) = changed
                return f"[{index}]: {_text(old[index])} -> {_text(new[index])}"
        return f": {_text(old)} -> {_text(new)}"


def _text(value: Any) -> str:
    """A value in USD syntax, shortened if it is long."""
    text = json.dumps(value, ensure_ascii=False)
    if value is None:
        text = "not set"
    elif isinstance(value, float):
        text = repr(value).removesuffix(".0")
    elif isinstance(value, str) and value[:1] in ("<", "@"):
        text = value
    elif isinstance(value, list):
        is_vector = 1 < len(value) <= _OF_A_VECTOR and all(isinstance(entry, int | float) for entry in value)
        text = ", ".join(map(_text, value[:_LONGEST]))  # more entries would be cut in any case
        text = f"({text})" if is_vector else f"[{text}]"
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 2]} …"
