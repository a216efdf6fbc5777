"""The driver loop: failures, force, prepare, healing."""

import pytest
from engine import toy

from pipeline.engine.options import ALONE, BuildOptions, Caller
from pipeline.engine.running.driver import run
from pipeline.engine.running.session import build


def test_keep_going_runs_all_that_does_not_need_the_failed_task(tmp_path):
    extra = [("fail", "fail", {"flag": str(tmp_path / "no")}), ("report/fail", "report", {}, {"a": "fail"})]
    broken = toy.project(tmp_path / "out", extra=extra)
    result = build(broken, BuildOptions(jobs=1, keep_going=True))
    assert (result.executed, result.failed, result.count("skipped")) == (5, 1, 1)
    assert result.exit_code == 1 and result.delivery is None
    assert not (tmp_path / "out").exists()


def test_without_keep_going_nothing_is_started_after_a_failure(tmp_path, store):
    first = ("a", "fail", {"flag": str(tmp_path / "no")})
    graph = toy.graph_of(first, *((f"lens/{n}", "lens", {"power": float(n)}) for n in range(5)))
    states = {name: result.state for name, result in run(graph, store).results.items()}
    assert states["a"] == "failed" and set(states.values()) == {"failed", "skipped"}


def test_prepare_is_called_once_and_only_if_something_runs(tmp_path):
    calls = []
    for _ in range(2):
        build(toy.project(tmp_path / "out"), ALONE, caller=Caller(prepare=lambda: calls.append(1)))
    assert calls == [1]


def test_a_forced_task_runs_and_its_readers_are_saved_by_early_cutoff(tmp_path):
    build(toy.project(tmp_path / "out"), ALONE)
    again = build(toy.project(tmp_path / "out"), BuildOptions(jobs=1, force=("rays",)))
    assert toy.executed(again) == {"rays/cam"}


def test_a_full_disk_is_the_machines_fault_and_stops_the_build(tmp_path):
    graph = toy.graph_of(("full", "full", {}), ("report", "report", {}), ("lens", "lens", {"power": 1.0}))
    result = build(toy.bare(graph, tmp_path / "out"), BuildOptions(jobs=1, keep_going=True))
    assert result.exit_code == 5 and result.failed == 1 and result.count("skipped") == 2
    (failure,) = result.failures
    assert "No space left" in failure.error
    assert "at least 1 bytes needed" in failure.error and "bytes free on that disk" in failure.error


def test_a_link_is_no_output(tmp_path, store):
    result = run(toy.graph_of(("linked", "linked", {})), store).results["linked"]
    assert result.state == "failed" and "plain files" in result.error


@pytest.mark.parametrize(("times", "code"), [(1, 0), (2, 5)])
def test_results_lost_before_delivery_are_made_again_once(tmp_path, store, times, code):
    """As when a collector on another machine, whose locks do not reach here, drops them."""
    lost = []

    def lose(event):
        if event.name == "done" and event.result.name == "report" and len(lost) < times:
            lost.append(event)
            record = store.peek(event.result.key)
            store.path("blob", record.outputs["index.html"].sha256).unlink()

    result = build(toy.project(tmp_path / "out"), ALONE, caller=Caller(on_event=lose))
    assert result.exit_code == code and result.executed == 5
    assert (result.delivery is not None) == (code == 0) == (tmp_path / "out/manifest.json").exists()
    again = build(toy.project(tmp_path / "out"), ALONE)
    assert again.exit_code == 0 and toy.executed(again) == (set() if code == 0 else {"report"})


def hungry(tmp_path, count, *, greedy):
    """Tasks that see how many of them run at the same time."""
    tasks = [(f"h/{n}", "hungry", {"folder": str(tmp_path), "name": str(n), "greedy": greedy}) for n in range(count)]
    return toy.graph_of(*tasks)


@pytest.mark.parametrize(("peak", "at_once"), [(400, 2), (600, 1)])
def test_as_many_tasks_start_as_fit_into_memory(tmp_path, store, monkeypatch, peak, at_once):
    monkeypatch.setattr("pipeline.engine.running.driver.available_bytes", lambda: 1000)
    events = []
    caller = Caller(on_event=lambda event: events.append(event.name), peaks={"hungry": peak})
    outcome = run(hungry(tmp_path, 2, greedy=False), store, BuildOptions(jobs=2), caller=caller)
    assert events == (["started", "done"] * 2 if at_once == 1 else ["started", "started", "done", "done"])
    assert outcome.records["h/0"].made_by.peak_bytes > 1 << 20  # an interpreter takes some megabytes


def test_a_task_that_meets_too_little_memory_is_tried_alone(tmp_path, store):
    events = []
    outcome = run(hungry(tmp_path, 3, greedy=True), store, BuildOptions(jobs=3), caller=Caller(on_event=events.append))
    assert {result.state for result in outcome.results.values()} == {"executed"}
    assert any(event.name == "retry" and "MemoryError" in event.error for event in events)


def test_code_that_was_edited_after_the_plan_is_refused(tmp_path, store, kit):
    from pipeline.engine.planning.plan import Specs
    from pipeline.engine.running.execute import perform

    graph = toy.graph_of(("lens", "lens", {"power": 1.0}))
    spec = Specs(store).of(graph["lens"], {})
    (kit / "tasks" / "lens.py").write_text("def run(params, inputs, out):\n    pass\n")
    (reply,) = perform([spec], store, graph.packages)
    assert reply.state == "failed" and reply.machine and "code is" in reply.error
    assert store.record(spec.key) is None


OTHER = """
from toykit import physics

def run(params, inputs, out):
    (out / "o.txt").write_text(str(physics.doubled(params["x"])))
"""


def test_code_that_was_edited_after_this_process_imported_it_is_not_run_under_its_new_key(kit, store):
    """Another kind imported the module; this one never ran before."""
    run(toy.graph_of(("lens", "lens", {"power": 1.0})), store)
    (kit / "tasks" / "other.py").write_text(OTHER)
    (kit / "physics.py").write_text("def doubled(x):\n    return x * 3\n")
    graph = toy.graph_of(("other", "other", {"x": 10}))
    result = run(graph, store).results["other"]
    assert result.state == "failed" and result.machine and "toykit.physics" in result.error
    toy.forget_imports()
    record = run(graph, store).records["other"]
    assert store.blob(record.outputs["o.txt"].sha256).read_bytes() == b"30"


def test_code_that_is_edited_while_a_task_runs_spoils_its_result(kit, store):
    edits = f"""
from pathlib import Path

def run(params, inputs, out):
    Path({str(kit / "tasks" / "other.py")!r}).write_text("def run(params, inputs, out): ...")
    (out / "o.txt").write_text("old")
"""
    (kit / "tasks" / "other.py").write_text(edits)
    result = run(toy.graph_of(("other", "other", {})), store).results["other"]
    assert result.state == "failed" and "edited after this process" in result.error
    assert list(store.entries("record")) == []


def test_a_task_sees_its_parameters_in_the_order_of_their_names_and_cannot_change_them(kit, store):
    """Keys do not know the order: `run-task` reads specs whose names are sorted."""
    writes = """
def run(params, inputs, out):
    (out / "o.txt").write_text(" ".join(params["of"]))
    params["of"].clear()
"""
    (kit / "tasks" / "other.py").write_text(writes)
    graph = toy.graph_of(("other", "other", {"of": {"b": 1, "a": 2}}))
    record = run(graph, store).records["other"]
    assert store.blob(record.outputs["o.txt"].sha256).read_bytes() == b"a b"
    assert record.components.params == graph["other"].params == {"of": {"b": 1, "a": 2}}


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("put_back", [False, True])
def test_a_bit_that_flips_between_the_look_at_an_input_and_its_use_is_noticed(tmp_path, store, jobs, put_back):
    """Else a wrong result would stand under a right key for ever."""
    (tmp_path / "tries").mkdir()
    params = {"folder": str(tmp_path / "tries"), "times": 1, "put_back": put_back}
    lens = ("lens", "lens", {"power": 4.0})
    graph = toy.graph_of(lens, ("meddled", "meddled", params, {"lens": "lens"}))
    outcome = run(graph, store, BuildOptions(jobs=jobs))
    assert outcome.results["meddled"].state == "executed" and outcome.results["lens"].state == "executed"
    right = outcome.records["lens"].outputs["lens.txt"]
    assert outcome.records["meddled"].outputs["read.txt"] == right == toy.put(store, b"8")


def test_a_task_whose_inputs_change_again_and_again_fails_and_says_why(tmp_path, store):
    (tmp_path / "tries").mkdir()
    params = {"folder": str(tmp_path / "tries"), "times": 9, "put_back": True}
    graph = toy.graph_of(("lens", "lens", {"power": 4.0}), ("meddled", "meddled", params, {"lens": "lens"}))
    failed = run(graph, store).results["meddled"]
    assert failed.state == "failed" and failed.machine
    assert "was written to while it was used" in failed.error and "Traceback" not in failed.error
