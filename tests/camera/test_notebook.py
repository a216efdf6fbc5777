"""Claim: the notebook interface answers whatever it is given with a record, with rays, or with an error of ours."""

import dataclasses
import inspect
import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from shorter import few

import pipeline
from pipeline.camera.bundle import Bundle
from pipeline.errors import PipelineError

HOSTILE = [
    *("a", "", b"x", None, True, object(), {}, 1 + 2j, "a\0b", "\ud800"),
    *(math.nan, math.inf, -math.inf, 10**30, 10**400),
    *(0, -0.0, -1, 3, 7.5, 1e300, 1e155, 1e-300, 5e-324, np.float32(2.5), np.int64(3), np.array(3), np.zeros(3)),
    *([1], (1, 2), [0.5, 0.25], ("a",), (math.nan, 1.0), ["a\0b"]),
]
SINGLET = pipeline.Prescription(
    surfaces=(
        pipeline.Surface(radius_mm=50.0, thickness_mm=6.0, semi_diameter_mm=12.0, index=1.5168),
        pipeline.Surface(radius_mm=-50.0, thickness_mm=3.0, semi_diameter_mm=12.0),
        pipeline.Surface(semi_diameter_mm=4.0, is_stop=True),
    )
)
SENSOR = pipeline.Sensor(width_px=64, height_px=48, pitch_mm=0.01)
CAMERA = pipeline.Camera(prescription=SINGLET, sensor=SENSOR, sensor_distance_mm=50.0)
ARRAY = pipeline.MicrolensArray(pitch_mm=0.1, focal_lengths_mm=(1.0,), columns=5, rows=5, distance_mm=0.8)
BOARD = pipeline.Checkerboard(columns=3, rows=4, square_mm=2.0)
STAGE = Path(__file__).parents[2] / "examples/01_conventional/dataset.usda"


def traced(record: Any) -> Bundle | None:
    """Rays through a camera with a record in it, if it is a part of one."""
    match record:
        case pipeline.Surface():
            lens = pipeline.Prescription(surfaces=(dataclasses.replace(record, is_stop=False), *SINGLET.surfaces))
            return traced(lens)
        case pipeline.Prescription():
            return traced(dataclasses.replace(CAMERA, prescription=record))
        case pipeline.Sensor():
            return traced(dataclasses.replace(CAMERA, sensor=record))
        case pipeline.MicrolensArray():
            return traced(dataclasses.replace(CAMERA, microlenses=record))
        case pipeline.Camera():
            return pipeline.bundle(record, 3.0, 4.0, samples=4)
    return None


def answer(call: Callable[[], Any]) -> Any:
    """What a call gives, or an error of ours in one line with a hint's worth of words."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return call()
        except PipelineError as error:
            assert len(str(error)) < 1000
            return error


@pytest.mark.parametrize(
    "record", [CAMERA, SENSOR, SINGLET, SINGLET.surfaces[0], ARRAY, BOARD], ids=lambda r: type(r).__name__
)
@pytest.mark.parametrize("step", few([200], 1))
def test_a_record_holds_what_it_declares_or_says_what_it_was_given(record: Any, step: int) -> None:
    """And what it holds can be traced, or an error says why not: one of so many is."""
    held = []
    for field in dataclasses.fields(record):
        for value in HOSTILE:
            found = answer(lambda field=field, value=value: dataclasses.replace(record, **{field.name: value}))
            if not isinstance(found, PipelineError):
                hash(found)  # no list and no array is inside: those have no hash
                held.append(found)
    for found in held[::step]:
        answer(lambda found=found: traced(found))


def test_wrong_kinds_are_named_with_what_is_wanted() -> None:
    a_number = "it has to be a number of at most 1e+12"
    said = [
        (lambda: pipeline.Sensor(width_px=1, height_px=1, pitch_mm="a"), "Sensor: pitch_mm is 'a'", a_number),
        (lambda: pipeline.Checkerboard(columns=7.5, rows=4, square_mm=1.0), "Checkerboard: columns is 7.5", "whole"),
        (
            lambda: pipeline.Surface(semi_diameter_mm=1, tilt_deg=(1,)),
            "Surface: tilt_deg is (1,)",
            "be 2 values, each a",
        ),
        (lambda: pipeline.Target(3), "Target: pattern is 3", "one of: Checkerboard, Deltille"),
        (lambda: pipeline.bundle(CAMERA, "a", 3), "x_px is 'a'", f"{a_number}, from -8388608 to 8388608"),
        (lambda: pipeline.bundle(CAMERA, 3, 3, samples=1000), "samples is 1000", "a power of two, e.g. 512"),
        (lambda: pipeline.open_dataset(None), "open_dataset: path is None", "a text or a Path"),
        (lambda: pipeline.build(STAGE, force="image"), "BuildOptions: force is 'image'", "a sequence, each a text"),
        (lambda: pipeline.build(STAGE, jbos=2), "build has no option 'jbos'", "did you mean jobs?"),
        (lambda: pipeline.build(STAGE, jobs=0), "jobs is 0", "it has to be a whole number, from 1 to 10000"),
    ]
    for call, what, hint in said:
        error = answer(call)
        assert error.message == what and hint in error.hint


def test_a_sensor_may_be_a_row_a_column_or_a_pixel_and_no_less() -> None:
    for width_px, height_px in ((1, 48), (64, 1), (1, 1)):
        sensor = pipeline.Sensor(width_px=width_px, height_px=height_px, pitch_mm=0.01)
        assert len(pipeline.bundle(dataclasses.replace(CAMERA, sensor=sensor), 0.0, 0.0).weight_sr)
    for width_px, height_px in ((0, 48), (64, 0)):
        error = answer(lambda w=width_px, h=height_px: pipeline.Sensor(width_px=w, height_px=h, pitch_mm=0.01))
        assert error.message == f"a sensor of {width_px} x {height_px} pixels of 0.01 mm"


def test_lists_and_numbers_of_numpy_are_as_good_as_pythons_own() -> None:
    surface = pipeline.Surface(
        semi_diameter_mm=np.float32(2.5), even_coefficients=np.array([1e-3, 0.0]), blades=np.int64(5)
    )
    assert surface == pipeline.Surface(semi_diameter_mm=2.5, even_coefficients=(1e-3, 0.0), blades=5)
    assert type(surface.blades) is int and type(surface.semi_diameter_mm) is float
    assert pipeline.Prescription(surfaces=list(SINGLET.surfaces)) == SINGLET


@pytest.mark.parametrize("name", ["x_px", "y_px", "samples", "seed"])
def test_a_bundle_is_traced_or_refused(name: str) -> None:
    for value in HOSTILE:
        arguments = {"x_px": 3.0, "y_px": 4.0, "samples": 4, "seed": 0, name: value}
        found = answer(lambda arguments=arguments: pipeline.bundle(CAMERA, **arguments))
        assert isinstance(found, Bundle | PipelineError)


@pytest.mark.parametrize("method", [Bundle.at_distance, Bundle.mean_at])
def test_crossings_with_a_plane_are_numbers_or_an_error(method: Callable[..., np.ndarray]) -> None:
    bundle = pipeline.bundle(CAMERA, 3.0, 4.0, samples=16)
    for value in HOSTILE:
        found = answer(lambda value=value: method(bundle, value))
        assert isinstance(found, PipelineError) or np.isfinite(found).all()


@pytest.mark.parametrize("step", few([4], 1))
def test_targets_stages_and_builds_answer_to_whatever_they_are_given(step: int, tmp_path: Path, monkeypatch) -> None:
    """The build itself is left out: its arguments are judged before."""
    monkeypatch.chdir(tmp_path)
    for value in HOSTILE:
        answer(lambda value=value: pipeline.Target(value))
        answer(lambda value=value: pipeline.Target(BOARD, value))
        answer(lambda value=value: pipeline.open_dataset(value))
        answer(lambda value=value: pipeline.open_dataset(STAGE, value))
    with patch("pipeline.engine.running.session.build"):
        for name in inspect.signature(pipeline.build).parameters:
            for value in HOSTILE[::step]:
                answer(lambda name=name, value=value: pipeline.build(**{"path": STAGE, "out": "out", name: value}))
