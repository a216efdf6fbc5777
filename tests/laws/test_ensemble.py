"""Claim: cameras as built differ from the nominal one by errors of the stated distributions, and by nothing else.

Errors are judged by their distributions, rows by the derivatives of the nominal camera, moments by NumPy's, and the
nominal camera by what the engine would run for a member without errors.
"""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats
from stage_text import tiny_text

import pipeline
from pipeline.app import ensemble as ensembles
from pipeline.app.build import build_with, project, run_together
from pipeline.engine.options import BuildOptions
from pipeline.engine.output.manifest import render
from pipeline.engine.running.result import Result
from pipeline.errors import UsageError
from pipeline.results.spread import figures, rows
from pipeline.scene.load import load
from pipeline.scene.tolerances import Tolerance, layer_of_member, random_share
from pipeline.scene.usd.problems import StageError

LENS = "/TinyConventional/Rig/Lens"
POINTS_MM = [[x, y, 434.0] for x in (-4.0, 0.0, 3.5) for y in (-2.5, 2.0)]
MANY = 4000
"""Errors that are drawn to judge a distribution: one that is wrong by 3 per cent somewhere is refused."""


def tolerance(name: str, of: str, spread: float, *lines: str) -> str:
    text = "\n".join([f"rel plen:tolerance:of = [{of}]", f"uniform double plen:tolerance:spread = {spread}", *lines])
    return f'def PlenTolerance "{name}"\n{{\n{text}\n}}\n'


def stage(folder: Path, *tolerances: str) -> Path:
    path, sensor = folder / "dataset.usda", '        over "Sensor"\n'
    text = tiny_text("conventional", (sensor, "".join(tolerances) + sensor))
    path.write_text(text, encoding="utf-8")
    return path


def member(path: Path, number: int) -> tuple[Path, dict[str, float]]:
    """The layer of a member, and its errors by name."""
    place = path.with_name(f"member_{number}.usda")
    text, numbers = layer_of_member(path, number, place)
    place.write_text(text, encoding="utf-8")
    return place, {number.name: number.error for number in numbers}


RADII = tolerance("Radii", f"<{LENS}/S1.plen:radius>, <{LENS}/S3.plen:radius>", 1e-2)
CENTRING = tolerance(
    "Centring", f"<{LENS}/S4.plen:decentre>", 1e-2, 'uniform token plen:tolerance:distribution = "uniform"'
)


def test_a_member_without_errors_runs_the_tasks_of_the_nominal_camera(tmp_path):
    """Tasks with the same params have the same keys, so the same bytes."""
    path = stage(tmp_path, tolerance("None", f"<{LENS}/S1.plen:radius>, <{LENS}/S4.plen:decentre>", 0.0))
    place, errors = member(path, 1)
    assert set(errors.values()) == {0.0}
    nominal, same = (project(stage).graph for stage in (path, place))
    assert {name: nominal[name] for name in nominal} == {name: same[name] for name in same}
    other = project(member(stage(tmp_path, RADII), 1)[0]).graph
    assert {name for name in nominal if nominal[name] != other[name]}


def test_another_tolerance_changes_no_error(tmp_path):
    _, before = member(stage(tmp_path, RADII), 3)
    _, after = member(stage(tmp_path, CENTRING, RADII.replace('"Radii"', '"Others"')), 3)
    assert before.items() < after.items()
    assert len(set(after.values())) == 4


def test_entries_of_an_array_are_off_by_themselves_or_together(tmp_path):
    _, alone = member(stage(tmp_path, CENTRING), 1)
    together = CENTRING.replace("uniform token", "uniform bool plen:tolerance:together = 1\nuniform token")
    _, common = member(stage(tmp_path, together), 1)
    assert len(set(alone.values())) == 2
    assert len(set(common.values())) == 1


def test_an_error_is_the_same_in_all_time_samples(tmp_path):
    path = stage(tmp_path, tolerance("Pose", "</TinyConventional/Board.xformOp:translate>", 0.1))
    place, errors = member(path, 1)
    poses = [[np.array(frame.world_from_target["Board"]) for frame in load(of).dataset.frames] for of in (path, place)]
    for nominal, moved in zip(*poses, strict=True):
        assert np.allclose((moved - nominal)[:3, 3], list(errors.values()), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("distribution", "expected"),
    [
        ("normal", stats.norm(scale=0.3)),
        ("uniform", stats.uniform(loc=-0.3, scale=0.6)),
        ("truncated", stats.truncnorm(-1.5, 1.5, scale=0.3)),
    ],
)
def test_errors_follow_their_distribution(distribution, expected):
    """Over members, over entries and over seeds, by the test of Kolmogorov and Smirnov."""
    of = Tolerance(distribution, 0.3, 1.5)
    for shares in (
        [random_share(7, number, f"{LENS}/S1.plen:radius", 0) for number in range(MANY)],
        [random_share(7, 1, f"{LENS}/S1.plen:radius", number) for number in range(MANY)],
        [random_share(number, 1, f"{LENS}/S1.plen:radius", 0) for number in range(MANY)],
    ):
        errors = np.array([of.error(value) for value in shares])
        assert stats.kstest(errors, expected.cdf).pvalue > 1e-3
        assert abs(np.corrcoef(errors[1:], errors[:-1])[0, 1]) < 4 / np.sqrt(MANY)
        assert of.reach is None or abs(errors).max() <= of.reach


def test_small_errors_move_rows_as_their_derivatives_say(tmp_path):
    """Instance by instance, which is more than the spread J S J^T of all: what is left is of second order."""
    path = stage(tmp_path, RADII, CENTRING)
    names = ["Rig/Lens/S1.plen:radius", "Rig/Lens/S3.plen:radius", "Rig/Lens/S4.plen:decentre"]
    nominal = pipeline.ready(path).project(POINTS_MM, derivatives=names)
    by_number = {f"/TinyConventional/{name}": nominal.derivatives[name] for name in names[:2]}
    by_number |= {f"{LENS}/S4.plen:decentre[{i}]": nominal.derivatives[names[2]][..., i] for i in (0, 1)}
    for number in (1, 2):
        place, errors = member(path, number)
        assert errors.keys() == by_number.keys()
        expected = sum(errors[name] * by_number[name] for name in errors)
        projected = pipeline.ready(place).project(POINTS_MM)
        moved = np.stack([projected.x_px - nominal.x_px, projected.y_px - nominal.y_px], axis=1)
        assert abs(expected).max() > 3e-3
        assert np.allclose(moved, expected, rtol=0, atol=1e-3 * abs(expected).max())


def outputs(count: int, seen: np.ndarray) -> tuple[list[SimpleNamespace], np.ndarray]:
    """Stand-ins for builds of a nominal camera and `count` members with three rows each where they are seen."""
    rng = np.random.default_rng(2)
    moved = rng.normal(size=(count + 1, 3, 2)) @ np.array([[1.0, 0.4], [0.0, 0.8]]) + 1e5
    built = []
    for positions, is_seen, efl_mm in zip(moved, seen, rng.normal(100.0, 0.1, count + 1).tolist(), strict=True):
        points = np.arange(3)
        table = np.rec.fromarrays(
            [column[is_seen] for column in (np.ones(3, int), np.array(["Board"] * 3), points, *positions.T)],
            names=["frame", "target", "point_id", "x_px", "y_px"],
        )
        record = {"lens": {"efl_mm": efl_mm}, "sensor_distance_mm": 2 * efl_mm, "pinhole": None}
        built.append(SimpleNamespace(cameras={"A": SimpleNamespace(record=record, correspondences=table)}))
    return built, moved


def test_moments_are_those_of_numpy_over_rows_that_all_members_have():
    seen = np.ones((9, 3), bool)
    seen[0, 1] = seen[4, 2] = False
    built, moved = outputs(8, seen)
    table = rows("A", built[0], built[1:])
    assert table["members"].tolist() == [8, 8, 7]
    assert np.isnan(table["x_px"]).tolist() == [False, True, False]
    for point in (0, 1):
        covariance = np.cov(moved[1:, point].T)
        assert np.allclose(table["mean_x_px"][point], moved[1:, point, 0].mean())
        assert np.allclose(table["deviation_y_px"][point] ** 2, covariance[1, 1])
        assert np.allclose(table["correlation_xy"][point], np.corrcoef(moved[1:, point].T)[0, 1])
    assert np.isnan([table[name][2] for name in ("mean_x_px", "deviation_x_px", "correlation_xy")]).all()
    of = figures("A", built[0], built[1:])
    assert of.names == ("efl_mm", "sensor_distance_mm")
    assert np.allclose(of.deviation[1], 2 * of.deviation[0])
    assert np.allclose(of.correlation, 1)


def test_tolerances_may_not_leave_the_range_of_their_number(tmp_path):
    wide = tolerance(
        "Wide", f"<{LENS}/S1.plen:semiDiameter>", 100.0, 'uniform token plen:tolerance:distribution = "uniform"'
    )
    assert [problem.code for problem in load(stage(tmp_path, wide)).errors] == ["out-of-range"]


def test_what_stops_an_ensemble_is_named(tmp_path):
    """A stage without a tolerance; a member that leaves a range, before anything is built; a member that fails."""

    def run(path: Path, place: Path, _: BuildOptions) -> SimpleNamespace:
        built.append(place.name)
        return SimpleNamespace(exit_code=int(path.stem == "member_0002"), certificate={})

    def together(stages: dict[Path, Path], _: BuildOptions) -> SimpleNamespace:
        started.append(list(stages.values()))
        return SimpleNamespace(interrupted=False)

    built: list[str] = []
    started: list[list[Path]] = []
    off = tolerance("Off", f"<{LENS}/S1.plen:semiDiameter>", 100.0)
    for tolerances, error, said in (
        ([], StageError, "has no tolerance"),
        ([off], StageError, "member_0001.usda:.*semiDiameter"),
        ([RADII], ensembles.MemberError, "member_0002"),
    ):
        with pytest.raises(error, match=said):
            ensembles.ensemble(stage(tmp_path, *tolerances), tmp_path / "out", 3, BuildOptions(), run, together)
        assert (tmp_path / "out").exists() == bool(tolerances)
    assert built == ["nominal", "member_0001", "member_0002"]
    assert [[place.name for place in places] for places in started] == [[*built, "member_0003"]]
    with pytest.raises(UsageError, match="larger ensemble: member_0003 to member_0003"):  # what it says may be stale
        ensembles.ensemble(tmp_path / "dataset.usda", tmp_path / "out", 2, BuildOptions(), run, together)


def test_a_member_whose_certificate_fails_is_named():
    fails = {"claim_px": 1e-3, "passed": False, "of": 0, "reason": "too far off"}
    passes = {**fails, "passed": True}
    certificates = {"nominal": {"A": passes, "B": passes}, "member_0001": {"A": passes, "B": fails}}
    built = ensembles.Ensemble(out=Path(), numbers={}, certificates=certificates, figures={}, tables={})
    assert [line.split(":")[:2] for line in built.refuted] == [["member_0001", " certificate of B"]]


@pytest.mark.heavy
def test_an_ensemble_writes_what_its_members_differ_by(tmp_path, monkeypatch):
    """Rows of the report spread as J S J^T, within what five members can say: the errors that were drawn are known."""
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "store"))
    path = stage(tmp_path, RADII)
    executed = []

    def run(*of: Any) -> Result:
        result = build_with(*of)
        executed.append(result.executed)
        return result

    built = ensembles.ensemble(path, tmp_path / "out", 5, BuildOptions(jobs=1, pictures=False), run)
    assert executed == [0] * 6  # all ran together before
    assert built.refuted == []
    document = json.loads((tmp_path / "out/ensemble.json").read_text(encoding="utf-8"))
    assert all(of == {"Rig.Camera": True} for of in document["members"].values())
    assert not list((tmp_path / "out").rglob("image.*"))
    nominal = pipeline.open_output(tmp_path / "out/nominal")
    derivatives = pipeline.ready(path)
    points = nominal.view(1).correspondences  # its board stands across the axis, as planes of `project` do
    seen = np.stack([points.camera_x_mm, points.camera_y_mm, points.camera_z_mm], axis=1)
    names = [f"Rig/Lens/{surface}.plen:radius" for surface in ("S1", "S3")]
    projected = derivatives.project(seen, derivatives=names)
    by_number = np.stack([projected.derivatives[name] for name in names], axis=-1)
    errors = np.array([list(member(path, number)[1].values()) for number in range(1, 6)])
    expected = np.einsum("niv,vw,niw->ni", by_number, np.cov(errors.T), by_number)
    table = built.tables["Rig.Camera"]
    deviations = np.stack([table["deviation_x_px"], table["deviation_y_px"]], axis=1)
    assert np.allclose(deviations[table["frame"] == 1], np.sqrt(expected), rtol=2e-3, atol=2e-6)
    assert "principal_distance_px" in "\n".join(ensembles.summary(built))


def test_the_folder_of_another_build_is_refused_as_what_it_is(tmp_path):
    path, out = stage(tmp_path, RADII), tmp_path / "out"
    out.mkdir()
    (out / "manifest.json").write_bytes(render({"stage": "other.usda </Other>"}, {}, {}))
    with pytest.raises(UsageError, match="</Other>', not 'an ensemble'"):
        run_together({path: out / "nominal"}, BuildOptions(jobs=1, pictures=False))
