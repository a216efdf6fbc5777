"""Wording of messages: suggestions for misspelt names, escaped control characters, numbers."""

import operator
import re
from collections.abc import Iterable
from difflib import SequenceMatcher

_LONGEST = 200
"""Longest name that is compared: the running time grows with the square of the length."""
_ALIKE = 0.75
"""Least similarity ratio (difflib) of names that count as alike [1]: one slip in four letters."""
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")
"""Characters that steer a terminal or turn the direction of its text, except tabs and line breaks."""
_RUNS = 12
"""Most runs of numbers listed in a message: about a line of a terminal."""


def nearest(name: str, choices: Iterable[str]) -> str | None:
    """The choice most similar to a name; None if none is similar.

    A name that lacks only its namespace matches the choice that ends with it. Otherwise only the part after the common
    namespaces is compared: `plen:image:bits` is not near `plen:image:fNumbers`.
    """
    choices = sorted(set(choices))
    if within := [choice for choice in choices if choice.endswith((f":{name}", f"/{name}"))]:
        return within[0]
    short = [choice for choice in choices if max(len(choice), len(name)) <= _LONGEST]
    alike = [(SequenceMatcher(None, *_tails(name, choice)).ratio(), choice) for choice in short]
    likeness, best = max(alike, key=operator.itemgetter(0), default=(0.0, None))
    return best if likeness >= _ALIKE else None


def did_you_mean(name: str, choices: Iterable[str]) -> str | None:
    """Hint for a misspelt name, or None."""
    best = nearest(name, choices)
    return f'did you mean "{best}"?' if best else None


def printable(text: str) -> str:
    """A text with escapes for control characters, including line breaks."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def for_terminals(text: str) -> str:
    """A text of several lines, with everything that would steer a terminal escaped."""
    return _CONTROL.sub(lambda match: printable(match[0]), text)


def human(size: float) -> str:
    """A number of bytes with a unit: 1.23 GB."""
    units = ["bytes", "kB", "MB", "GB", "TB"]
    while size >= 1000 and len(units) > 1:
        size /= 1000
        units.pop(0)
    return f"{size:.3g} {units[0]}"


def ranges(numbers: Iterable[int]) -> str:
    """`2-3, 7` for 2, 3 and 7; beyond a dozen runs the first ones and the count of the remaining numbers."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    listed = [str(first) if first == last else f"{first}-{last}" for first, last in runs[:_RUNS]]
    unlisted = sum(last - first + 1 for first, last in runs[_RUNS:])
    return ", ".join(listed) + (f" and {unlisted} more" if unlisted else "")


def frames_in_words(numbers: Iterable[int]) -> str:
    """`frame 7`, or `frames 2-3, 7`."""
    numbers = list(numbers)
    return f"frame{'s' if len(numbers) > 1 else ''} {ranges(numbers)}"


def _tails(name: str, choice: str) -> tuple[str, str]:
    """Two names without their common namespaces or folders."""
    parts, choice_parts = (re.split(r"(?<=[:/])", text) for text in (name, choice))
    while len(parts) > 1 and len(choice_parts) > 1 and parts[0] == choice_parts[0]:
        parts, choice_parts = parts[1:], choice_parts[1:]
    return "".join(parts).casefold(), "".join(choice_parts).casefold()
