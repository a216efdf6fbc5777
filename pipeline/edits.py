"""Edits of a stage as a person makes them: attribute, frame, line, old and new value."""

import json
from dataclasses import asdict, dataclass
from typing import Any

_LONGEST = 60  # characters of a value in a text
_ENTRIES_SHOWN = 4  # of an array of which one entry differs


@dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """One value replaced by another.

    Attributes
    ----------
    at : str
        Path of the prim or property on the composed stage; `/` for the layer as a whole.
    field : str or None
        The metadata that was edited (`references`, `typeName`, `endTimeCode`); None: the value itself, or a whole
        prim, represented by its type.
    time : float or None
        Time of the edited sample; None for a default value.
    old, new : plain values
        None if nothing was, or is, authored. Vectors are tuples, arrays are lists.
    file, line : str or None, int or None
        The place as messages show it.
    remark : str or None
        A sentence about the place if it is not that of the new value.
    """

    at: str
    field: str | None = None
    time: float | None = None
    old: Any = None
    new: Any = None
    file: str | None = None
    line: int | None = None
    remark: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """The edit as in `plan --json`."""
        return asdict(self)

    @property
    def what(self) -> str:
        """The edited thing, without its time."""
        if self.at == "/":
            return f"{self.field} of the layer"
        return f"<{self.at}>" + (f" {self.field}" if self.field else "")

    def __str__(self) -> str:
        place = ":".join(str(part) for part in (self.file, self.line) if part is not None)
        when = "" if self.time is None else f" at frame {_text(self.time)}"
        remark = f" ({self.remark})" if self.remark else ""
        return (f"{place}: " if place else "") + f"{self.what}{when}{self._change()}{remark}"

    def _change(self) -> str:
        """The change as text; for long arrays only the entry that differs."""
        old, new = self.old, self.new
        if "." not in self.at and self.field is None:
            return f": new, {new}" if old is None else f": gone, was {old}"
        if isinstance(old, list) and isinstance(new, list) and len(old) == len(new) > _ENTRIES_SHOWN:
            places = [index for index, pair in enumerate(zip(old, new, strict=True)) if pair[0] != pair[1]]
            if len(places) == 1:
                return f"[{places[0]}]: {_text(old[places[0]])} -> {_text(new[places[0]])}"
        return f": {_text(old)} -> {_text(new)}"


def _text(value: Any) -> str:
    """A value as USD writes it, shortened if it is long."""
    text = _written(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 2]} …"


def _written(value: Any) -> str:
    if value is None:
        return "not set"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value).removesuffix(".0")
    if isinstance(value, str):
        return value if value[:1] in ("<", "@") else json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple | list):
        inside = ", ".join(map(_written, value[:_LONGEST]))  # more entries would be cut in any case
        return f"[{inside}]" if isinstance(value, list) else f"({inside})"
    return str(value)
