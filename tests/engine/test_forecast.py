"""Forecasts of plans: from the same task before, from its kind here, from its kind in other builds of the store."""

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from engine import toy
from laws.solving import judged_rows, planes_of

from pipeline.camera.parts.camera import Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.engine.options import ALONE, BuildOptions
from pipeline.engine.planning.explain import describe
from pipeline.engine.planning.forecast import Cost, means_by_kind
from pipeline.engine.records import Run
from pipeline.engine.running.session import build, forecast_of, plan_of
from pipeline.jit.work import work
from pipeline.products.graph import graph_of
from pipeline.products.sizes import assumed_cost
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import colours, known_white_parts
from pipeline.render.pixel_rays import Band
from pipeline.scene.load import open_dataset
from pipeline.targets.patterns.circles import CircleGrid
from pipeline.targets.surfaces import Cylinder
from pipeline.truth.direct.direct_rows import guesses
from pipeline.truth.judging import certify
from pipeline.truth.moving import solve_points
from pipeline.truth.planes import Planes
from pipeline.truth.settings import CLAIM_PX

UNSIZED = {"cpu_seconds": 2.0, "rays": 100.0, "peak_bytes": 1 << 20}


def size(task, params):
    """Work of the toy's rays grows with their samples."""
    return float(params["samples"]) if task.short_kind == "rays" else 0.0


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


@pytest.mark.parametrize(("board", "width_px"), [("checks", 640), ("checks", 160), ("circles", 160)])
def test_the_rays_of_a_first_plan_are_those_that_the_images_take(board, width_px):
    """Within a factor of two, of large and small images: those pixels take rays that see more than one colour."""
    dataset = open_dataset(Path(__file__).parents[2] / "examples/01_conventional/dataset.usda")
    (camera,), (target,) = dataset.cameras, dataset.targets
    sensor = replace(camera.asked.sensor, width_px=width_px, height_px=width_px * 3 // 4)
    camera = replace(camera, asked=replace(camera.asked, sensor=sensor))
    if board == "circles":
        circles = CircleGrid(columns=7, rows=5, spacing_mm=1.6, diameter_mm=0.8)
        target = replace(target, target=replace(target.target, pattern=circles))
    graph = graph_of(replace(dataset, cameras=(camera,), targets=(target,)))[0]
    band = Band.of(Rig.of(Tracer(camera.camera)))
    poses = [frame.vision_from_target(camera.name, target.name) for frame in dataset.frames]
    seen = colours(band, [TargetLight([(target.target, pose)], dataset.background) for pose in poses])
    reckoned = sum(assumed_cost(graph, name).rays for name in graph if name.startswith("image"))
    assert 0.5 < reckoned / (64 * np.isnan(seen[:, 0]).sum()) < 2.0


@pytest.mark.parametrize(("size_px", "sampled"), [((250, 260), 4), ((200, 250), 2), ((150, 150), 0)])
def test_white_rows_in_which_the_image_circle_ends_take_rays(size_px, sampled):
    """A circle of 283 px: quadrature knows tiles that are lit to both ends, as it is asked here. A small dataset of a
    fisheye took three times as long as was said.
    """
    dataset = open_dataset(Path(__file__).parents[2] / "examples/10_fisheye/dataset.usda")
    sensor = Sensor(width_px=size_px[0], height_px=size_px[1], pitch_mm=0.08)
    camera = replace(dataset.cameras[0], asked=replace(dataset.cameras[0].asked, sensor=sensor), image_samples=400)
    graph, rig = graph_of(replace(dataset, cameras=(camera,)))[0], Rig.of(Tracer(camera.camera))
    tiles = [name for name in graph if name.startswith("white_tile/")]
    taken = [known_white_parts(rig, tuple(graph[name].params["rows"])) is None for name in tiles]
    assert ([assumed_cost(graph, name).rays > 0 for name in tiles], sum(taken)) == (taken, sampled)


def test_times_under_load_and_for_loading_code_are_no_part_of_a_forecast():
    """A third of the tasks took ten times as long, and the first one loaded code for a second."""
    rays = [100, 200, 300, 100, 200, 300]
    runs = [Run(cpu_seconds=0.01 * count, kernels={"k": {"rays": count}}) for count in rays]
    runs[0] = replace(runs[0], cpu_seconds=2.0, loading_seconds=1.0)
    runs[5] = replace(runs[5], cpu_seconds=30.0)
    idle = [Run(cpu_seconds=1.5, loading_seconds=1.0), Run(cpu_seconds=0.1)]
    found = means_by_kind([*(("image", run) for run in runs), *(("report", run) for run in idle)])
    assert (found["image"].cpu_seconds, found["image"].rays) == (pytest.approx(2.0), 200)
    assert found["report"].cpu_seconds == pytest.approx(0.3)


def test_rays_of_labels_and_of_bent_targets_are_reckoned_to_what_they_meet():
    """Before, a build of a height map with labels took forty times as long as was said."""
    dataset = open_dataset(Path(__file__).parents[2] / "examples/01_conventional/dataset.usda")
    (camera,), (target,) = dataset.cameras, dataset.targets
    labelled = replace(camera, labels=("depth",))
    bent = replace(target, target=replace(target.target, surface=Cylinder(radius_mm=40.0)))
    for kind, changed in (
        ("labels_tile", replace(dataset, cameras=(labelled,))),
        ("image_tile", replace(dataset, targets=(bent,))),
    ):
        graph = graph_of(changed)[0]
        reckoned_s = sum(assumed_cost(graph, name).cpu_seconds - 0.05 for name in graph if name.startswith(f"{kind}/"))
        assert reckoned_s == pytest.approx(640 * 480 * 64 * 6 * 6e-7)


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


def test_rays_of_an_obstructed_stop_are_reckoned_as_its_rows_and_their_judge_trace_them():
    """Within a factor of two, as the kernels count them; a ring off the axis took thirty times as long as was said."""
    dataset = open_dataset(Path(__file__).parents[2] / "examples/01_conventional/dataset.usda")
    (camera,), (target,), frame = dataset.cameras, dataset.targets, dataset.frames[0]
    lens = camera.asked.prescription
    stop = lens.surfaces[lens.stop_index]
    ring = replace(stop, inner_semi_diameter_mm=0.9 * stop.semi_diameter_mm)
    surfaces = (*lens.surfaces[: lens.stop_index], ring, *lens.surfaces[lens.stop_index + 1 :])
    ringed = replace(camera, asked=replace(camera.asked, prescription=replace(lens, surfaces=surfaces)))
    graph = graph_of(replace(dataset, cameras=(ringed,), frames=(frame,)))[0]
    kinds = "truth/", "certificate/"
    reckoned = {kind: sum(assumed_cost(graph, name).rays for name in graph if name.startswith(kind)) for kind in kinds}
    rig, planes = (
        Rig.of(Tracer(ringed.camera)),
        planes_of(target.target, frame.vision_from_target(camera.name, "Board")),
    )
    before = copy.deepcopy(work())
    rows = solve_points(rig, Planes(planes), slice(None), CLAIM_PX, 0.05)
    between = copy.deepcopy(work())
    certify(rig, judged_rows(rows.solutions, planes, True), len(planes), CLAIM_PX)
    traced = [after.since(earlier) for earlier, after in ((before, between), (between, work()))]
    taken = [sum(kernel.rays for kernel in part.kernels.values()) for part in traced]
    assert 0.5 < reckoned["truth/"] / taken[0] < 2.0
    assert 0.5 < reckoned["certificate/"] / taken[1] < 2.0
