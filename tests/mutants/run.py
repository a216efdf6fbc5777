"""Do the tests notice mistakes? `make mutants N=40 SEED=1`: break the program on purpose, one small mistake at a time.

Mistakes are drawn from all that `mutations` knows in the rooms of optics, truth and targets, by the seed alone. Each is
made in a copy of the tree, where the nearest tests of its room run until the first fails: those that reach the module
through the fewest imports.
A mistake that no test notices survives, and is printed with its line: README.md beside this file argues about each.

Golden files are left out: they say that something changed, not that it is wrong.
"""

import argparse
import functools
import itertools
import json
import os
import random
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from mutants.mutations import mutants, parses
from mutants.sandbox import ROOMS, ROOT, TOO_LATE, Sandbox, Site, Verdict

FOLDER = ROOT / "build" / "mutants"
"""Copies of the tree, one per job, and the verdicts so far."""
VERDICTS = FOLDER / "verdicts.jsonl"


def draw(rooms: list[str], count: int, seed: int, root: Path = ROOT) -> list[Site]:
    """Mistakes of some rooms, without repetition; any one is as likely as another."""
    files = [path.relative_to(root) for room in rooms for path in sorted((root / "pipeline" / room).rglob("*.py"))]
    sites = [Site(file, mutant) for file in files for mutant in mutants((root / file).read_text(encoding="utf-8"))]
    random.Random(seed).shuffle(sites)
    return list(itertools.islice((site for site in sites if parses(site.mutant)), count))


def judge_all(sites: list[Site], jobs: int, nearest: int) -> list[Verdict]:
    """Verdicts, printed as they come; first those for which no kernel needs to be compiled again."""
    idle: SimpleQueue[Sandbox] = SimpleQueue()
    for job in range(jobs):
        idle.put(Sandbox(FOLDER / str(job), nearest))

    def one(site: Site, look: Callable[[Sandbox, Site], Verdict | None]) -> Verdict | None:
        sandbox = idle.get()
        try:
            verdict = look(sandbox, site)
        finally:
            idle.put(sandbox)
        if verdict:
            print(_lines(verdict), flush=True)
            with VERDICTS.open("a", encoding="utf-8") as file:
                file.write(json.dumps([*_key(site), verdict.noticed_by, verdict.seconds]) + "\n")
        return verdict

    kernels = [site for site in sites if site.mutant.in_kernel]
    verdicts: list[Verdict] = []
    with ThreadPoolExecutor(jobs) as pool:
        for some, look in (
            ([site for site in sites if not site.mutant.in_kernel], Sandbox.judge),
            (kernels, Sandbox.glance),
            (kernels, Sandbox.judge),
        ):
            known = {_key(verdict.site) for verdict in verdicts}
            open_ = [site for site in some if _key(site) not in known]
            verdicts += filter(None, pool.map(functools.partial(one, look=look), open_))
    return verdicts


def judged(sites: list[Site], text: str) -> list[Verdict]:
    """Verdicts of an earlier run on some of these mistakes, from its file; where it was cut off, its last line is."""
    rows = [json.loads(line) for line in text.split("\n")[:-1]]
    known = {tuple(row[:4]): row[4:] for row in rows}
    return [Verdict(site, *known[_key(site)]) for site in sites if _key(site) in known]


def _key(site: Site) -> tuple[str, int, str, str]:
    return (str(site.file), *site.mutant.place)


def _lines(verdict: Verdict) -> str:
    line, before, after = verdict.site.mutant.place
    fate = f"killed by {verdict.noticed_by}" if verdict.noticed_by else "SURVIVED"
    fate = "NOT JUDGED IN TIME" if verdict.noticed_by.startswith(TOO_LATE) else fate
    return f"{verdict.site.file}:{line}: {fate} ({verdict.seconds:.0f} s)\n    - {before}\n    + {after}"


def main() -> int:
    """Print a verdict per mistake, and how many survived."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=40, help="how many mistakes")
    parser.add_argument("--seed", type=int, default=1, help="which ones")
    parser.add_argument("--rooms", nargs="+", choices=ROOMS, default=list(ROOMS), help="where")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="how many at a time")
    parser.add_argument("--nearest", type=int, default=4, help="how many test files may notice each")
    parser.add_argument("--only", metavar="FILE:LINE", nargs="+", help="of those drawn, only the ones in these places")
    parser.add_argument("--resume", action="store_true", help="go on with a run of the same tree that was stopped")
    options = parser.parse_args()
    start, sites = time.monotonic(), draw(options.rooms, options.count, options.seed)
    if options.only:
        sites = [site for site in sites if f"{site.file}:{site.mutant.place[0]}" in options.only]
    FOLDER.mkdir(parents=True, exist_ok=True)
    if not options.resume:
        VERDICTS.write_text("", encoding="utf-8")
    verdicts = judged(sites, VERDICTS.read_text(encoding="utf-8")) if VERDICTS.exists() else []
    known = {_key(verdict.site) for verdict in verdicts}
    verdicts += judge_all([site for site in sites if _key(site) not in known], options.jobs, options.nearest)
    survivors = [verdict for verdict in verdicts if not verdict.noticed_by]
    minutes = (time.monotonic() - start) / 60
    late = sum(verdict.noticed_by.startswith(TOO_LATE) for verdict in verdicts)  # a busy machine may be late, too
    noticed = len(verdicts) - len(survivors) - late
    print(
        f"\n{len(verdicts)} mistakes, {noticed} noticed, {late} not judged in time, {len(survivors)} survived;", end=" "
    )
    print(f"seed {options.seed}, {minutes:.0f} minutes. Survivors:")
    for verdict in sorted(survivors, key=lambda one: (str(one.site.file), one.site.mutant.place)):
        print(_lines(verdict))
    return 0


if __name__ == "__main__":
    sys.exit(main())
