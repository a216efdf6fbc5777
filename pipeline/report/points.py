"""Numbers of points of each target that were seen in each frame, in lines for a terminal."""

from pipeline.channel_names import without_state
from pipeline.files.jsonfile import Json
from pipeline.spelling import frames_in_words

_ROWS = 20
"""A table of more frames is no table that anybody reads: its columns are summarised."""
_Column = tuple[str, str]
_Seen = dict[_Column, dict[int, int]]


def lines(cameras: dict[str, Json]) -> list[str]:
    """A table with a row per frame and a column per camera, in all its states, and target; and what frames are blank.

    Each camera has `of`, points per target, and `frames`, a list of {frame, rows, seen: points with a row per target}.
    """
    numbers = sorted({row["frame"] for points in cameras.values() for row in points["frames"]})
    seen, of = dict[_Column, dict[int, int]](), dict[_Column, int]()
    for camera, points in sorted(cameras.items()):
        for target in sorted(points["of"]):
            column = without_state(camera), target
            seen.setdefault(column, {}).update({row["frame"]: row["seen"][target] for row in points["frames"]})
            of[column] = points["of"][target]
    if not seen or not numbers:
        return []
    text = _table(numbers, seen, of) if len(numbers) <= _ROWS else _summary(numbers, seen, of)
    return [*text, *_blank(cameras)]


def _table(numbers: list[int], seen: _Seen, of: dict[_Column, int]) -> list[str]:
    heads = [f"{camera} {target}" for camera, target in seen]
    width = max(5, *(len(str(number)) for number in numbers))
    text = [f"  {'frame':>{width}}  {'  '.join(heads)}   (points seen)"]
    for number in numbers:
        cells = (f"{counts[number]} of {of[key]}" if number in counts else "" for key, counts in seen.items())
        padded = (f"{cell:<{len(head)}}" for cell, head in zip(cells, heads, strict=True))
        text.append(f"  {number:>{width}}  {'  '.join(padded).rstrip()}")
    return text


def _summary(numbers: list[int], seen: _Seen, of: dict[_Column, int]) -> list[str]:
    text = [f"points seen in {len(numbers)} frames:"]
    for (camera, target), counts in seen.items():
        values = sorted(counts.values())
        whole = sum(value == of[camera, target] for value in values)
        fewest = min(counts, key=lambda number: (counts[number], number))
        text.append(
            f"  {camera} {target}: all {of[camera, target]} in {whole} frames; median {values[len(values) // 2]};"
            f" fewest {counts[fewest]}, in frame {fewest}"
        )
    return text


def _blank(cameras: dict[str, Json]) -> list[str]:
    text = []
    for camera, points in sorted(cameras.items()):
        blank = [row["frame"] for row in points["frames"] if not row["rows"]]
        if blank:
            which = "any frame" if len(blank) == len(points["frames"]) else frames_in_words(blank)
            text.append(f"warning: {camera} sees no point in {which}: `pipeline check` says why")
    return text
