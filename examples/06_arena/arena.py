"""Run the arena: detectors and calibrations of other programs, judged against the exact truth of simulated cameras.

    python examples/06_arena/arena.py [conventional | plenoptic] [--out build/arena] [--small] [--only NAME ...]
        [--snapshots FOLDER] [--rigs NAME ...] [--flaws NAME ...] [--quick] [--sources]

It builds the stages, makes an environment for every contestant, lets them work, and writes results.json and tables.txt
of each half, two pictures and page.html. Whoever cannot be installed or built is named as missing, with the reason.
What was built or answered before is not done again, and results of contestants who are not asked are kept.

Most plenoptic programs are on no package index: FOLDER has their sources, as git repositories OWNER+NAME/repo, which
`--sources` lists with their commits.
`--small` shows in minutes whether it runs: two conditions and two repeats, five boards, exact and with noise;
one rig with a quarter of its sensor.
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
sys.path[:0] = [str(HERE), str(HERE / "plenoptic")]

import pipeline  # noqa: E402, F401, I001  # before NumPy: then one worker is this process, and no build starts another
import calibrating  # noqa: E402  # these stand beside this file
import compete  # noqa: E402
import detecting  # noqa: E402
import tables  # noqa: E402
from cameras import FLAWS, RIGS, small, with_flaw  # noqa: E402
from conditions import CONDITIONS  # noqa: E402
from environments import CONTESTANTS, Contestant, Failed, called, contestants, interpreter  # noqa: E402
from page import write_page  # noqa: E402
from snapshots import SOURCES  # noqa: E402

Results = dict[str, Any]
HALVES = ["conventional", "plenoptic"]
REPEATS, NOISY, PLENOPTIC_NOISY = 3, 6, 3
"""Images of every view, each with noise of its own; repeats of the calibration with noise, of either half."""
SMALL = ("sharp", "noise")


def arguments() -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("half", nargs="?", choices=HALVES, help="which cameras; without it both")
    parser.add_argument("--out", type=Path, default=Path("build/arena"), help="folder that keeps everything")
    parser.add_argument("--small", action="store_true", help="whether all of it runs")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="contestants whose names contain one of these words")
    parser.add_argument("--snapshots", type=Path, help="folder of sources")
    parser.add_argument("--sources", action="store_true", help="list what FOLDER must hold, and end")
    parser.add_argument("--rigs", nargs="+", choices=[rig.name for rig in RIGS], help="some plenoptic cameras")
    parser.add_argument("--flaws", nargs="+", choices=FLAWS, help="some of their flaws")
    parser.add_argument("--quick", action="store_true", help="libpleno calibrates from exact rows alone")
    return parser.parse_args()


def main() -> None:
    """Run the command."""
    asked = arguments()
    if asked.sources:
        print(*(f"{name} {commit}" for name, commit in SOURCES.items()), sep="\n")
        return
    out = asked.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    everybody = contestants()
    names = chosen(asked, [one.name for one in everybody if one.kind != "painter"] + [*compete.CONTESTANTS])
    halves = [asked.half] if asked.half else HALVES
    if "conventional" in halves:
        conventional(asked, everybody, [one for one in everybody if one.name in names], out)
    if "plenoptic" in halves:
        plenoptic(asked, [name for name in compete.CONTESTANTS if name in names], out)


def chosen(asked: argparse.Namespace, names: list[str]) -> list[str]:
    """Contestants that the command line asks for."""
    some = [name for name in names if not asked.only or any(word.lower() in name.lower() for word in asked.only)]
    if not some and asked.only != ["baseline"]:  # who is always there
        raise SystemExit(f"no such contestant; there are {', '.join(names)}")
    return some


def conventional(asked: argparse.Namespace, everybody: list[Contestant], rows: list[Contestant], out: Path) -> None:
    """The half of conventional cameras."""
    began = time.time()
    conditions = tuple(one for one in CONDITIONS if not asked.small or one.name in SMALL)
    repeats, noisy = (2, 2) if asked.small else (REPEATS, NOISY)
    detectors, calibrators = ([one for one in rows if one.kind == kind] for kind in ("detector", "calibrator"))
    results: Results = {"about": about(began), "conditions": {one.name: one.what for one in conditions}}
    results["about"] |= {"repeats": repeats, "noisy": noisy}
    results |= {"detectors": {}, "calibrators": {}, "missing": {}}
    fields: Results = {}
    if detectors:
        results["detectors"], results["missing"] = detecting.compete(detectors, conditions, out, repeats)
    if calibrators:
        (sb,) = (one for one in everybody if one.name == "OpenCV SB")  # finds the corners of the case `detected`
        detector = None if asked.small else (sb, interpreter(sb, out / "environments"))
        judged, gone, fields = calibrating.compete(calibrators, out, noisy, detector)
        results |= {"calibrators": judged, "missing": results["missing"] | gone}
    results["about"] |= about(began)
    earlier = _read(out / "results.json")
    is_same = earlier.get("conditions") == results["conditions"] and all(
        earlier["about"][key] == results["about"][key] for key in ("repeats", "noisy")
    )
    if is_same:
        kinds = ("detectors", "calibrators", "missing")
        known = {name for kind in kinds for name in results[kind]}
        for kind in kinds:
            earlier[kind] = {name: one for name, one in earlier[kind].items() if name not in known}
        results, fields = merged(earlier, results, 2), _read(out / "fields.json") | fields
    (out / "fields.json").write_text(json.dumps(fields) + "\n", encoding="utf-8")
    deliver(results, tables.conventional(results), out)
    try:
        (painter,) = (one for one in everybody if one.kind == "painter")
        called([interpreter(painter, out / "environments"), CONTESTANTS / painter.script, out])
    except Failed as error:
        print(f"no pictures: {error}")
    print(write_page(out))


def plenoptic(asked: argparse.Namespace, names: list[str], out: Path) -> None:
    """The half of plenoptic cameras; what is known is delivered after each, as all of them take hours."""
    began, place = time.time(), out / "plenoptic"
    place.mkdir(exist_ok=True)
    rigs = [
        rig for rig in RIGS if rig.name in (asked.rigs or (["paper"] if asked.small else [one.name for one in RIGS]))
    ]
    flaws = asked.flaws or (["designed"] if asked.small else [*FLAWS])
    snapshots = asked.snapshots and asked.snapshots.resolve()
    ready, missing = compete.prepared(names, snapshots, place / "programs")
    earlier = _read(place / "results.json")
    for flaw in flaws:
        for rig in map(small, rigs) if asked.small else rigs:
            name = f"{rig.name} {flaw}"
            print(name, flush=True)
            is_first = flaw == "designed"
            folder, noisy = place / name.replace(" ", "_"), PLENOPTIC_NOISY if is_first else 0
            has_images = is_first and not asked.quick
            case = compete.case(with_flaw(rig, flaw), folder, ready, noisy=noisy, has_images=has_images)
            results = {"about": about(began), "rigs": {rig.name: rig.what}, "flaws": {flaw: FLAWS[flaw]}}
            earlier = merged(earlier, results | {"cases": {name: case}, "missing": missing}, 4)
            earlier["missing"] = {who: why for who, why in earlier["missing"].items() if who not in ready}
            deliver(earlier, tables.plenoptic(earlier), place)
            print(write_page(out))


def merged(earlier: Results, later: Results, depth: int) -> Results:
    """Both, the later one first; dictionaries of so many levels are merged themselves."""
    if depth == 0:
        return later
    both = earlier.keys() & later.keys()
    parts = {key: merged(earlier[key], later[key], depth - 1) for key in both if isinstance(later[key], dict)}
    return earlier | later | parts


def _read(path: Path) -> Results:
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def about(began: float) -> Results:
    """Date, machine, and what the run took, as far as it has come."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return {
        "date": time.strftime("%d %B %Y", time.gmtime()),
        "python": platform.python_version(),
        "wall_s": round(time.time() - began),
        "cpu_s": round(sum(one.ru_utime + one.ru_stime for one in used)),
    }


def deliver(results: Results, made: list[tables.Table], place: Path) -> None:
    """Write results and tables, and print the tables."""
    (place / "results.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    text = tables.text(made)
    (place / "tables.txt").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
