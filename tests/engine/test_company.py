"""Tasks that share work run in company: the same bytes, each with a record of its own, and no guilt by association."""

import threading
from pathlib import Path

import pytest
from engine import toy

from pipeline.engine.options import BuildOptions, Caller
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.running.driver import MAX_COMPANY, run
from pipeline.engine.store.store import Store


def graph(folder: Path, count: int, together="all", **of_b):
    """So many tasks a, b, c …; `of_b` are more params of the second."""
    result = toy.graph_of()
    for number in range(count):
        name = chr(ord("a") + number)
        params = {"name": name, "value": number, "folder": str(folder), **(of_b if name == "b" else {})}
        result.add(name, "toykit.tasks.shared", params, together=together)
    return result


def ran(folder: Path) -> list[str]:
    """Companies that ran: `a+b+c`."""
    return sorted(path.name.split("-")[1] for path in folder.glob("ran-*"))


def texts(outcome, store) -> dict[str, str]:
    made = {n: r.outputs["shared.txt"] for n, r in outcome.records.items() if "shared.txt" in r.outputs}
    return {n: store.read(blob.sha256).decode() for n, blob in made.items()}


def test_company_makes_what_each_alone_makes(tmp_path, store):
    together = run(graph(tmp_path, 3), store)
    assert ran(tmp_path) == ["a+b+c"]
    apart = run(graph(tmp_path, 3, together=None), Store(tmp_path / "other"))
    assert texts(together, store) == texts(apart, Store(tmp_path / "other")) == {"a": "a 0", "b": "b 1", "c": "c 2"}
    assert {n: r.key for n, r in together.records.items()} == {n: r.key for n, r in apart.records.items()}
    assert {result.state for result in together.results.values()} == {"executed"}


def test_graphs_that_are_joined_make_what_each_makes_and_their_companies_stay_apart(tmp_path, store):
    graphs = {"one": graph(tmp_path, 3), "other": graph(tmp_path, 3, value=9)}
    for each in graphs.values():
        each.add("lens", "toykit.tasks.lens", {"power": 4.0})
        each.add("rays", "toykit.tasks.rays", {"samples": 8}, {"lens": "lens"})
    joined = run(TaskGraph.joined(graphs), store)

    assert ran(tmp_path) == ["a+b+c", "b"]  # a and c of both are one
    for before, each in graphs.items():
        alone = run(each, Store(tmp_path / before))
        assert {name: joined.records[f"{before}/{name}"].key for name in each} == {
            name: record.key for name, record in alone.records.items()
        }
        assert {result.state for result in run(each, store).results.values()} == {"cached"}


def test_tasks_that_are_alike_are_made_once(tmp_path, store):
    """Two frames in which all is the same have one key: nobody waits for a lock that the company holds itself."""
    twins = graph(tmp_path, 3, name="a", value=0)
    outcome = run(twins, store)
    assert ran(tmp_path) == ["a+c"]
    assert texts(outcome, store) == {"a": "a 0", "b": "a 0", "c": "c 2"}
    assert outcome.results["b"].state == "cached"


def test_what_a_company_took_is_shared_out(tmp_path, store):
    records = run(graph(tmp_path, 4), store).records
    made = [record.made_by for record in records.values()]
    assert len({run.cpu_seconds for run in made}) == 1  # each a quarter of all


def test_a_company_is_not_larger_than_allowed(tmp_path, store):
    run(graph(tmp_path, MAX_COMPANY + 1), store)
    assert [text.count("+") + 1 for text in ran(tmp_path)] == [MAX_COMPANY, 1]


def test_free_workers_are_not_left_without_work(tmp_path, store):
    run(graph(tmp_path, 4), store, BuildOptions(jobs=2))
    assert sorted(text.count("+") + 1 for text in ran(tmp_path)) == [2, 2]


def test_with_a_time_for_each_task_there_is_no_company(tmp_path, store):
    run(graph(tmp_path, 2), store, BuildOptions(timeout_s=60.0))
    assert ran(tmp_path) == ["a", "b"]


@pytest.mark.parametrize("jobs", [1, 2])
def test_only_the_one_that_fails_has_failed(tmp_path, store, jobs):
    outcome = run(graph(tmp_path, 3, fails=True), store, BuildOptions(jobs=jobs, keep_going=True))
    assert {name: result.state for name, result in outcome.results.items()} == {
        "a": "executed",
        "b": "failed",
        "c": "executed",
    }
    assert "ValueError: b cannot be made" in outcome.results["b"].error
    assert "b is made" in Path(outcome.results["b"].log).read_text()


def test_a_death_in_company_condemns_nobody(tmp_path, store):
    events = []
    outcome = run(
        graph(tmp_path, 4, kills="in company"), store, BuildOptions(jobs=2), caller=Caller(on_event=events.append)
    )
    assert {result.state for result in outcome.results.values()} == {"executed"}
    assert any(event.name == "retry" and "it runs alone now" in event.error for event in events)


def test_an_input_of_a_company_that_is_damaged_is_made_again_once(tmp_path, store):
    """All of them report it; the second found no result of the input any more, which ended the build."""

    def damage(event):
        if event.name == "started" and event.task == "b" and not damaged:
            damaged.append(store.path("blob", store.record(key).outputs["lens.txt"].sha256))
            damaged[0].unlink()

    result, damaged = toy.graph_of(("lens", "lens", {"power": 4.0})), []
    key = run(result, store).records["lens"].key
    for name in "ab":
        params = {"name": name, "value": 1, "folder": str(tmp_path)}
        result.add(name, "toykit.tasks.shared", params, {"lens": "lens"}, together="all")
    outcome = run(result, store, caller=Caller(on_event=damage))
    assert damaged and texts(outcome, store).keys() >= {"a", "b"}


def test_inputs_that_differ_are_no_company(tmp_path, store):
    """`together` is only a hint: who reads other bytes is run for itself."""
    result = graph(tmp_path, 2)
    result.add("x", "toykit.tasks.faulty:slow", {"folder": str(tmp_path), "name": "x", "seconds": 0})
    params = {"name": "d", "value": 3, "folder": str(tmp_path)}
    result.add("d", "toykit.tasks.shared", params, {"x": "x"}, together="all")
    result.add("e", "toykit.tasks.shared", {**params, "name": "e"}, {"y": "x"}, together="all")
    run(result, store)
    companies = [text for text in ran(tmp_path) if text != "x"]
    assert companies in (["a+b", "d", "e"], ["a", "b", "d", "e"])


def test_builders_whose_companies_overlap_wait_for_each_other_and_end(tmp_path, cache):
    """Locks are taken in one order: else two builders could each hold what the other wants."""
    orders = ["abcdef", "fedcba"]
    threads = [threading.Thread(target=run, args=(graph(tmp_path, 6), Store(cache))) for _ in orders]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert not any(thread.is_alive() for thread in threads)
    made = "+".join(ran(tmp_path)).split("+")
    assert sorted(made) == sorted("abcdef")  # each once
