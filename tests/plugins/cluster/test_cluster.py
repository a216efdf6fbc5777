"""A Dask cluster gives the same bytes as this machine alone, also when parts of it die."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from engine import toy

from pipeline.engine.options import BuildOptions
from pipeline.engine.running.driver import run
from pipeline.engine.running.session import build
from pipeline.engine.store.store import Store
from pipeline.errors import EnvironmentFault, UsageError
from pipeline.plugins.cluster.engine import Dask, engine_of


@pytest.mark.parametrize("where", ["", "/no/such/file.json"])
def test_what_is_no_scheduler_is_refused(where):
    with pytest.raises(UsageError, match="hint"):
        engine_of(where)


def test_without_the_extra_the_engine_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(EnvironmentFault, match="cluster"):
        engine_of("tcp://localhost:1")


@pytest.fixture
def extra():
    pytest.importorskip("distributed", reason="the extra [cluster] is not installed")


class Cluster:
    """A scheduler and workers as they are started by hand."""

    def __init__(self, folder, kit) -> None:
        self.file = folder / "scheduler.json"
        path = os.pathsep.join([str(kit.parent), str(toy.KIT.parents[1]), os.environ.get("PYTHONPATH", "")])
        self.environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
        options = ["--port", "0", "--no-dashboard", "--scheduler-file", str(self.file), "--host", "127.0.0.1"]
        self.scheduler = self.start("distributed.cli.dask_scheduler", *options)
        give_up = time.monotonic() + 60
        while not self.file.is_file():
            assert time.monotonic() < give_up
            time.sleep(0.05)
        self.workers = [self.start_worker() for _ in range(2)]

    def start(self, module, *arguments):
        code = f"import sys; from {module} import main; sys.argv[0] = 'dask'; main()"
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen([sys.executable, "-c", code, *arguments], env=self.environment, **quiet)

    def start_worker(self):
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--memory-limit", "0"]
        return self.start("distributed.cli.dask_worker", "--scheduler-file", str(self.file), *options)

    def engine(self, store, packages=("toykit.tasks",), **options):
        return Dask(str(self.file), store, packages, **options)

    def stop(self) -> None:
        for process in [*self.workers, self.scheduler]:
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path, kit, extra):
    cluster = Cluster(tmp_path, kit)
    yield cluster
    cluster.stop()


def test_the_same_manifest_as_here_also_with_a_worker_killed_and_a_second_build_runs_nothing(tmp_path, cluster, store):
    slow = [(f"slow/{n}", "slow", {"folder": str(tmp_path), "name": str(n), "seconds": 0.3}) for n in range(6)]
    project = toy.project(tmp_path / "out", extra=slow)

    def kill() -> None:
        while not list(tmp_path.glob("ran-*")):
            time.sleep(0.02)
        os.kill(cluster.workers[0].pid, signal.SIGKILL)

    threading.Thread(target=kill).start()
    result = build(project, engine=lambda store, packages: cluster.engine(store))
    assert result.exit_code == 0 and cluster.workers[0].wait() == -signal.SIGKILL
    here = build(toy.project(tmp_path / "here", extra=slow), BuildOptions(jobs=2), store=Store(tmp_path / "fresh"))
    assert toy.contents(result.out) == toy.contents(here.out)
    assert build(project, engine=lambda store, packages: cluster.engine(store)).executed == 0


def test_failures_come_back_with_log_and_spec(tmp_path, cluster, store):
    graph = toy.graph_of(("fail", "fail", {"flag": str(tmp_path / "no")}))
    failed = run(graph, store, engine=cluster.engine(store)).results["fail"]
    assert failed.state == "failed" and "ValueError: the flag is not there" in failed.error
    assert failed.spec and "about to look" in (store.root / failed.log).read_text()


def test_a_cluster_that_lost_all_its_workers_is_waited_for_and_then_given_up(cluster, store, monkeypatch):
    engine = cluster.engine(store)
    monkeypatch.setattr("pipeline.plugins.cluster.engine._NO_WORKERS_S", 1.0)
    for worker in cluster.workers:
        worker.kill()
    with pytest.raises(EnvironmentFault, match="no worker for"):
        for _ in range(100):
            assert engine.wait(0.1) == []


@pytest.mark.heavy
def test_a_scheduler_that_dies_ends_with_what_was_finished(tmp_path, cluster, store, monkeypatch):
    monkeypatch.setattr("pipeline.plugins.cluster.engine._CONNECT_S", 2)
    slow = [(f"slow/{n}", "slow", {"folder": str(tmp_path), "name": str(n), "seconds": 0.2}) for n in range(30)]
    graph = toy.graph_of(*slow)

    def kill() -> None:
        while len(list(tmp_path.glob("ran-*"))) < 5:
            time.sleep(0.02)
        cluster.scheduler.kill()

    threading.Thread(target=kill).start()
    with pytest.raises(EnvironmentFault, match="scheduler is gone"):
        run(graph, store, engine=cluster.engine(store))
    again = run(graph, store, BuildOptions(jobs=2))
    states = [result.state for result in again.results.values()]
    assert states.count("cached") >= 2 and set(states) == {"cached", "executed"}


@pytest.mark.heavy
def test_a_worker_with_other_code_refuses(tmp_path, cluster, store, kit):
    graph = toy.graph_of(("lens", "lens", {"power": 1.0}))
    cluster.workers[0].kill()
    run(graph, store, engine=cluster.engine(store))
    engine = cluster.engine(store)
    (kit / "tasks" / "lens.py").write_text("def run(params, inputs, out):\n    (out / 'x').write_text('other')\n")
    result = run(graph, store, engine=engine).results["lens"]
    assert result.state == "failed" and result.machine and "edited after this process" in result.error


@pytest.mark.heavy
def test_a_task_that_takes_too_long_is_given_up_also_while_others_end_all_the_time(tmp_path, cluster, store):
    tasks = [("slow/a", 30), *((f"slow/b{number}", 0.1) for number in range(30))]
    graph = toy.graph_of(*((n, "slow", {"folder": str(tmp_path), "name": n[5:], "seconds": s}) for n, s in tasks))
    results = run(graph, store, BuildOptions(keep_going=True), engine=cluster.engine(store, timeout_s=1.0)).results
    assert results["slow/a"].state == "failed" and "longer than 1 s" in results["slow/a"].error
    assert results["slow/a"].seconds < 2


def test_a_scheduler_that_is_not_there_is_the_machines_fault(extra, store, monkeypatch):
    monkeypatch.setattr("pipeline.plugins.cluster.engine._CONNECT_S", 1)
    with pytest.raises(EnvironmentFault, match="cannot reach"):
        Dask("tcp://127.0.0.1:1", store, ("toykit.tasks",))
