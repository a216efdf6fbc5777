"""Worker processes: what they import, and what their death costs."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from engine import toy

from pipeline.engine.options import BuildOptions, Caller
from pipeline.engine.running.driver import run
from pipeline.engine.running.engines import Processes
from pipeline.engine.running.session import build, plan_of


def test_a_killed_worker_costs_only_its_task(tmp_path, store):
    graph = toy.graph_of(
        ("killed", "killed", {"folder": str(tmp_path), "times": 1}),
        *((f"slow/{n}", "slow", {"folder": str(tmp_path), "name": str(n), "seconds": 0.1}) for n in range(4)),
    )
    outcome = run(graph, store, BuildOptions(jobs=2))
    assert {result.state for result in outcome.results.values()} == {"executed"}
    assert len(list(tmp_path.glob("ran-*"))) == 4


def test_a_task_that_keeps_killing_its_worker_is_given_up(tmp_path, store):
    graph = toy.graph_of(("killed", "killed", {"folder": str(tmp_path), "times": 9}), ("lens", "lens", {"power": 1.0}))
    outcome = run(graph, store, BuildOptions(jobs=2, keep_going=True))
    failed = outcome.results["killed"]
    assert failed.state == "failed" and "SIGKILL" in failed.error
    assert len(list(tmp_path.glob("death*"))) == 3
    assert outcome.results["lens"].state == "executed"


@pytest.mark.parametrize("stopped_before", [True, False])
def test_a_signal_while_workers_are_ended_is_only_recorded(tmp_path, store, monkeypatch, stopped_before):
    close = Processes.close

    def disturbed(self):
        if not stopped_before:
            os.kill(os.getpid(), signal.SIGINT)
        close(self)

    def stop(event):
        if stopped_before and event.name == "started" and event.task == "rays/cam":
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(Processes, "close", disturbed)
    result = build(toy.project(tmp_path / "out"), BuildOptions(jobs=2), caller=Caller(on_event=stop))
    assert result.exit_code == 130 and result.delivery is None
    assert '"lens": ' in next((store.root / "history").iterdir()).read_text()


def test_a_worker_imports_neither_usd_nor_the_command_line(tmp_path, store):
    outcome = run(toy.graph_of(("probe", "probe", {})), store, BuildOptions(jobs=2))
    entry = outcome.records["probe"].outputs["probe.json"]
    facts = json.loads(store.blob(entry.sha256).read_text())
    imported = {name.split(".")[0] for name in facts["modules"]}
    assert not imported & {"pxr", "typer", "rich", "colour", "networkx", "numpy", "numba"}
    assert "pipeline.cli" not in facts["modules"]
    assert set(facts["threads"].values()) == {"1"}


def test_a_worker_ends_with_its_driver(tmp_path, cache, kit):
    code = (
        "import sys; sys.path[:0] = sys.argv[3:]\n"
        "from pathlib import Path\nfrom engine import toy\nfrom pipeline.engine.options import BuildOptions\n"
        "from pipeline.engine.running.driver import run\n"
        "from pipeline.engine.store.store import Store\nimport os, threading, time\n"
        "task = ('slow', 'slow', {'folder': sys.argv[2], 'name': 'a', 'seconds': 60})\n"
        "def leave():\n    while not list(Path(sys.argv[2]).glob('ran-*')): time.sleep(0.02)\n    os._exit(7)\n"
        "threading.Thread(target=leave).start()\n"
        "run(toy.graph_of(task), Store(sys.argv[1]), BuildOptions(jobs=2))\n"
    )
    paths = [str(kit.parent), str(toy.KIT.parents[1])]
    # The worker inherits stderr: reading it to its end waits for the worker too.
    done = subprocess.run(
        [sys.executable, "-c", code, str(cache), str(tmp_path), *paths], stderr=subprocess.PIPE, timeout=50, check=False
    )
    assert done.returncode == 7


def test_waiting_for_another_builder_is_no_time_of_the_task(tmp_path, store):
    project = toy.project(tmp_path / "out")
    [key] = [task.key for task in plan_of(project) if task.name == "lens"]

    def hold():
        with store.single_flight(key, "holds it"):
            held.set()
            time.sleep(3.0)

    held = threading.Event()
    threading.Thread(target=hold).start()
    held.wait()
    assert build(project, BuildOptions(jobs=2, timeout_s=2.0)).exit_code == 0


def test_ended_workers_leave_nothing_in_the_store(tmp_path, cache):
    assert build(toy.project(tmp_path / "out"), BuildOptions(jobs=2)).exit_code == 0
    assert not list((cache / "tmp").iterdir())
