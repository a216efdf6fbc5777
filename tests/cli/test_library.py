"""`pipeline library` and `pipeline doctor`: what ships, and what is wrong with a machine."""

import json
from importlib.metadata import PackageNotFoundError

import pytest
from places import ROOT

from pipeline.app import doctor


def test_the_library_lists_every_stage_with_published_figures(in_this_process):
    """Known from elsewhere: the lens of the paper, the sheet of the IMX250, the microlenses of Raytrix."""
    code, text, log = in_this_process("library", "--json")
    found = json.loads(text)
    assert (code, log) == (0, "")
    parts = {part["name"]: part for kind in found.values() for part in kind}
    assert sorted(parts) == sorted(
        path.relative_to(ROOT / "stages").as_posix() for path in (ROOT / "stages").glob("*/*.usda")
    )
    assert all(part["title"] for part in parts.values())
    assert parts["lenses/double_gauss_100mm_tronnier.usda"]["efl_mm"] == pytest.approx(100.716, abs=5e-4)
    assert parts["sensors/imx250.usda"]["width_px"] == 2464 and parts["sensors/imx250.usda"]["pitch_mm"] == 0.00345
    assert parts["mlas/michels_2019.usda"]["focal_lengths_mm"] == [1.9, 2.1, 2.3]
    assert parts["rigs/plenoptic_r12_a.usda"]["microlens_types"] == 3
    assert parts["rigs/conventional_100mm.usda"]["microlens_types"] is None
    assert parts["targets/checkerboard_stairs.usda"]["points"] == 4 * 7 * 2
    code, table, _ = in_this_process("library", "mlas")
    (row,) = (line for line in table.splitlines() if line.startswith("mlas/"))
    assert code == 0 and "0.2173" in row and "1.9, 2.1, 2.3" in row


def test_a_mistyped_kind_or_verb_gets_a_suggestion(in_this_process):
    code, text, log = in_this_process("library", "lense")
    assert (code, text) == (2, "") and 'did you mean "lenses"' in log
    code, _, log = in_this_process("library", "charuco_8x5")
    assert code == 2 and "`pipeline target targets/charuco_8x5.usda`" in log
    code, _, log = in_this_process("libary")
    assert code == 2 and "library" in log


def test_a_mistyped_option_gets_a_suggestion(in_this_process):
    code, _, log = in_this_process("build", "x.usda", "--retires", "3")
    assert code == 2 and "--retries" in log.partition("Possible options: ")[2]


def test_the_doctor_finds_nothing_wrong_here(in_this_process):
    """Tests run here, so that everything needed is there; doubts are allowed, such as a full disk."""
    code, text, _ = in_this_process("doctor", "--json")
    found = json.loads(text)
    assert (code, found["wrong"]) == (0, 0)
    names = [one["name"] for one in found["findings"]]
    assert {"python", "numba", "processor", "store", "disk here", "plug-in", "library"} <= set(names)
    assert all(one["mend"] for one in found["findings"] if one["state"] != "fine")


def test_kernels_that_nobody_may_keep_are_not_compiled_beforehand(in_this_process, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("PIPELINE_JIT_CACHE", str(tmp_path / "file"))
    code, text, log = in_this_process("warm")
    assert (code, text) == (5, "") and "PIPELINE_JIT_CACHE" in log and "compiling" not in log


def test_the_doctor_says_what_to_mend(in_this_process, monkeypatch):
    """A library that is gone, a size that is none, a plug-in folder that is gone, a setting that costs time."""

    def version(name: str) -> str:
        if name == "embreex":
            raise PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr(doctor, "installed_version", version)
    monkeypatch.setenv("PIPELINE_CACHE_SIZE", "plenty")
    monkeypatch.setenv("PXR_PLUGINPATH_NAME", "/gone/plenScene")
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.setenv("PIPELINE_JIT_CACHE", "/dev/null")
    code, text, _ = in_this_process("doctor")
    lines = text.splitlines()
    flagged = {line.split()[1]: (line[0], lines[i + 1].strip()) for i, line in enumerate(lines) if line[0] in "!?"}
    assert code == 5
    assert flagged["embreex"] == ("!", 'mend: install it: python -m pip install "plenoptic-pipeline"')
    assert flagged["store"] == ("!", "mend: write for example 500M or 50G")
    assert flagged["plug-in"][0] == "?" and "/gone/plenScene" in flagged["plug-in"][1]
    assert flagged["PYTHONDONTWRITEBYTECODE"][0] == "?"
    assert flagged["kernels"][0] == "?" and "set PIPELINE_JIT_CACHE" in flagged["kernels"][1]
    assert lines[-1].startswith("2 problems, ")
