"""Run one contestant in its own environment: files in, files out. It needs NumPy and nothing of this project.

    python exchange.py SCRIPT IN OUT OPTION

SCRIPT holds `detect(image, board, option)` or `calibrate(case, option)`; README.md says what they get and return.
Answers are OUT/NAME.npz. What went wrong with one image or case is the text of OUT/NAME.txt; the others go on.
"""

import importlib.util
import json
import resource
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np


def read_pgm(path: Path) -> np.ndarray:
    """Grey image of 8 bits, (h, w) uint8, of a binary PGM file without comments."""
    data = path.read_bytes()
    kind, width, height, most = data.split(maxsplit=4)[:4]
    if kind != b"P5" or int(most) != 255:
        raise ValueError(f"{path} is no binary PGM of 8 bits")
    return np.frombuffer(data, np.uint8)[-int(width) * int(height) :].reshape(int(height), int(width)).copy()


def write_pgm(path: Path, image: np.ndarray) -> None:
    """Write a grey image of 8 bits, (h, w) uint8."""
    path.write_bytes(b"P5\n%d %d\n255\n" % image.shape[::-1] + image.tobytes())


def _run(name: str, out: Path, work: Callable[[], dict[str, Any]]) -> None:
    try:
        answer = work()
    except Exception as error:  # whatever a foreign program raises is its answer
        (out / f"{name}.txt").write_text(f"{type(error).__name__}: {error}\n", encoding="utf-8")
    else:
        np.savez(out / f"{name}.npz", **{key: value for key, value in answer.items() if value is not None})


def run_detector(script: ModuleType, given: Path, out: Path, option: str) -> None:
    """All images of a tree of folders, each of which has a board.json."""
    for board_file in sorted(given.rglob("board.json")):
        board = json.loads(board_file.read_text(encoding="utf-8"))
        answers = out / board_file.parent.relative_to(given)
        answers.mkdir(parents=True, exist_ok=True)
        for path in sorted(board_file.parent.glob("*.pgm")):
            image = read_pgm(path)
            _run(path.stem, answers, lambda i=image, b=board, p=path: script.detect(i, b | {"path": str(p)}, option))


def run_calibrator(script: ModuleType, given: Path, out: Path, option: str) -> None:
    """All cases of a folder."""
    out.mkdir(parents=True, exist_ok=True)
    for path in sorted(given.glob("*.npz")):
        with np.load(path) as file:
            case = {key: file[key] for key in file.files}
        rows = [np.flatnonzero(case["view"] == view) for view in np.unique(case["view"])]
        boards = [{name: case[name][of] for name in ("point", "object_mm", "image_px")} for of in rows]
        _run(path.stem, out, lambda c=case, b=boards: script.calibrate(c | {"boards": b}, option))


def main() -> None:
    """Run the command."""
    place, given, out, option = sys.argv[1:]
    found = importlib.util.spec_from_file_location(Path(place).stem, place)
    assert found is not None and found.loader is not None
    script = importlib.util.module_from_spec(found)
    found.loader.exec_module(script)
    runner = run_detector if hasattr(script, "detect") else run_calibrator
    runner(script, Path(given), Path(out), option)
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    took = sum(one.ru_utime + one.ru_stime for one in used)
    (Path(out) / "cpu_s.log").write_text(f"{took}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
