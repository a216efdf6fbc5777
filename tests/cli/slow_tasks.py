"""Toy tasks that take their time, and waiting for them to begin."""

import time


def started(tmp_path):
    give_up = time.monotonic() + 60
    while not list(tmp_path.glob("ran-*")):
        assert time.monotonic() < give_up
        time.sleep(0.02)


def slow(tmp_path, seconds):
    tasks = [["slow/a", "slow", {"folder": str(tmp_path), "name": "a", "seconds": seconds}]]
    return {"project": {"extra": [*tasks, ["slow/b", "report", {}, {}]], "poses": []}}
