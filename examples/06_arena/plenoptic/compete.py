"""The plenoptic half of the arena: programs that calibrate plenoptic cameras, judged against exact truth."""

import hashlib
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import baseline
import bok
import lftoolbox
import libpleno
import models
import nousias
import numpy as np
import plenopticam
import plenoptictoolbox
import plenoptisign
import refocus
import twin
from cameras import Rig, write_stage
from environments import Failed
from judging import Answer, Calibration, centre_errors, disparity_errors, judged, types_right
from task import write_task
from truth import NOISE_PX, Model, Truth, from_opencv, read_table, truth_of

import pipeline
from pipeline.exports.noise import Noise

CORNER_PX = 3.0
"""How far a detected corner may be from the true one [px]: micro-images are 23 px wide."""


def prepared(names: list[str], snapshots: Path | None, programs: Path) -> tuple[list[str], dict[str, str]]:
    """Contestants that were built, of those asked, and why others were not."""
    ready, missing = [], dict(NOT_RUN)
    for name in names:
        module, _ = CONTESTANTS[name]
        if snapshots is None and module not in (plenopticam, plenoptisign, twin):
            missing[name] = "needs its source: --snapshots FOLDER"
            continue
        try:
            module.build(snapshots, programs)
            ready.append(name)
        except Exception as error:  # whatever a foreign build raises is its reason
            missing[name] = f"cannot be built: {type(error).__name__}: {error}"
    return ready, missing


def case(rig: Rig, folder: Path, names: list[str], *, noisy: int, has_images: bool) -> dict[str, Any]:
    """Build one camera, let everybody work on it, and judge them; also from so many positions with noise, and libpleno
    from features of its own. Nothing is rendered or exported where only rows are asked for."""
    folder.mkdir(parents=True, exist_ok=True)
    stage = folder / "dataset.usda"
    write_stage(rig, stage)
    reads_files = not set(names) <= ROWS_ALONE
    print("  images and truth" if reads_files else "  truth", flush=True)
    built = pipeline.build(stage, folder / "built", jobs=1, pictures=reads_files)
    if built.failed:
        raise SystemExit(f"{stage}: {built.failed} tasks failed")
    truth = truth_of(rig, stage, built.out)
    result: dict[str, Any] = {"contestants": {}}
    facts: Answer = {"noisy": noisy}
    if rig.sensor_mm is not None:
        result["refocus"] = refocus.refocused(truth)
        facts |= refocus.asked(truth, result["refocus"])
    if reads_files:
        facts = _task(truth, built.out, folder / "task", facts | {"has_images": has_images})
    result["contestants"] |= floors_judged(truth, folder, noisy)
    for name in names:
        module, judge = CONTESTANTS[name]
        if module is plenoptisign and "refocus" not in result:
            continue
        print(" ", name, flush=True)
        began = time.time()
        try:
            answer = judge(
                truth, module.run(folder.parent / "programs", folder / "task", facts), folder / "task", facts
            )
        except Exception as error:  # whatever a foreign program raises is its answer
            answer = {"failed": str(error) if isinstance(error, Failed) else f"{type(error).__name__}: {error}"}
        result["contestants"][name] = answer | {"wall_s": round(time.time() - began, 1)}
    return result


def _task(truth: Truth, built: Path, task: Path, facts: Answer) -> Answer:
    """Images, exports and all else that programs read, in a folder; returns what task.json has."""
    print("  exports", flush=True)
    task.mkdir(exist_ok=True)
    if truth.rig.sensor_mm is not None:
        np.save(task / "coded.npy", refocus.coded_image(truth))
    of_hexagons = ["bok", "raytrix"] if len(truth.rig.focal_mm) == 3 else ["bok"]  # whose formats know no squares
    formats = ["libpleno", *(of_hexagons if truth.rig.layout == "hexagonal" else [])]
    noises = [Noise(noise_px=NOISE_PX, seed=1 + number) for number in range(facts["noisy"])]
    return write_task(built, task, truth.rig.electrons, noises, facts | {"formats": formats})


def floors_judged(truth: Truth, folder: Path, noisy: int) -> dict[str, Answer]:
    """Both floors; kept in `folder`, so that one more contestant does not fit them to the same rows again."""
    rows = [array.tobytes() for array in (truth.boards.view, truth.boards.microlens, truth.boards.image_px)]
    digest = hashlib.sha256(b"".join([*rows, str(noisy).encode()])).hexdigest()
    kept = folder / f"floors-{digest[:16]}.json"
    if not kept.exists():
        print("  baselines", flush=True)
        thin = baseline.thin_lens_floor(truth)
        floors = {"baseline": thin, "baseline, Bok's model": baseline.projective_floor(truth, thin)}
        answers = {name: floor_judged(truth, floor, noisy) for name, floor in floors.items()}
        kept.write_text(json.dumps(answers), encoding="utf-8")
    return json.loads(kept.read_text(encoding="utf-8"))


def floor_judged(truth: Truth, floor: baseline.Floor, noisy: int) -> Answer:
    """A model fitted by ourselves, without noise and with it."""
    exact, *repeats = (baseline.calibrate(truth, floor, rows) for rows in (truth.boards, *truth.noisy(NOISE_PX, noisy)))
    return judged(truth, {"exact": exact}, repeats, floor.true)


def centres_judged(truth: Truth, answer: Answer, task: Path, facts: Answer) -> Answer:
    """Centres against the three things that they may stand for."""
    return {"centres": centre_errors(answer["centres_px"], true_centres(truth), 0.4 * facts["pitch_px"])}


def plenopticam_judged(truth: Truth, answer: Answer, task: Path, facts: Answer) -> Answer:
    """Its centres, and where the rays of its views meet against those of the views that they are to be."""
    rows = []
    for aside, view_px, spread_px in answer["views"]:
        found, true = (refocus.viewpoint_mm(truth.ready, truth.centre_px, view)[0] for view in (view_px, (aside, 0.0)))
        row = {"view_px": aside, "takes_px": view_px, "spread_px": spread_px, "off_mm": (found - true).tolist()}
        rows.append(row)
    return centres_judged(truth, answer, task, facts) | ({"views": rows} if rows else {})


def true_centres(truth: Truth) -> dict[str, np.ndarray]:
    """Of micro-images that lie in the image: the ray through the middle of the stop, the centroid of the light, and the
    projection of the middle of the first-order exit pupil.
    """
    last, pitch_px = np.array(truth.rig.size_px) - 1, truth.rig.pitch_mm / truth.rig.pixel_mm
    inside = ((truth.centre_px > pitch_px) & (truth.centre_px < last - pitch_px)).all(axis=1)
    optics = refocus.bench(truth)
    paraxial = truth.vertex_mm * (1 + optics.gap_mm / optics.to_pupil_mm)
    kinds = {
        "centre": truth.centre_px,
        "centroid": truth.centroid_px,
        "exit pupil": truth.ready.rig.tracer.pixels_at(paraxial),
    }
    return {name: np.where(inside[:, None], places, np.nan) for name, places in kinds.items()}


def _calibration(truth: Truth, answer: Answer, model: Model, parameters: dict[str, float]) -> Calibration:
    """A calibration whose poses are those of the board as OpenCV has it."""
    poses = answer["poses"] @ np.linalg.inv(from_opencv(truth.rig))
    return Calibration(model, parameters, poses, np.array(answer["frames"], int) - 1, answer["rms_px"])


def libpleno_judged(truth: Truth, answer: Answer, task: Path, facts: Answer) -> Answer:
    """libpleno's calibrations from exact rows, with noise, and from features of its own."""
    export = task / "exports/libpleno" / facts["camera"]
    table = read_table(export / "centers.csv")
    index = np.stack([table["k"], table["l"]], axis=1).astype(int)
    rows = models.rows_at(truth.centre_px, np.stack([table["u"], table["v"]], axis=1))

    def calibration(one: Answer) -> Calibration:
        camera = one["camera"]
        return _calibration(truth, one, models.libpleno(camera, index, rows), models.libpleno_values(camera))

    kinds = {kind: calibration(answer[kind]) for kind in ("exact", "unmirrored", "own") if kind in answer}
    true_mm = np.array(truth.rig.focal_mm)[truth.ready.rig.tracer.lattice.type]
    count = len(truth.rig.focal_mm)
    types = models.libpleno_types(count, index, rows)
    true = dict(list(baseline.thin_lens_floor(truth).true.items())[:3])
    true |= {f"f{number}_mm": float(np.median(true_mm[types == number])) for number in range(count)}
    result = judged(truth, kinds, [*map(calibration, answer["noise"])], true)
    if count > 1:
        focals_mm = {kind: np.ravel(answer[kind]["camera"]["mla"]["focal_lengths"]).astype(float) for kind in kinds}
        result["types"] = {
            kind: types_right(np.where(types >= 0, values[types], np.nan), true_mm)
            for kind, values in focals_mm.items()
        }
    if "corners" in answer:
        result["corners"] = corners_judged(answer["corners"], read_table(export / "features.csv"), table)
    return result | ({"failed": answer["failed"]} if "failed" in answer else {})


def corners_judged(detected: np.ndarray, exact: np.ndarray, table: np.ndarray) -> Answer:
    """Corners that libpleno detects in micro-images of each frame, against J, and against J with the fraction of the
    micro-image's centre on top.
    """
    centres = {(k, l): (u, v) for k, l, u, v in table.tolist()}
    result = {}
    for frame in np.unique(detected[:, 0]):
        here = exact[exact["frame"] == frame]
        corners = np.stack([here["u"], here["v"]], axis=1)
        fraction = np.mod([centres[pair] for pair in zip(here["k"].tolist(), here["l"].tolist(), strict=True)], 1)
        kinds = {"corner": corners, "with fraction": corners + fraction}
        result[f"{frame:g}"] = centre_errors(detected[detected[:, 0] == frame, 3:], kinds, CORNER_PX)
    return result


def nousias_judged(truth: Truth, answer: Answer, task: Path, facts: Answer) -> Answer:
    """Nousias' calibrations from exact rows, and with noise."""

    def calibration(one: Answer) -> Calibration:
        model = models.projective(np.array([*one["parameters"].values()]), truth.centre_px)
        return _calibration(truth, one, model, one["parameters"])

    floor = baseline.projective_floor(truth, baseline.thin_lens_floor(truth))
    return judged(truth, {"exact": calibration(answer["exact"])}, [*map(calibration, answer["noise"])], floor.true)


def disparity_judged(truth: Truth, answer: Answer, task: Path, facts: Answer) -> Answer:
    """Disparities at the corners of one board."""
    rows = truth.boards.only(truth.boards.view == answer["frame"] - 1)
    found = answer["centre_px"], answer["disparity_px"]
    return {"disparity": disparity_errors(rows, truth.centre_px, facts["pitch_px"], *found)}


def unjudged(truth: Truth, answer: Answer, task: Path, facts: Answer) -> Answer:
    """Numbers that the tables show beside the truth."""
    return answer


CONTESTANTS: dict[str, tuple[Any, Callable[[Truth, Answer, Path, Answer], Answer]]] = {
    "libpleno": (libpleno, libpleno_judged),
    "Nousias 2017": (nousias, nousias_judged),
    "LFToolbox": (lftoolbox, centres_judged),
    "Bok 2017": (bok, centres_judged),
    "plenopticam": (plenopticam, plenopticam_judged),
    "PlenopticToolbox": (plenoptictoolbox, disparity_judged),
    "plenoptisign": (plenoptisign, unjudged),
    "twin": (twin, twin.twin_judged),
}
"""Adapters, and who judges what they return."""
ROWS_ALONE = {"twin"}
"""Contestants who read no files of a build: for them nothing is rendered or exported."""
NOT_RUN = {
    "Stepwise c0e36ce": "Octave 7.3: 'xml2struct' undefined; OptimizeCorner.m:160 calls MATLAB's vision.internal",
    "PlenopticImageProcessing f72013a": "nvcc 13.0: Unsupported gpu architecture 'compute_30'; answers in a Qt window",
    "LFToolbox's calibration": "Octave 7.3 has no griddedInterpolant and no detectCheckerboardPoints",
    "Bok's calibration": "its lines in micro-images, the third step, were not seen to end in Octave 7.3",
    "Nousias' own corners": "detectHarrisFeatures is MATLAB's; without it 5.6 s per micro-image, an hour per board",
}
"""What was tried by hand and does not run, and the reason."""
