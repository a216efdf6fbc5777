"""libpleno and COMPOTE: detection of blur-aware corners and calibration of multi-focus cameras, Labussière et al. 2022.

comsee-research/libpleno 48db282, compote 7e319c9, C++ with Eigen, OpenCV and Boost of Debian; without Qt: libpleno's
windows are replaced by none (libpleno/viewer_context.hpp) and the four clicks around each board by a file. Its
CMakeLists lack libv-build, so ours builds it. It reads images (8 bits, RGB), the export `libpleno`, and answers of a
user. Pixels, millimetres and poses are those of the export: docs/exports.md.

Its detector finds corners half a pixel too far right and down on average. Its template (MicroImageModel::generate) has
its edges at the whole pixel before the centre of the micro-image, but optimises as if they were at the centre, so that
each position has the fraction of that centre on top.
"""

import csv
import gzip
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
from snapshots import LONGEST_S, clone, replaced

_HERE = Path(__file__).with_name("libpleno")


def build(snapshots: Path, folder: Path) -> None:
    """Check both sources out, patch and compile them: ten minutes of two processors."""
    place = folder / "libpleno"
    clone(snapshots, "comsee-research+compote", "7e319c9", place / "compote")
    if clone(snapshots, "comsee-research+libpleno", "48db282", place / "libpleno"):
        library = place / "libpleno/pleno"
        gui = library / "graphic/gui.h"
        empty = r"\1 do {} while (0)"  # nothing is drawn, even where libpleno forces its windows open
        gui.write_text(re.sub(r"(#define (?:RENDER_DEBUG_[23]D|GUI)\(\.\.\.\)).*", empty, gui.read_text()))
        replaced(library / "processing/algorithms/neighbour_search.h", "auto return_same", "inline auto return_same")
        corners = library / "processing/detection/corners/corners.cpp"
        head, _, rest = corners.read_text().partition("std::array<P2D, 4> extract_checkerboard_view(")
        corners.write_text(head + (_HERE / "clicks.cpp").read_text() + rest.partition("\treturn view;\n}")[2])
        for room in ("core", "geometry", "lma", "graphic"):  # what libv's CMake would write
            (place / f"stub/libv/{room}/found").mkdir(parents=True)
            (place / f"stub/libv/{room}/export.hpp").write_text(f"#define LIBV_{room.upper()}_EXPORT\n")
        for found in ("boost_iostreams", "eigen", "opencv"):
            (place / "stub/libv/core/found" / found).touch()
        (place / "stub/opencv").mkdir()
        (place / "stub/opencv/cv.h").write_text("#include <opencv2/opencv.hpp>\n")
        shutil.copy(_HERE / "viewer_context.hpp", place / "stub/libv/graphic")
        for empty_header in ("colors", "palette"):
            (place / f"stub/libv/graphic/{empty_header}.hpp").write_text("#pragma once\n")
        shutil.copy(_HERE / "CMakeLists.txt", place)
    subprocess.run(["cmake", "-S", place, "-B", place / "build"], check=True, capture_output=True)
    subprocess.run(["make", "-C", place / "build", "-j1"], check=True, capture_output=True)


def run(folder: Path, task: Path, *, from_images: bool = True) -> dict[str, object]:
    """Calibrate from exported rows, and from features that it detects in three tilted boards at the middle distance.

    Nearer ones have corners in so many micro-images that those of neighbours touch, and it takes them for one; of
    farther ones it misses corners.
    """
    known = json.loads((task / "task.json").read_text(encoding="utf-8"))
    export = task / "exports/libpleno" / known["camera"]
    tools, work = folder / "libpleno/build", folder / "runs/libpleno"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    camera, params = ["-c", export / "camera.js"], ["-p", export / "params.js"]

    def calibrated(name: str, rows: Path) -> dict[str, object]:
        _say(work / name, [tools / "calibrate", *camera, *params, "-s", export / "scene.js", "-f", rows])
        return _answer(work / name)

    answers: dict[str, object] = {"exact": calibrated("exact", export / "observations.bin.gz")}
    noisy = sorted(task.glob("noise_*"))
    answers["noise"] = [
        calibrated(place.name, place / "libpleno" / known["camera"] / "observations.bin.gz") for place in noisy
    ]
    if from_images:
        frames = known["frames"]
        middle = {"frames": frames[len(frames) // 3 : 2 * len(frames) // 3][1:]}
        _ask_images(task, known | middle, export, work)
        try:
            _say(work / "detect", [tools / "detect", "-i", work / "images.js", *camera, *params])
            (observations,) = (work / "detect").glob("observations-*.bin.gz")
            answers["corners"] = _features(observations)
            answers["own"] = calibrated("own", observations)
            if not answers["own"]["poses"]["poses"]:  # type: ignore[index]
                raise ValueError("it throws every board away, because it finds too few or too many corners")
        except (subprocess.SubprocessError, ValueError) as error:  # its calibration from exact rows is worth keeping
            answers.pop("own", None)
            answers["failed"] = f"from features of its own: {error}"
    return answers


def _features(path: Path) -> np.ndarray:
    """Its features: frame, column and row of the micro-image, x and y [px], (n, 5)."""
    data, start = gzip.decompress(path.read_bytes()), 0
    for size in (24, 32):  # centres and corners come first, each list after its length
        start += 8 + size * int.from_bytes(data[start : start + 8], "little")
    rows = np.frombuffer(data, "<i4,<i4,<f8,<f8,<f8,<i4,<i4", offset=start + 8)
    return np.stack([rows[name].astype(float) for name in ("f6", "f0", "f1", "f2", "f3")], axis=1)


def _ask_images(task: Path, known: dict, export: Path, work: Path) -> None:
    """Write images.js, and the clicks of a user who marks each board half a square outside of its outer corners."""
    number, columns, rows = known["f_number"], known["columns"], known["rows"]
    lines = (line for line in (export / "features.csv").read_text().splitlines() if not line.startswith("#"))
    seen = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(lines)]
    clicks = []
    for frame in known["frames"]:
        here = [row for row in seen if row["frame"] == int(frame)]
        outer = [0, columns - 1, columns * rows - 1, columns * (rows - 1)]
        at = np.array(
            [np.mean([[row["k"], row["l"]] for row in here if row["cluster"] == node], axis=0) for node in outer]
        )
        size = np.array([columns / (columns - 1), rows / (rows - 1)])
        clicks.append((at.mean(axis=0) + (at - at.mean(axis=0)) * size).ravel())
    np.savetxt(work / "clicks.txt", clicks)
    white = {"path": str(task / "white.png"), "fnumber": number}
    whites = [{"path": str(task / f"white_{name}.png"), "fnumber": value} for name, value in known["white"].items()]
    boards = [{"path": str(task / f"{name}.png"), "fnumber": number, "frame": int(name)} for name in known["frames"]]
    images = {"meta": {"debayered": True, "format": 8, "rgb": True}, "whites": [white, *whites], "mask": white}
    (work / "images.js").write_text(json.dumps(images | {"checkerboards": boards}), encoding="utf-8")


def _say(place: Path, command: list[object]) -> None:
    """Run a tool, to whose questions a user answers yes; said.log is what it says."""
    place.mkdir()
    said = subprocess.run(
        [*map(str, command), "-g", "false", "-l", "7"],  # warnings must be on: without them nothing is saved
        input="y\n" * 10_000,
        env=os.environ | {"ARENA_CLICKS": str(place.parent / "clicks.txt")},
        cwd=place,
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=True,
    )
    (place / "said.log").write_text(said.stdout + said.stderr, encoding="utf-8")


def _answer(place: Path) -> dict[str, object]:
    names = {"camera": "intrinsics.js", "poses": "extrinsics.js"}
    answer = {key: json.loads((place / name).read_text(encoding="utf-8")) for key, name in names.items()}
    (errors,) = place.glob("rmse-*.csv")
    of_frames = np.genfromtxt(errors, delimiter=",", names=True)["uv"]
    return answer | {"rms_px": float(np.sqrt(np.mean(np.atleast_1d(of_frames) ** 2)))}
