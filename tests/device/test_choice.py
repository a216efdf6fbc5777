"""Claim: a device is part of keys only where it is chosen and tasks run there; without one, errors name the way out."""

import numba.cuda
import numpy as np
import pytest
from laws import rigs
from places import TINY

from pipeline.app.build import project
from pipeline.camera.on_device import ImageRays
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.records import Samples, no_diffraction
from pipeline.camera.tracing.sobol import sobol_bits
from pipeline.engine.options import BuildOptions
from pipeline.errors import EnvironmentFault, UsageError
from pipeline.jit import device
from pipeline.products import variants

SM_90 = "cuda sm_90, numba-cuda 0.30.4"


def test_the_name_of_the_device_is_a_param_of_bundles_and_images_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(device, "device_name", lambda: SM_90)
    plain = project(TINY, tmp_path)
    chosen = variants.on_device(plain, BuildOptions(device="cuda"))
    assert list(chosen.graph) == list(plain.graph)
    changed = {name for name in plain.graph if plain.graph[name].canonical != chosen.graph[name].canonical}
    traced = [name for name in plain.graph if plain.graph[name].short_kind in ("rays_tile", "image")]
    assert changed == set(traced)
    assert {plain.graph[name].short_kind for name in traced} == {"rays_tile", "image"}
    found = [[device_of(graph[name].params) for name in traced] for graph in (plain.graph, chosen.graph)]
    assert found == [[None] * len(traced), [SM_90] * len(traced)]


def device_of(params):
    return params["device"] if "device" in params else params["exposure"]["device"]


@pytest.mark.parametrize(("tiny", "white"), [("tiny_conventional", None), ("tiny_plenoptic", SM_90)])
def test_white_images_by_quadrature_stay_with_processors(tiny, white, tmp_path, monkeypatch):
    """A header that names a device would be untrue."""
    monkeypatch.setattr(device, "device_name", lambda: SM_90)
    plain = project(TINY.parents[1] / tiny / "dataset.usda", tmp_path)
    chosen = variants.on_device(plain, BuildOptions(device="cuda")).graph
    found = {
        chosen[name].short_kind: device_of(chosen[name].params) for name in chosen if "exposure" in chosen[name].params
    }
    assert found == {"white": white, "image": SM_90}


def test_a_task_refuses_another_device_than_that_of_its_key(monkeypatch):
    monkeypatch.setattr(device, "device_name", lambda: "cuda sm_80, numba-cuda 0.30.4")
    with pytest.raises(EnvironmentFault, match=r"this is for cuda sm_90.*, and here is cuda sm_80"):
        image_rays(Tracer(rigs.conventional()).arrays)
    tracer = Tracer(rigs.conventional(), device=SM_90)
    with pytest.raises(EnvironmentFault, match="here is cuda sm_80"):
        tracer.moments(np.zeros((1, 2)), np.array([-1]), np.zeros((2, 4, 3)), 16, np.zeros((1, 2), int))


def test_a_lens_that_float32_would_change_is_refused(monkeypatch):
    monkeypatch.setattr(device, "device_name", lambda: SM_90)
    camera = Tracer(rigs.conventional()).arrays
    table = camera.table.copy()
    table[0, -1] = 1e-40
    with pytest.raises(EnvironmentFault, match="too small for float32") as caught:
        image_rays(camera._replace(table=table))
    assert "leave --device out" in str(caught.value)


def image_rays(camera):
    return ImageRays(SM_90, camera, Samples(sobol_bits(4), 1, 0.05), no_diffraction())


class CudaAPIError(Exception):
    """As both packages for CUDA name their error."""


@pytest.mark.parametrize(
    ("error", "kind", "told"),
    [
        (CudaAPIError("[2] CUDA_ERROR_OUT_OF_MEMORY"), MemoryError, "too little memory left; fewer workers"),
        (CudaAPIError("[700] CUDA_ERROR_ILLEGAL_ADDRESS"), EnvironmentFault, "the device failed: .*ILLEGAL_ADDRESS"),
        (ValueError("ours"), ValueError, "ours"),
    ],
)
def test_failures_of_a_device_are_no_bugs_of_ours(error, kind, told):
    with pytest.raises(kind, match=told), device.faults_of_devices():
        raise error


def test_without_a_device_the_error_names_the_way_out(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_ENABLE_CUDASIM", raising=False)
    monkeypatch.setattr(numba.cuda, "is_available", lambda: False)
    with pytest.raises(EnvironmentFault, match="no CUDA device") as caught:
        variants.on_device(project(TINY, tmp_path), BuildOptions(device="cuda"))
    assert "plenoptic-pipeline[cuda]" in str(caught.value)
    assert caught.value.exit_code == 5


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"device": "tpu"}, "no device"),
        ({"device": "cuda", "engine": "dask:x"}, "--engine"),
    ],
)
def test_what_a_device_does_not_go_with_is_refused(arguments, told, tmp_path):
    with pytest.raises(UsageError, match=told):
        variants.on_device(project(TINY, tmp_path), BuildOptions(**arguments))
