"""`pipeline import` as a user meets it: the stage on stdout or in a file, what was lost on stderr, exit codes, and that
nothing in a file steers the terminal.
"""

import subprocess
import sys

import pytest

from pipeline import cli
from pipeline.machine.process import Stderr

TABLE = "# A doublet\n50 4 1.5 18\n-50 2 1 18\n0 3 0 10\n-40 3 1.6 18\n-60 0 1 18\n"
STEERING = {"\x1b", "\x07", "\x9b"}
OF_TERMINALS = (
    "radius thickness index semi\n50 5 1.5 10\n\x1b[31m50 5 1 \x9b10\n",
    "VERS\x1b[31m 1\nUNIT \x9b5m\nGLAS \x1b]0;x\x07\n",
    "RDM;LEN\nS \x1b[2J 1e3 5 \x07\nGO\n",
)


@pytest.fixture
def pipeline(tmp_path, monkeypatch, in_this_process):
    """Run the command in an empty folder with a lens table: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.dat").write_text(TABLE)
    return in_this_process


def test_a_lens_goes_to_stdout_and_what_was_decided_to_stderr(pipeline):
    code, output, log = pipeline("import", "lens", "a.dat")
    assert code == 0
    assert output.startswith('#usda 1.0\n(\n    defaultPrim = "ADoublet"')
    assert "Imported from a.dat, a lens table of pbrt." in output
    assert "a.dat: warning: thicknesses were read as the space after each surface" in log


def test_a_lens_goes_to_a_new_file_that_passes_check(pipeline, tmp_path):
    assert pipeline("import", "lens", "a.dat", "-o", "b.usda")[:2] == (0, "b.usda\n")
    assert pipeline("check", "b.usda")[0] == 0
    code, output, log = pipeline("import", "lens", "a.dat", "-o", "b.usda")
    assert (code, output) == (2, "") and "b.usda exists" in log
    assert pipeline("import", "lens", "a.dat", "-o", "b.usd")[0] == 2
    assert [path.name for path in tmp_path.glob("*.usd*")] == ["b.usda"]


def test_a_lens_that_check_refuses_is_written_with_its_problems(pipeline, tmp_path):
    (tmp_path / "a.dat").write_text(TABLE.replace("50 4 1.5", "50 0.5 1.5"))
    code, output, log = pipeline("import", "lens", "a.dat", "-o", "b.usda", "--spacing", "after")
    assert code == 2 and output == "b.usda\n"
    assert "b.usda:" in log and "[surfaces-cross]" in log


def test_a_wrong_file_ends_with_2_and_writes_nothing(pipeline, tmp_path):
    (tmp_path / "a.dat").write_text(TABLE.replace("1.6", "glass"))
    code, output, log = pipeline("import", "lens", "a.dat", "-o", "b.usda")
    assert (code, output) == (2, "")
    assert log.startswith('error: a.dat:5: a column of a lens table must be a number, not "glass"')
    assert not (tmp_path / "b.usda").exists()
    code, _, log = pipeline("import", "lens", "none.zmx")
    assert code == 2 and log.startswith("error: none.zmx: No such file")


def test_a_camera_goes_to_a_new_rig_and_a_lens_table_is_told_from_it(pipeline, tmp_path):
    (tmp_path / "cam.csv").write_text("prop_wavelength;587.6\n")
    code, _, log = pipeline("import", "lens", "cam.csv")
    assert code == 2 and "pipeline import camera FILE" in log
    code, _, log = pipeline("import", "camera", "cam.csv", "--lens", "none.csv")
    assert code == 2 and log.startswith("error: none.csv: No such file")
    assert pipeline("import", "camera", "a.dat")[0] == 2


def test_readers_load_neither_usd_nor_a_compiler():
    program = "import sys, pipeline.plugins.lenses.read; print({'pxr', 'numba', 'typer', 'rich'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


@pytest.fixture
def spoken(tmp_path, monkeypatch, capfd):
    """Run the command in an empty folder, in this process, with the stream of messages that it has in its own."""
    monkeypatch.chdir(tmp_path)

    def run(*words):
        monkeypatch.setattr("sys.argv", ["pipeline", "import", *words])
        monkeypatch.setattr("sys.stderr", Stderr())
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code, *capfd.readouterr()

    return run


@pytest.mark.parametrize("suffix", ["dat", "txt", "csv", "zmx", "seq", "lens"])
@pytest.mark.parametrize("text", OF_TERMINALS)
def test_nothing_of_a_lens_file_steers_the_terminal(suffix, text, spoken, tmp_path):
    (tmp_path / f"lens.{suffix}").write_text(text)
    code, output, log = spoken("lens", f"lens.{suffix}")
    assert code in (0, 2) and log and not set(output + log) & STEERING, log


CAMERAS = (
    ("camera.js", '{"main_lens": {"f": "\x1b[31m5\x9b", "aperture": "4"}, "mla\x1b[2J": {}, "sensor": {}}'),
    ("camera.js", '{"main_lens": {"f": "5"}, "mla": {"mesh": {"geometry": "\x1b[31m3"}}, "sensor": {"odd\x07": "1"}}'),
    ("camera.csv", "objective_file_name;\x1b[31mtable\nprop_mla_type;\x9bHEX\n"),
    ("camera.csv", "objective_file_name;table\nprop_\x1b]0;x\x07\n"),
)


@pytest.mark.parametrize(("name", "text"), CAMERAS)
def test_nothing_of_a_camera_file_steers_the_terminal(name, text, spoken, tmp_path):
    (tmp_path / name).write_text(text)
    code, output, log = spoken("camera", name)
    assert (code, output) == (2, "") and log and not set(log) & STEERING, log
