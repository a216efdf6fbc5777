"""libpleno and COMPOTE: detection of blur-aware corners and calibration of multi-focus cameras, Labussière et al. 2022.

comsee-research/libpleno 48db282, compote 7e319c9, C++ with Eigen, OpenCV and Boost of Debian; without Qt: libpleno's
windows are replaced by none (libpleno/viewer_context.hpp) and the four clicks around each board by a file. Its
CMakeLists lack libv-build, so ours builds it. It reads images (8 bits, RGB), the export `libpleno`, and answers of a
user. Pixels, millimetres and poses are those of the export: docs/exports.md.

Its detector finds corners half a pixel too far right and down on average. Its template (MicroImageModel::generate) has
its edges at the whole pixel before the centre of the micro-image, but optimises as if they were at the centre, so that
each position has the fraction of that centre on top.
"""

import gzip
import json
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import models
import numpy as np
from environments import Failed, called
from snapshots import clone, replaced
from truth import read_table

_HERE = Path(__file__).with_name("libpleno")
_KINDS = ("<i4,<i4,<f8,<f8", "<i4,<i4,<f8,<f8,<i4,<i4", "<i4,<i4,<f8,<f8,<f8,<i4,<i4")
"""Of its observations: centres, corners, and features with k, l, x, y, rho, cluster and frame."""
_MIRRORED_DEG = 30.0
"""Angle between normals from which a board is mirrored [deg]: boards are tilted by 22 degrees or more, or not."""


def build(snapshots: Path, programs: Path) -> None:
    """Check both sources out, patch and compile them: ten minutes of two processors."""
    place = programs / "libpleno"
    clone(snapshots, "comsee-research/compote", place / "compote")
    if clone(snapshots, "comsee-research/libpleno", place / "libpleno"):
        library = place / "libpleno/pleno"
        gui = library / "graphic/gui.h"
        empty = r"\1 do {} while (0)"  # nothing is drawn, even where libpleno forces its windows open
        gui.write_text(re.sub(r"(#define (?:RENDER_DEBUG_[23]D|GUI)\(\.\.\.\)).*", empty, gui.read_text()))
        replaced(library / "processing/algorithms/neighbour_search.h", "auto return_same", "inline auto return_same")
        corners = library / "processing/detection/corners/corners.cpp"
        head, _, rest = corners.read_text().partition("std::array<P2D, 4> extract_checkerboard_view(")
        corners.write_text(head + (_HERE / "clicks.cpp").read_text() + rest.partition("\treturn view;\n}")[2])
        shutil.copytree(_HERE, place, dirs_exist_ok=True)
    called(["cmake", "-S", place, "-B", place / "build"])
    called(["make", "-C", place / "build", "-j1"], timeout=None)  # on a busy machine it takes its time


def run(programs: Path, task: Path, facts: dict[str, Any]) -> dict[str, Any]:
    """Calibrate from exported rows; from those of boards that did not start mirrored; and, if the task has images for
    it, from features that it detects in three tilted boards at the middle distance.

    Nearer ones have corners in so many micro-images that those of neighbours touch, and it takes them for one; of
    farther ones it misses corners.
    """
    export = task / "exports/libpleno" / facts["camera"]
    tools, work = programs / "libpleno/build", programs / "runs/libpleno"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    camera, params = ["-c", export / "camera.js"], ["-p", export / "params.js"]

    def calibrated(name: str, rows: Path) -> dict[str, Any]:
        _say(work / name, [tools / "calibrate", *camera, *params, "-s", export / "scene.js", "-f", rows])
        return _answer(work / name)

    rows = export / "observations.bin.gz"
    answers: dict[str, Any] = {"exact": calibrated("exact", rows)}
    if mirrored := _mirrored(work / "exact", export / "poses.js"):
        _write_without(mirrored, rows, work / rows.name)
        answers["unmirrored"] = calibrated("unmirrored", work / rows.name)
    noisy = sorted(task.glob("noise_*"))
    answers["noise"] = [calibrated(place.name, place / "libpleno" / facts["camera"] / rows.name) for place in noisy]
    if facts["has_images"]:
        frames = facts["frames"]
        middle = {"frames": frames[len(frames) // 3 : 2 * len(frames) // 3][1:]}
        _ask_images(task, facts | middle, export, work)
        try:
            _say(work / "detect", [tools / "detect", "-i", work / "images.js", *camera, *params])
            (observations,) = (work / "detect").glob("observations-*.bin.gz")
            _, _, features = _sections(observations)
            names = ("f6", "f0", "f1", "f2", "f3")  # frame, column and row of the micro-image, x and y
            answers["corners"] = np.stack([features[name].astype(float) for name in names], axis=1)
            own = calibrated("own", observations)
            if len(own["poses"]) == 0:
                raise Failed("it throws every board away, because it finds too few or too many corners")
            answers["own"] = own
        except Failed as error:  # its calibration from exact rows is worth keeping
            answers["failed"] = f"from features of its own: {error}"
    return answers


def _mirrored(place: Path, exact: Path) -> list[int]:
    """Frames whose boards start mirrored."""
    (start,) = place.glob("initial-poses-*.js")
    normals = [
        {
            int(one["frame"]): models.camera_from_board(one["pose"])[:3, 2]
            for one in json.loads(path.read_text())["poses"]
        }
        for path in (start, exact)
    ]
    return [frame for frame, z in normals[0].items() if z @ normals[1][frame] < np.cos(np.radians(_MIRRORED_DEG))]


def _sections(path: Path) -> Iterator[np.ndarray]:
    """The lists of a file of observations, each after its length."""
    data, start = gzip.decompress(path.read_bytes()), 0
    for kind in _KINDS:
        rows = np.frombuffer(data, kind, int.from_bytes(data[start : start + 8], "little"), start + 8)
        start += 8 + rows.nbytes
        yield rows


def _write_without(frames: list[int], rows: Path, place: Path) -> None:
    centres, corners, features = _sections(rows)
    kept = (centres, corners, features[~np.isin(features["f6"], frames)])
    data = b"".join(len(section).to_bytes(8, "little") + section.tobytes() for section in kept)
    place.write_bytes(gzip.compress(data))


def _ask_images(task: Path, facts: dict[str, Any], export: Path, work: Path) -> None:
    """Write images.js, and the clicks of a user who marks each board half a square outside of its outer corners."""
    columns, rows, seen = facts["columns"], facts["rows"], read_table(export / "features.csv")
    outer, size = [0, columns - 1, columns * rows - 1, columns * (rows - 1)], [columns, rows]
    clicks = []
    for frame in facts["frames"]:
        here = seen[seen["frame"] == int(frame)]
        marks = [here[here["cluster"] == node] for node in outer]
        at = np.array([[mark["k"].mean(), mark["l"].mean()] for mark in marks])
        clicks.append((at.mean(axis=0) + (at - at.mean(axis=0)) * np.divide(size, np.subtract(size, 1))).ravel())
    np.savetxt(work / "clicks.txt", clicks)
    number = {"fnumber": facts["f_number"]}
    white = {"path": str(task / "white.png")} | number
    whites = [{"path": str(task / f"white_{name}.png"), "fnumber": value} for name, value in facts["white"].items()]
    boards = [{"path": str(task / f"{name}.png"), "frame": int(name)} | number for name in facts["frames"]]
    images = {"meta": {"debayered": True, "format": 8, "rgb": True}, "whites": [white, *whites], "mask": white}
    (work / "images.js").write_text(json.dumps(images | {"checkerboards": boards}), encoding="utf-8")


def _say(place: Path, command: list[object]) -> None:
    """Run a tool, to whose questions a user answers yes; said.log is what it says."""
    place.mkdir()
    printed = called(
        [*command, "-g", "false", "-l", "7"],  # warnings must be on: without them nothing is saved
        input="y\n" * 10_000,
        env=os.environ | {"ARENA_CLICKS": str(place.parent / "clicks.txt")},
        cwd=place,
    )
    (place / "said.log").write_text(printed, encoding="utf-8")


def _answer(place: Path) -> dict[str, Any]:
    camera, poses = (json.loads((place / f"{name}.js").read_text()) for name in ("intrinsics", "extrinsics"))
    (errors,) = place.glob("rmse-*.csv")
    of_frames = np.genfromtxt(errors, delimiter=",", names=True)["uv"]
    return {
        "camera": camera,
        "frames": [int(one["frame"]) for one in poses["poses"]],
        "poses": np.array([models.camera_from_board(one["pose"]) for one in poses["poses"]]),
        "rms_px": float(np.sqrt(np.mean(np.atleast_1d(of_frames) ** 2))),
    }
