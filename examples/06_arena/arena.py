"""Run the arena: detectors and calibrations of other programs, judged against the exact truth of one camera.

    python examples/06_arena/arena.py [--out build/arena] [--small] [--only NAME ...]

It builds the stages of all conditions, makes an environment for every contestant, lets them work, and writes
results.json, tables.txt, two pictures and page.html. Whoever cannot be installed is named as missing.
"""

import argparse
import json
import platform
import resource
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import pipeline  # noqa: E402, F401, I001  # before NumPy: then one worker is this process, and no build starts another
import calibrating  # noqa: E402  # these stand beside this file
import detecting  # noqa: E402
from conditions import CONDITIONS  # noqa: E402
from drawn import draw  # noqa: E402
from environments import Contestant, Missing, contestants, interpreter  # noqa: E402
from page import write_page  # noqa: E402
from tables import tables  # noqa: E402

REPEATS, NOISY = 3, 6
"""Images of every view, each with noise of its own; repeats of the calibration with noise."""
SMALL = ("sharp", "noise")


def arguments() -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("build/arena"), help="folder that keeps everything")
    parser.add_argument("--small", action="store_true", help="two conditions, two repeats: whether all of it runs")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="contestants whose names contain one of these words")
    return parser.parse_args()


def main() -> None:
    """Run the command."""
    asked, began = arguments(), time.time()
    asked.out.mkdir(parents=True, exist_ok=True)
    out = asked.out.resolve()
    everybody = contestants()
    rows = [one for one in everybody if not asked.only or any(word.lower() in one.name.lower() for word in asked.only)]
    if not rows:
        raise SystemExit(f"no such contestant; there are {', '.join(one.name for one in everybody)}")
    conditions = tuple(one for one in CONDITIONS if not asked.small or one.name in SMALL)
    repeats, noisy = (2, 2) if asked.small else (REPEATS, NOISY)
    detectors, calibrators = ([one for one in rows if one.kind == kind] for kind in ("detector", "calibrator"))
    print("detectors", flush=True)
    of_detectors, missing = detecting.compete(detectors, conditions, out, repeats) if detectors else ({}, [])
    print("calibrators", flush=True)
    of_calibrators, gone, fields = (
        calibrating.compete(calibrators, out, noisy, finder(everybody, out)) if calibrators else ({}, [], {})
    )
    results = {
        "about": about(began, repeats, noisy),
        "conditions": {one.name: one.what for one in conditions},
        "detectors": of_detectors,
        "calibrators": of_calibrators,
        "missing": {one.name: one.reason for one in [*missing, *gone]},
    }
    deliver(*with_earlier(results, fields, out), out)


def with_earlier(results: dict[str, Any], fields: dict[str, Any], out: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Results, and those of contestants whom an earlier run under the same conditions asked and this one did not."""
    place = out / "results.json"
    if not place.exists():
        return results, fields
    earlier = json.loads(place.read_text(encoding="utf-8"))
    if any(earlier["about"][key] != results["about"][key] for key in ("repeats", "noisy")):
        return results, fields
    if earlier["conditions"] != results["conditions"]:
        return results, fields
    asked = asked_for(results)
    for kind in ("detectors", "calibrators", "missing"):
        results[kind] = {name: one for name, one in earlier[kind].items() if name not in asked} | results[kind]
    return results, json.loads((out / "fields.json").read_text(encoding="utf-8")) | fields


def asked_for(results: dict[str, Any]) -> set[str]:
    """Names of all contestants of a run."""
    return {name for kind in ("detectors", "calibrators", "missing") for name in results[kind]}


def finder(everybody: list[Contestant], out: Path) -> tuple[Contestant, Path] | None:
    """Who finds the corners of the case `detected`: SB of OpenCV, if it is there."""
    (who,) = (one for one in everybody if one.name == "OpenCV SB")
    python = interpreter(who, out / "environments")
    return None if isinstance(python, Missing) else (who, python)


def about(began: float, repeats: int, noisy: int) -> dict[str, Any]:
    """Date, machine, and what the run took."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return {
        "date": time.strftime("%d %B %Y", time.gmtime()),
        "python": platform.python_version(),
        "wall_s": round(time.time() - began),
        "cpu_s": round(sum(one.ru_utime + one.ru_stime for one in used)),
        "repeats": repeats,
        "noisy": noisy,
    }


def deliver(results: dict[str, Any], fields: dict[str, Any], out: Path) -> None:
    """Write everything, and print the tables."""
    (out / "results.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    (out / "fields.json").write_text(json.dumps(fields) + "\n", encoding="utf-8")
    text = tables(results)
    (out / "tables.txt").write_text(text, encoding="utf-8")
    print(text)
    drawing = draw(out)
    if isinstance(drawing, Missing):
        print(f"no pictures: {drawing.reason}")
    print(write_page(out))


if __name__ == "__main__":
    main()
