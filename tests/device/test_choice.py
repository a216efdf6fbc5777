"""Claim: a device is part of keys only where it is chosen and tasks run there; without one, errors name the way out."""

from pathlib import Path

import pytest

from pipeline.app.build import project
from pipeline.engine.options import BuildOptions
from pipeline.errors import EnvironmentFault, UsageError
from pipeline.graph import devices
from pipeline.jit import device

TINY = Path(__file__).parents[1] / "data" / "tiny_conventional" / "dataset.usda"


def test_the_name_of_the_device_is_a_param_of_bundles_and_images_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(device, "device_name", lambda: "cuda sm_90, numba-cuda 0.30.4")
    plain = project(TINY, tmp_path)
    chosen = devices.on_device(plain, BuildOptions(device="cuda"))
    assert list(chosen.graph) == list(plain.graph)
    changed = {name for name in plain.graph if plain.graph[name].canonical != chosen.graph[name].canonical}
    traced = [name for name in plain.graph if plain.graph[name].short_kind in devices.BUNDLES + devices.IMAGES]
    assert changed == set(traced)
    assert {plain.graph[name].short_kind for name in traced} == {"rays_tile", "white", "image"}
    found = [[device_of(graph[name].params) for name in traced] for graph in (plain.graph, chosen.graph)]
    assert found == [[None] * len(traced), ["cuda sm_90, numba-cuda 0.30.4"] * len(traced)]


def device_of(params):
    """The device that a task's rays are traced on."""
    return params["device"] if "device" in params else params["exposure"]["device"]


def test_without_a_device_the_error_names_the_way_out(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_ENABLE_CUDASIM", raising=False)
    monkeypatch.setattr(device._cuda_of_numba(), "is_available", lambda: False)
    with pytest.raises(EnvironmentFault, match="no CUDA device") as caught:
        devices.on_device(project(TINY, tmp_path), BuildOptions(device="cuda"))
    assert "plenoptic-pipeline[cuda]" in str(caught.value)
    assert caught.value.exit_code == 5


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"device": "tpu"}, "no device"),
        ({"device": "cuda", "untrusted": True}, "--untrusted"),
        ({"device": "cuda", "engine": "dask:x"}, "--engine"),
    ],
)
def test_what_a_device_does_not_go_with_is_refused(arguments, told, tmp_path):
    with pytest.raises(UsageError, match=told):
        devices.on_device(project(TINY, tmp_path), BuildOptions(**arguments))
