"""`pipeline watch`: an edit of a layer ends the build that it supersedes, and begins another one."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from pipeline.app.verbs import watch

TINY = Path(__file__).parents[1] / "data/tiny_conventional/dataset.usda"
LIMIT_S = 240


@pytest.fixture
def watching(tmp_path):
    """A copy of the dataset whose values lie in a sublayer, and `pipeline watch` on it."""
    text = TINY.read_text(encoding="utf-8").replace("@../../../stages/", "@")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/lower.usda").write_text(text, encoding="utf-8")
    head = text.partition("def PlenDataset")[0]
    head = head.replace("#usda 1.0\n(", "#usda 1.0\n(\n    subLayers = [\n        @./parts/lower.usda@\n    ]", 1)
    (tmp_path / "dataset.usda").write_text(head, encoding="utf-8")
    settings = {**os.environ, "PIPELINE_CACHE": str(tmp_path / "store")}
    command = [sys.executable, "-m", "pipeline.cli", "watch", "dataset.usda", "-o", "out", "-j1"]
    with (tmp_path / "log.txt").open("w") as log:
        process = subprocess.Popen(command, cwd=tmp_path, env=settings, stdout=log, stderr=log)
        yield tmp_path, process
        process.kill()
        process.wait()


def until(holds, log):
    """Wait until something holds."""
    give_up = time.monotonic() + LIMIT_S
    while not holds():
        assert time.monotonic() < give_up, log.read_text()
        time.sleep(0.1)


def edit(folder, old, new):
    """Replace text of the sublayer, as an editor does."""
    lower = folder / "parts/lower.usda"
    lower.write_text(lower.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")


class Enough(Exception):
    """Ends the loop of `watch`, which goes on for ever."""


def test_an_edit_of_a_layer_that_a_build_has_read_ends_it_and_begins_another(tmp_path, monkeypatch):
    """With builds that only report what they read, and then sleep."""
    stage, layer, builds, told = tmp_path / "dataset.usda", tmp_path / "parts/lower.txt", [], []
    layer.parent.mkdir()
    stage.touch()
    layer.touch()

    def start(arguments):
        Path(arguments[-1]).write_text(json.dumps({"event": "begin", "reads": [str(layer)]}) + "\n", encoding="utf-8")
        builds.append(subprocess.Popen([sys.executable, "-ISc", "import time; time.sleep(60)"], process_group=0))
        threading.Timer(0.4, layer.write_text, [f"edit {len(builds)}"]).start()
        return builds[-1]

    def note(text):
        told.append(text)
        if len(told) == 2:
            raise Enough

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(watch, "_start", start)
    monkeypatch.setattr(watch, "note", note)
    with pytest.raises(Enough):
        watch._build_on_every_edit(stage, ["build", str(stage)])
    assert told == ["changed: parts/lower.txt"] * 2
    assert [build.poll() for build in builds] == [-signal.SIGTERM] * 2


@pytest.mark.heavy
def test_an_edit_of_a_layer_builds_again_and_ctrl_c_ends_it(watching):
    folder, process = watching
    log = folder / "log.txt"
    until(lambda: (folder / "out/manifest.json").exists(), log)
    edit(folder, "plen:squareSize = 1.4", "plen:squareSize = 1.5")
    until(lambda: "changed: " in log.read_text(), log)
    # While the build for 1.5 is at work, or just before it looks at its files: then it builds 1.6 and says nothing.
    edit(folder, "plen:squareSize = 1.5", "plen:squareSize = 1.6")
    until(lambda: b"squareSize = 1.6" in (folder / "out/dataset.usda").read_bytes(), log)
    until(lambda: log.read_text().count(" 0 failed, 0 skipped") >= 2, log)  # said after the last file is there
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=60) == 130
