"""Run the plenoptic half of the arena: programs that calibrate plenoptic cameras, judged against exact truth.

    python examples/06_arena/plenoptic/compete.py [--snapshots FOLDER] [--out build/arena] [--small]
        [--rigs NAME ...] [--flaws NAME ...] [--only NAME ...]

It builds every camera, writes what programs read, lets them work, and writes OUT/plenoptic/results.json and tables.txt,
and OUT/page.html, which has the half of conventional cameras, too, if `arena.py` left its results in OUT.
FOLDER has the sources that are not on a package index, as git repositories OWNER+NAME/repo; a program whose source is
not there, or that fails, is named with the reason. `--small` is one rig with a quarter of its sensor, and what needs no
snapshot. What is there already is not built again.
"""

import argparse
import json
import platform
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import pipeline  # noqa: E402, I001  # before NumPy: then one worker is this process
import numpy as np  # noqa: E402
import baseline  # noqa: E402  # these stand beside this file
import bok  # noqa: E402
import lftoolbox  # noqa: E402
import libpleno  # noqa: E402
import models  # noqa: E402
import nousias  # noqa: E402
import plenopticam  # noqa: E402
import plenoptisign  # noqa: E402
import refocus  # noqa: E402
from cameras import FLAWS, RIGS, Rig, small, stage_text, with_flaw  # noqa: E402
from judging import centre_errors, depth_errors_mm, error_field, pose_errors  # noqa: E402
from task import write_task  # noqa: E402
from truth import Model, Truth, board_from_opencv, truth_of  # noqa: E402
from page import write_page  # noqa: E402
from plenoptic.report import tables  # noqa: E402
from pipeline.exports.noise import Noise  # noqa: E402

Answer = dict[str, Any]
NOISE_PX, NOISY = 0.1, 3
"""Noise of each axis [px] and repeats of the calibration with noise."""
CORNER_PX = 3.0
"""How far a detected corner may be from the true one [px]: micro-images are 23 px wide."""
_REFOCUS_MM = (250.0, 350.0, 450.0, 600.0, 900.0, 2000.0)
_VIEWS_PX = (0.5, 2.0, 4.0)
_SMALL = "paper"


def arguments() -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--snapshots", type=Path, help="folder of sources")
    parser.add_argument("--out", type=Path, default=Path("build/arena"), help="folder of both halves")
    parser.add_argument(
        "--small", action="store_true", help="one rig with a quarter of its sensor, and what needs no snapshot"
    )
    parser.add_argument("--rigs", nargs="+", choices=[rig.name for rig in RIGS])
    parser.add_argument("--flaws", nargs="+", choices=[flaw.name for flaw in FLAWS])
    parser.add_argument("--quick", action="store_true", help="libpleno calibrates from exact rows alone")
    parser.add_argument("--only", nargs="+", choices=["baseline", *CONTESTANTS], metavar="NAME", help="contestants")
    return parser.parse_args()


def main() -> None:
    """Run the command."""
    asked, began = arguments(), time.time()
    out = asked.out.resolve() / "plenoptic"
    names = asked.rigs or ([_SMALL] if asked.small else None)
    kinds = asked.flaws or (["designed"] if asked.small else None)
    rigs = [small(rig) if asked.small else rig for rig in RIGS if names is None or rig.name in names]
    flaws = [flaw for flaw in FLAWS if kinds is None or flaw.name in kinds]
    contestants, missing = prepared(asked, out)
    if asked.quick and "libpleno" in contestants:
        contestants["libpleno"] = partial(contestants["libpleno"], from_images=False)
    about: dict[str, Any] = {"date": time.strftime("%d %B %Y", time.gmtime()), "python": platform.python_version()}
    results: dict[str, Any] = {"about": about}
    results |= {"rigs": {rig.name: rig.what for rig in rigs}, "flaws": {flaw.name: flaw.what for flaw in flaws}}
    results |= {"missing": missing, "cases": {}}
    before_s = with_earlier(results, contestants, out)
    for flaw in flaws:
        for rig in rigs:
            name = f"{rig.name} {flaw.name}"
            print(name, flush=True)
            folder, is_first = out / f"{rig.name}_{flaw.name}", flaw.name == "designed"
            new = case(with_flaw(rig, flaw.name), folder, contestants, has_noise=is_first)
            before = results["cases"].get(name, {"contestants": {}})
            everybody = before["contestants"] | new["contestants"]
            kept = new | before if "plenoptisign" not in contestants else new
            results["cases"][name] = kept | {"contestants": everybody}
            about["wall_s"] = before_s + round(time.time() - began)
            deliver(results, out)
    print(tables(results))
    print(out.parent / "page.html")


def with_earlier(results: dict[str, Any], contestants: dict[str, Any], out: Path) -> int:
    """Keep what earlier runs found of cameras and contestants that this one does not ask; what they took [s]."""
    path = out / "results.json"
    if not path.exists():
        return 0
    earlier = json.loads(path.read_text(encoding="utf-8"))
    for part in ("rigs", "flaws", "cases", "missing"):
        results[part] = earlier[part] | results[part]
    results["missing"] = {name: why for name, why in results["missing"].items() if name not in contestants}
    return int(earlier["about"]["wall_s"])


def deliver(results: dict[str, Any], out: Path) -> None:
    """Write what is known so far: a run of all cameras takes hours."""
    (out / "results.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    (out / "tables.txt").write_text(tables(results), encoding="utf-8")
    write_page(out.parent)


def prepared(asked: argparse.Namespace, out: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Contestants that were built, and why others were not."""
    ready, missing = {}, dict(NOT_RUN)
    for name, (module, _) in CONTESTANTS.items():
        if asked.only and name not in asked.only:
            continue
        if asked.snapshots is None and module is not plenopticam:
            missing[name] = "needs its source: --snapshots FOLDER"
            continue
        try:
            module.build(asked.snapshots and asked.snapshots.resolve(), out / "programs")
            ready[name] = module.run
        except Exception as error:  # whatever a foreign build raises is its reason
            missing[name] = f"cannot be built: {_last_line(error)}"
    return ready, missing


def case(rig: Rig, folder: Path, contestants: dict[str, Any], *, has_noise: bool) -> dict[str, Any]:
    """Build one camera, let everybody work on it, and judge them; also from positions with noise."""
    folder.mkdir(parents=True, exist_ok=True)
    stage = folder / "dataset.usda"
    stage.write_text(stage_text(rig), encoding="utf-8")
    built = pipeline.build(stage, folder / "built", jobs=1)
    if built.failed:
        raise SystemExit(f"{stage}: {built.failed} tasks failed")
    noises = [Noise(noise_px=NOISE_PX, seed=1 + number) for number in range(NOISY)] if has_noise else []
    write_task(built.out, folder / "task", rig.electrons, noises)
    truth = truth_of(rig, stage, built.out)
    thin = baseline.thin_lens_floor(truth)
    floors = {"baseline": thin, "baseline, Bok's model": baseline.projective_floor(truth, thin)}
    judged = {name: floor_judged(truth, floor, len(noises)) for name, floor in floors.items()}
    for name, run in contestants.items():
        if CONTESTANTS[name][0] is plenoptisign:
            continue  # it needs no image
        print(" ", name, flush=True)
        began = time.time()
        try:
            judge = CONTESTANTS[name][1]
            judged[name] = judge(truth, run(folder.parent / "programs", folder / "task"), folder / "task")
        except Exception as error:  # whatever a foreign program raises is its answer
            judged[name] = {"failed": _last_line(error)}
        judged[name]["wall_s"] = round(time.time() - began, 1)
    result: dict[str, Any] = {"contestants": judged}
    if rig.sensor_mm is not None:
        result["refocus"] = refocused(truth, rig, folder.parent / "programs" if "plenoptisign" in contestants else None)
    return result


def floor_judged(truth: Truth, floor: baseline.Floor, noises: int) -> Answer:
    """A model fitted by ourselves, without noise and with it."""
    views, answers = np.arange(len(truth.poses)), []
    for number in range(1 + noises):
        random = np.random.default_rng([7, number])
        fit = baseline.calibrate(truth, floor, truth.boards.noisy(NOISE_PX, random) if number else truth.boards)
        answers.append(calibrated(truth, fit.model, fit.poses, views, fit.rms_px) | {"parameters": fit.parameters})
    true = dict(zip(floor.names, floor.first.tolist(), strict=True))
    return {"exact": answers[0], "true": true} | with_noise(answers[1:])


def with_noise(answers: list[Answer]) -> Answer:
    """What calibrations from positions with noise have in common: errors, and the spread of parameters."""
    if not answers:
        return {}
    values = np.array([list(answer["parameters"].values()) for answer in answers])
    spread = dict(zip(answers[0]["parameters"], values.std(axis=0, ddof=1).tolist(), strict=True))
    errors = ("own_rms_px", "field_px", "outside_px", "chief_px", "marginal_px", "depth_mm", "pose")
    together = {
        name: np.sqrt(np.mean(np.square([answer[name] for answer in answers]), axis=0)).tolist() for name in errors
    }
    return {"noise": together, "spread": spread}


def calibrated(truth: Truth, model: Model, poses: np.ndarray, views: np.ndarray, own_rms_px: float) -> Answer:
    """What a calibration is worth: the residual that it prints, and what is true of it."""
    field = error_field(truth, model)
    part, known = field.rows, field.is_covered
    inside = np.hypot(*(part.image_px - truth.centre_px[part.microlens]).T)
    boards = np.isin(part.view, range(1, len(truth.distances_mm) - 1))
    radius = np.quantile(inside, 2 / 3)
    return {
        "own_rms_px": own_rms_px,
        "distances_mm": truth.distances_mm.tolist(),
        "field_px": [field.rms_px(known & (part.view == number)) for number in range(len(truth.distances_mm))],
        "outside_px": field.rms_px(boards & ~known),
        "chief_px": field.rms_px(boards & known & (inside < radius)),
        "marginal_px": field.rms_px(boards & known & (inside >= radius)),
        "depth_mm": depth_errors_mm(truth, model, field)[:, 0].tolist(),
        "pose": list(pose_errors(truth, poses, views)) if len(views) > 1 else [float("nan")] * 2,
    }


def centres_judged(truth: Truth, answer: Answer, task: Path) -> Answer:
    """Centres against the three things that they may stand for."""
    del task
    return {"centres": centre_errors(answer["centres_px"], true_centres(truth), 0.4 * pitch_px(truth))}


def pitch_px(truth: Truth) -> float:
    """Pitch of the micro-images, about."""
    return float(truth.rig.array["pitch"]) / truth.rig.pixel_mm  # type: ignore[arg-type]


def true_centres(truth: Truth) -> dict[str, np.ndarray]:
    """Of micro-images that lie in the image: the ray through the middle of the stop, the centroid of the light, and the
    projection of the middle of the first-order exit pupil.
    """
    last = np.array(truth.rig.size_px) - 1
    inside = ((truth.centre_px > pitch_px(truth)) & (truth.centre_px < last - pitch_px(truth))).all(axis=1)
    optics = refocus.bench(truth.ready, truth.rig)
    paraxial = truth.vertex_mm * (1 + optics.gap_mm / optics.to_pupil_mm)
    kinds = {
        "centre": truth.centre_px,
        "centroid": truth.centroid_px,
        "exit pupil": truth.ready.rig.tracer.pixels_at(paraxial),
    }
    return {name: np.where(inside[:, None], places, np.nan) for name, places in kinds.items()}


def libpleno_judged(truth: Truth, answer: Answer, task: Path) -> Answer:
    """libpleno's calibrations from exact rows, with noise, and from features of its own."""
    camera = json.loads((task / "task.json").read_text(encoding="utf-8"))["camera"]
    table = np.genfromtxt(task / f"exports/libpleno/{camera}/centers.csv", delimiter=",", names=True)
    index = np.stack([table["k"], table["l"]], axis=1).astype(int)
    rows = models.rows_at(truth.centre_px, np.stack([table["u"], table["v"]], axis=1))

    def judged(calibration: Answer) -> Answer:
        model, written = models.libpleno(calibration["camera"], index, rows), calibration["poses"]["poses"]
        poses = np.array([models.camera_from_board(one["pose"]) for one in written])
        frames = np.array([int(one["frame"]) for one in written])
        poses = poses @ np.linalg.inv(board_from_opencv(truth.rig))
        return calibrated(truth, model, poses, frames - 1, calibration["rms_px"]) | {
            "parameters": models.libpleno_values(calibration["camera"])
        }

    own = {"own": judged(answer["own"])} if "own" in answer else {}
    own |= {"failed": answer["failed"]} if "failed" in answer else {}
    if "corners" in answer:
        own["corners"] = corners_judged(answer["corners"], task / f"exports/libpleno/{camera}", table)
    thin = baseline.thin_lens_floor(truth)
    true = dict(zip(thin.names[:3], thin.first.tolist(), strict=False))
    return {"exact": judged(answer["exact"]), "true": true, **own, **with_noise([*map(judged, answer["noise"])])}


def corners_judged(detected: np.ndarray, export: Path, table: np.ndarray) -> Answer:
    """Corners that libpleno detects in micro-images of each frame, against J, and against J with the fraction of the
    micro-image's centre on top.
    """
    lines = (export / "features.csv").read_text(encoding="utf-8").splitlines()
    exact = np.genfromtxt([line for line in lines if not line.startswith("#")], delimiter=",", names=True)
    centres = {(k, l): (u, v) for k, l, u, v in table.tolist()}
    result = {}
    for frame in np.unique(detected[:, 0]):
        here = exact[exact["frame"] == frame]
        corners = np.stack([here["u"], here["v"]], axis=1)
        fraction = np.mod([centres[pair] for pair in zip(here["k"].tolist(), here["l"].tolist(), strict=True)], 1)
        kinds = {"corner": corners, "with fraction": corners + fraction}
        result[f"{frame:g}"] = centre_errors(detected[detected[:, 0] == frame, 3:], kinds, CORNER_PX)
    return result


def nousias_judged(truth: Truth, answer: Answer, task: Path) -> Answer:
    """Nousias' calibrations from exact rows, and with noise."""
    del task

    def judged(calibration: Answer) -> Answer:
        frames = sorted(calibration["camera_from_target"])
        poses = np.array([calibration["camera_from_target"][frame] for frame in frames])
        poses = poses @ np.linalg.inv(board_from_opencv(truth.rig))
        views, model = np.array([int(frame) for frame in frames]) - 1, models.nousias(calibration, truth.centre_px)
        return calibrated(truth, model, poses, views, calibration["rms_px"]) | {"parameters": calibration["parameters"]}

    floor = baseline.projective_floor(truth, baseline.thin_lens_floor(truth))
    true = dict(zip(floor.names, floor.first.tolist(), strict=True))
    return {"exact": judged(answer["exact"]), "true": true} | with_noise([*map(judged, answer["noise"])])


CONTESTANTS: dict[str, tuple[Any, Callable[[Truth, Answer, Path], Answer]]] = {
    "libpleno": (libpleno, libpleno_judged),
    "Nousias 2017": (nousias, nousias_judged),
    "LFToolbox": (lftoolbox, centres_judged),
    "Bok 2017": (bok, centres_judged),
    "plenopticam": (plenopticam, centres_judged),
    "plenoptisign": (plenoptisign, centres_judged),
}
"""Adapters, and who judges what they return."""
NOT_RUN = {
    "Stepwise c0e36ce": "Octave 7.3: 'xml2struct' undefined; OptimizeCorner.m:160 calls MATLAB's vision.internal",
    "PlenopticImageProcessing f72013a": "nvcc 13.0: Unsupported gpu architecture 'compute_30'; answers in a Qt window",
    "LFToolbox's calibration": "Octave 7.3 has no griddedInterpolant and no detectCheckerboardPoints",
}
"""What was tried by hand and does not run, and the reason."""


def refocused(truth: Truth, rig: Rig, programs: Path | None) -> Answer:
    """Distances of refocusing by rays and formulas, and viewpoints; also by plenoptisign, if `programs` has it."""
    optics = refocus.bench(truth.ready, rig)
    rows = []
    for view in _VIEWS_PX:
        near = refocus.near_axis(truth.ready, truth.centre_px, truth.vertex_mm, optics.pitch_mm, view)
        for z_mm in _REFOCUS_MM:
            shift = np.array([near.shift(z_mm)])
            pupil, thin = (float(optics.distance_mm(shift, p)[0]) for p in (optics.to_pupil_mm, optics.to_rear_mm))
            row = {"view_px": view, "z_mm": z_mm, "shift": float(shift[0]), "pupil_mm": pupil, "thin_mm": thin}
            rows.append(row)
    views = []
    for view in (0.0, 2.0, 4.0):
        place, rms = refocus.viewpoint_mm(truth.ready, truth.centre_px, (view, 0.0))
        views.append({"view_px": view, "place_mm": place.tolist(), "rms_mm": rms})
    if programs is not None:
        pairs = [(row["shift"], row["view_px"]) for row in rows]
        distances, places = plenoptisign.run(programs, optics, pairs, [view["view_px"] for view in views])
        for row, distance in zip(rows, distances, strict=True):
            row["plenoptisign_mm"] = distance
        for row, place_mm in zip(views, places, strict=True):
            row["plenoptisign_mm"] = place_mm
    return {"rows": rows, "entrance_pupil_z_mm": optics.pupil_z_mm, "viewpoints": views}


def _last_line(error: Exception) -> str:
    said = getattr(error, "stderr", None) or str(error)
    text = said.decode(errors="replace") if isinstance(said, bytes) else str(said)
    lines = [line for line in text.strip().splitlines() if line.strip()]
    return f"{type(error).__name__}: {lines[-1][:200]}" if lines else type(error).__name__


if __name__ == "__main__":
    main()
