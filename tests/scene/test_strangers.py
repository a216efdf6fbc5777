"""The line of docs/strangers.md builds a stage, and neither it nor a program in its place reads or writes outside."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT, TINY

BUILD = '"$venv/bin/python" -m pipeline build /stage/dataset.usda -o /out/dataset'

needs_bwrap = pytest.mark.skipif(
    not shutil.which("bwrap")
    or subprocess.run(["bwrap", "--ro-bind", "/", "/", "--unshare-all", "true"], capture_output=True).returncode != 0,
    reason="bubblewrap is not installed, or the kernel refuses user namespaces",
)
pytestmark = [pytest.mark.heavy, needs_bwrap]

TAKEN_OVER = """
import os, pathlib, socket, sys
secret, *folders = sys.argv[1:]
def done(act):
    try:
        act()
        return True
    except OSError:
        return False
print("read", done(lambda: open(secret).read()), done(lambda: os.listdir(os.path.dirname(secret))))
for folder in folders:
    done(lambda: pathlib.Path(folder, "harm").write_text("harm"))
print("network", done(lambda: socket.create_connection(("1.1.1.1", 53), 2)))
print("environment", "SECRET" in os.environ)
print("out", done(lambda: pathlib.Path("/out/result").write_text("fine")))
"""
"""What a program tries that has taken over the process: what of it succeeded."""


def line_of_the_page(program: str = BUILD) -> str:
    """The command of the page, or the same walls around another program."""
    page = (ROOT / "docs/strangers.md").read_text()
    (block,) = re.findall(r"^```text\n(bwrap .*?)```$", page, re.MULTILINE | re.DOTALL)
    assert block.endswith(f"{BUILD}\n")
    return block.replace(BUILD, program)


@pytest.fixture
def places(tmp_path):
    """The stranger's folder, the folder for the result, and a file that is neither's."""
    for name in ("stage", "out", "home"):
        (tmp_path / name).mkdir()
    head = TINY.read_text().partition("\ndef ")[0]
    (tmp_path / "home/secret.usda").write_text(head + '\ndef Xform "Secret" {}\n')
    return tmp_path


def run(places: Path, command: str, *arguments: str | Path) -> "subprocess.CompletedProcess[str]":
    """A command of the page by bash, with the variables of the page."""
    folders = {"code": ROOT, "venv": sys.prefix, "python": sys.base_prefix}
    folders |= {name: places / name for name in ("stage", "out")}
    settings = {**os.environ, **{name: str(path) for name, path in folders.items()}, "SECRET": "42"}
    words = ["bash", "-c", command, "bash", *map(str, arguments)]
    return subprocess.run(words, env=settings, capture_output=True, text=True, check=False, timeout=500)


def test_a_stage_is_built_and_one_that_names_a_file_outside_cannot_open_it(places):
    stage, secret = places / "stage/dataset.usda", places / "home/secret.usda"
    text = TINY.read_text().replace("../../../stages/", "")
    stage.write_text(text.replace("(32, 24)", "(8, 6)"))
    done = run(places, line_of_the_page())
    assert done.returncode == 0, done.stderr
    assert (places / "out/dataset/manifest.json").is_file()

    stage.write_text(text.replace('"Rig" (', f'"Rig" (\n        payload = @{secret}@', 1))
    link = places / "stage/link.usda"
    link.symlink_to(secret)
    named = run(places, line_of_the_page())
    stage.write_text(text.replace('"Rig" (', '"Rig" (\n        payload = @./link.usda@', 1))
    linked = run(places, line_of_the_page())
    outside = run(places, f'"$venv/bin/python" -m pipeline check "{stage}"')
    assert (named.returncode, linked.returncode) == (2, 2)
    assert "usd-invalid-asset-path" in named.stderr and "usd-invalid-asset-path" in linked.stderr
    assert "asset-outside" in outside.stdout  # where there is no wall, USD has opened it before we refuse it


def test_a_program_that_has_taken_over_reads_and_writes_nothing_outside(places):
    folders = [places / "home", places, "/stage", ROOT, sys.prefix, "/usr", "/etc", "/home", os.environ["HOME"]]
    secret = places / "home/secret.usda"
    done = run(places, line_of_the_page('"$venv/bin/python" -c "$@"'), TAKEN_OVER, secret, *folders)
    assert done.stdout.splitlines() == [
        "read False False",
        "network False",
        "environment False",
        "out True",
    ], done.stderr
    assert (places / "out/result").read_text() == "fine"
    assert [path for path in [*places.rglob("harm"), *(Path(one, "harm") for one in folders)] if path.exists()] == []
