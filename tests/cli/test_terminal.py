"""What a person sees: nothing in a file or a name steers the terminal, and a full disk leaves nothing, by name."""

import resource
import subprocess
import sys
from pathlib import Path

import pytest

TABLE = "radius thickness index semi\n50 5 1.5 10\n\x1b[31m50 5 1 \x9b10\n"
OTHERS = ("txt", "csv", "zmx", "seq", "lens")
RIG = (
    "new",
    "rig",
    "r.usda",
    "--lens",
    "lenses/double_gauss_100mm_tronnier.usda",
    "--sensor",
    "sensors/bayer_640x480_10um.usda",
)


def run(folder: Path, *words: str, limit_bytes: int | None = None) -> tuple[int, bytes]:
    def limit() -> None:
        if limit_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))

    command = [sys.executable, "-m", "pipeline", *words]
    ended = subprocess.run(command, cwd=folder, capture_output=True, preexec_fn=limit, check=False)
    return ended.returncode, ended.stdout + ended.stderr


@pytest.mark.parametrize("suffix", ["dat", *(pytest.param(one, marks=pytest.mark.heavy) for one in OTHERS)])
def test_nothing_of_a_lens_file_steers_the_terminal(suffix, tmp_path):
    for text in (TABLE, "VERS\x1b[31m 1\nUNIT \x9b5m\nGLAS \x1b]0;x\x07\n", "RDM;LEN\nS \x1b[2J 1e3 5 \x07\nGO\n"):
        (tmp_path / f"lens.{suffix}").write_text(text)
        code, shown = run(tmp_path, "import", "lens", f"lens.{suffix}", "-o", "lens.usda")
        assert code in (0, 2) and shown and not set(shown) & {0x1B, 0x07, 0x9B}, shown


CAMERAS = (
    ("camera.js", '{"main_lens": {"f": "\x1b[31m5\x9b", "aperture": "4"}, "mla\x1b[2J": {}, "sensor": {}}'),
    ("camera.js", '{"main_lens": {"f": "5"}, "mla": {"mesh": {"geometry": "\x1b[31m3"}}, "sensor": {"odd\x07": "1"}}'),
    ("camera.csv", "objective_file_name;\x1b[31mtable\nprop_mla_type;\x9bHEX\n"),
    ("camera.csv", "objective_file_name;table\nprop_\x1b]0;x\x07\n"),
)


@pytest.mark.parametrize(("name", "text"), CAMERAS)
def test_nothing_of_a_camera_file_steers_the_terminal(name, text, tmp_path):
    (tmp_path / name).write_text(text)
    code, shown = run(tmp_path, "import", "camera", name)
    assert code == 2 and shown and not set(shown) & {0x1B, 0x07, 0x9B}, shown


@pytest.mark.parametrize(("verb", "name"), [("report", "a\nb"), ("import lens", "a\x1b\nb"), ("verify", "n" * 300)])
def test_a_name_that_no_file_should_have_is_refused(verb, name, tmp_path):
    code, shown = run(tmp_path, *verb.split(), name)
    assert code == 2 and b"an argument h" in shown and not set(shown) & {0x1B} and len(shown.splitlines()) == 2


def test_a_full_disk_leaves_nothing_and_names_the_file(tmp_path):
    folder = tmp_path / "own"
    folder.mkdir()
    code, shown = run(folder, *RIG, "--focus", "400", limit_bytes=100)
    assert code == 5 and b"r.usda" in shown and not any(folder.iterdir()), shown
