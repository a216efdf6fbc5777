"""Claim: what a task cannot do reaches a user as one error with its place and a way out, and never as a traceback."""

from pathlib import Path

import pytest
from stage_text import tiny_text

import pipeline
from pipeline.app.progress import Ending


@pytest.fixture
def dark(tmp_path, monkeypatch):
    """A stage whose stop is a ring of no width, which no check traces; gives its line of the camera."""
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "store"))
    monkeypatch.chdir(tmp_path)
    ring = 'uniform double plen:innerSemiDiameter = 4.4999999\nuniform token plen:apertureShape = "annular"'
    text = tiny_text("conventional")
    over = f'over "Lens"\n{{\nover "Stop"\n{{\n{ring}\n}}\n}}\n'
    text = text.replace('        over "Sensor"', f'{over}        over "Sensor"')
    Path("dataset.usda").write_text(text, encoding="utf-8")
    return 1 + text.splitlines().index('        over "Camera"')


def test_tasks_that_fail_alike_are_one_error_with_its_place(dark, capsys):
    ending = Ending(0, "dataset.usda")
    until = ["white/Rig.Camera", "rays_tile/Rig.Camera/0000"]
    result = pipeline.build("dataset.usda", jobs=1, keep_going=True, until=until, on_event=ending)
    ending.show()
    said = capsys.readouterr().err
    assert result.exit_code == 1 and {task.name for task in result.failures} == set(until)
    assert said.startswith(f"dataset.usda:{dark}: error: no light passes the lens from ")
    assert "\n    at </TinyConventional/Rig/Camera>\n    hint: is an aperture too small" in said
    assert said.count("error:") == 1 and "Traceback" not in said and "tracer.py" not in said
    assert "so did, alike: " in said
    for task in result.failures:
        assert task.to_dict()["place"] == f"dataset.usda:{dark}: at </TinyConventional/Rig/Camera>"
        assert "Traceback" in Path(task.log).read_text(encoding="utf-8")


def test_an_error_that_only_rays_show_ends_a_build_before_its_first_task(tmp_path, monkeypatch, in_this_process):
    """`build` looks for such errors when it first has to run something; it said them as warnings, and went on."""
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "store"))
    stage = tmp_path / "dataset.usda"
    stage.write_text(tiny_text("conventional", ("pixelPitch = 0.1", "pixelPitch = 100")), encoding="utf-8")
    for verb in ("check", "build"):
        code, told, said = in_this_process(verb, str(stage))
        assert code == 2 and (told + said).count("[no-chief-ray]") == 1 and "dataset.usda:" in told + said
    assert not (tmp_path / "dataset").exists()


def test_show_says_where_the_camera_stands_that_it_cannot_show(dark, in_this_process):
    code, _, said = in_this_process("show", "dataset.usda")
    assert code == 2 and f"dataset.usda:{dark}: error: no light passes the lens from " in said
    assert "at </TinyConventional/Rig/Camera>" in said and "hint: " in said
