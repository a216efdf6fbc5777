"""`make faults`: every fault at every place, on the real pipeline at small size; prints a table.

Exit code 1 if a result was wrong or a store was damaged. `--short` does a few of each, as the tests do.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1])]

from pipeline.machine.processor import pin

pin()  # before NumPy is imported: otherwise every build starts workers

from faults.catalogue import FAULTS, SHORT  # noqa: E402
from faults.workbench import Row, Workbench  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--only", metavar="N", type=int, nargs="*", help="numbers of rows, from 0")
    parser.add_argument("--soak", metavar="SECONDS", type=float, default=60.0, help="how long R9 goes on")
    chosen = parser.parse_args()
    short = chosen.short
    rows: list[Row] = []
    print(f"{'':11} {'fault':70} {'tried':>6} {'failed':>6} {'wrong':>6} {'bad':>4} {'s':>6}")
    with tempfile.TemporaryDirectory() as folder:
        bench = Workbench(Path(folder), whole=not short, soak_s=3.0 if short else chosen.soak)
        for fault in [FAULTS[n] for n in chosen.only or (SHORT if short else range(len(FAULTS)))]:
            start = time.monotonic()
            row = fault(bench)
            rows.append(row)
            counts = f"{row.tried:6} {row.failed:6} {row.wrong:6} {row.bad:4} {time.monotonic() - start:6.1f}"
            print(f"{row.number:11} {row.fault:70} {counts} {'; '.join(row.notes)}", flush=True)
    wrong, bad = sum(row.wrong for row in rows), sum(row.bad for row in rows)
    print(f"{sum(row.tried for row in rows)} faults: {wrong} wrong results, {bad} damaged stores")
    print("failed: builds that ended with an error that says so. R17: tasks read the store only. R18: no remote store.")
    print("R22: tests/cli too. R23: tests/rerun/test_attributes.py.")
    return 1 if wrong or bad else 0


if __name__ == "__main__":
    sys.exit(main())
