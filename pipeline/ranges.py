"""Short texts for sets of whole numbers, such as frames."""

from collections.abc import Iterable

_SHOWN = 12
"""Number of runs in a text: about a line of a terminal."""


def ranges(numbers: Iterable[int]) -> str:
    """`2-3, 7` for 2, 3 and 7; of very many runs the first ones and the count of all other numbers."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    shown = [str(first) if first == last else f"{first}-{last}" for first, last in runs[:_SHOWN]]
    rest = sum(last - first + 1 for first, last in runs[_SHOWN:])
    return ", ".join(shown) + (f" and {rest} more" if rest else "")


def frames_in_words(numbers: Iterable[int]) -> str:
    """`frame 7`, or `frames 2-3, 7`."""
    numbers = list(numbers)
    return f"frame{'s' if len(numbers) > 1 else ''} {ranges(numbers)}"
