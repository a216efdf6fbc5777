"""Forecasts of plans: from the same task before, from its kind here, from its kind in other builds of the store."""

from dataclasses import replace
from pathlib import Path

import pytest
from engine import toy
from laws.solving import planes_of

from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.engine.options import ALONE, BuildOptions
from pipeline.engine.planning.explain import describe
from pipeline.engine.planning.forecast import Cost
from pipeline.engine.records import Run
from pipeline.engine.running.session import build, forecast_of, plan_of
from pipeline.graph.dataset_graph import graph_of
from pipeline.graph.sizes import assumed_cost
from pipeline.scene.load import open_dataset
from pipeline.targets.surfaces import Cylinder
from pipeline.truth.direct.direct_rows import guesses

UNSIZED = {"cpu_seconds": 2.0, "rays": 100.0, "peak_bytes": 1 << 20}


def size(kind, params):
    """Work of the toy's rays grows with their samples."""
    return float(params["samples"]) if kind == "rays" else 0.0


def assumed(graph, name):
    """Half an hour for every task that nothing is known of."""
    return Cost(cpu_seconds=1800.0, rays=5.0, peak_bytes=0)


@pytest.fixture
def known(tmp_path, store):
    """A build of which every task took two seconds and a hundred rays."""
    project = toy.project(tmp_path / "out")
    build(project, ALONE)
    (name,) = store.notes("history")
    note = store.read_note("history", name)
    for key in note["keys"].values():
        record = store.peek(key)
        made_by = Run(cpu_seconds=2.0, peak_bytes=1 << 20, kernels={"k": {"rays": 100}})
        store.path("record", key).unlink()
        store.put_record(replace(record, made_by=made_by))
    store.write_note("history", name, {**note, "costs": dict.fromkeys(("lens", "rays", "image", "report"), UNSIZED)})
    return project


def to_come(project, store, **options):
    return forecast_of(project, plan_of(project, BuildOptions(**options), store=store), size, assumed, store=store)


def test_nothing_is_to_come_when_all_is_there(known, store):
    found = to_come(known, store)
    assert (found.tasks, found.cpu_seconds, found.rays, found.peak_bytes) == (0, 0, 0, 0)


def test_a_task_will_take_what_it_took(known, store):
    found = to_come(known, store, force=["image"])
    assert (found.tasks, found.unknown) == (3, 0)  # two images, and maybe the report
    assert (found.cpu_seconds, found.rays, found.peak_bytes) == (6.0, 300, 1 << 20)


def test_four_times_the_samples_take_four_times_as_long(known, store, tmp_path):
    found = to_come(toy.project(tmp_path / "out", samples=32), store)
    assert (found.tasks, found.cpu_seconds) == (4, 4 * 2.0 + 3 * 2.0)


def test_another_dataset_learns_from_the_kinds_of_this_one(known, store, tmp_path):
    other = replace(toy.project(tmp_path / "other", power=5.0, stage="other"), stage_id="other")
    found = to_come(other, store)
    assert (found.tasks, found.unknown, found.cpu_seconds) == (5, 0, 10.0)


def test_kinds_that_never_ran_cost_what_is_assumed(known, store, tmp_path):
    extra = ("fail", "fail", {"flag": str(tmp_path / "flag")})
    project = toy.project(tmp_path / "out", extra=[extra])
    found = to_come(project, store)
    assert (found.tasks, found.unknown, found.cpu_seconds) == (1, 1, 1800.0)
    told = "\n".join(describe(plan_of(project, store=store), found))
    assert "to come: about 30 min of processor time, 5 rays: a guess by their number, because no task" in told


def test_the_rays_of_a_first_plan_are_those_of_its_images():
    """Example 01: a white image and six frames, of which three tenths are reckoned, with 64 rays per pixel."""
    graph = graph_of(open_dataset(Path(__file__).parents[2] / "examples/01_conventional/dataset.usda"))[0]
    costs = [assumed_cost(graph, name) for name in graph]
    assert sum(cost.rays for cost in costs) == pytest.approx(640 * 480 * 64 * (1 + 6 * 0.3))
    assert sum(cost.cpu_seconds for cost in costs) == pytest.approx(640 * 480 * 64 * 2.8e-7 + 0.05 * len(graph))


def test_rays_of_labels_and_of_bent_targets_are_reckoned_to_what_they_meet():
    """Before, a build of a height map with labels took forty times as long as was said."""
    dataset = open_dataset(Path(__file__).parents[2] / "examples/01_conventional/dataset.usda")
    (camera,), (target,) = dataset.cameras, dataset.targets
    labelled = replace(camera, labels=("depth",))
    bent = replace(target, target=replace(target.target, surface=Cylinder(radius_mm=40.0)))
    for changed, per_frame in (
        (replace(dataset, cameras=(labelled,)), 6e-7 + 0.3e-7),
        (replace(dataset, targets=(bent,)), 6e-7),
    ):
        graph = graph_of(changed)[0]
        reckoned_s = sum(assumed_cost(graph, name).cpu_seconds for name in graph) - 0.05 * len(graph)
        assert reckoned_s == pytest.approx(640 * 480 * 64 * (1e-7 + 6 * per_frame))


@pytest.mark.parametrize(("tilt_deg", "pair_s"), [(0.0, 6e-4), (0.02, 1e-2)])
def test_truth_behind_microlenses_is_reckoned_by_the_pairs_that_are_looked_for(tilt_deg, pair_s):
    """Within a factor of two of what rays from the points through the lens find."""
    dataset = open_dataset(Path(__file__).parents[2] / "examples/02_plenoptic/dataset.usda")
    (camera,), (target,) = dataset.cameras, dataset.targets
    array = replace(camera.asked.microlenses, tilt_x_deg=tilt_deg)
    tilted = replace(camera, asked=replace(camera.asked, microlenses=array))
    graph = graph_of(replace(dataset, cameras=(tilted,)))[0]
    tiles = [name for name in graph if name.startswith(f"truth_tile/{camera.name}/0001/")]
    reckoned_s = sum(assumed_cost(graph, name).cpu_seconds - 0.05 for name in tiles)
    pose = dataset.frames[0].vision_from_target(camera.name, target.name)
    pairs = len(guesses(Rig.of(Tracer(camera.camera)), planes_of(target.target, pose))[0].point)

    assert 0.5 < reckoned_s / (pairs * pair_s) < 2.0
