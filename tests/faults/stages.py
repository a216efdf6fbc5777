"""Hostile stages: damaged bytes, brackets without end, and files that are exchanged while they are read.

`row` starts a process for them, because the process of the other rows must stay free of USD; `main` is that process.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
import zipfile
from base64 import b64decode
from pathlib import Path

from faults.workbench import Row, Workbench

HEAD = '#usda 1.0\n(\n    defaultPrim = "A"\n    metersPerUnit = 0.001\n    upAxis = "Y"\n)\n'
STAGE = HEAD + 'def Xform "A" (\n    prepend references = @./folder/part.usda@\n)\n{\n}\n'
PART = HEAD + 'def Xform "A" (\n    doc = "PUBLIC"\n)\n{\n}\n'
SLOWEST_S = 100.0


def hostile_stages(bench: Workbench) -> Row:
    """The row of the table."""
    row = Row("R15 R33", "hostile stages: damaged usda, usdc, usdz; swaps while reading; nesting")
    paths = os.pathsep.join(filter(None, sys.path))
    code = f"import sys; from faults.stages import main; main({bench.whole}, {str(bench.new_place())!r})"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": paths},
    )
    if done.returncode != 0:
        row.tried, row.wrong = 1, 1
        row.notes = done.stderr.strip().splitlines()[-1:]
        return row
    counts = json.loads(done.stdout.splitlines()[-1])
    row.tried, row.failed, row.wrong, row.notes = counts["tried"], counts["failed"], counts["wrong"], counts["notes"]
    return row


def main(whole: bool, folder: str) -> None:
    """Try all of them, and print the counts as JSON."""
    tally = Tally(Path(folder))
    tally.damage(1000 if whole else 20, 60 if whole else 1)
    tally.nesting()
    tally.swaps("part.usda", 1000 if whole else 30)
    tally.swaps("part.usdz", 100 if whole else 3)
    tally.swaps("picture.png", 1000 if whole else 30)
    if whole:
        tally.untrusted(24)
    print(json.dumps({"tried": tally.tried, "failed": tally.failed, "wrong": len(tally.notes), "notes": tally.notes}))


class Tally:
    """What became of hostile stages; a note for each that did harm."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.tried, self.failed, self.notes = folder, 0, 0, []
        (folder / "pipeline.toml").touch()

    def damage(self, texts: int, binaries: int) -> None:
        """Changed bytes in texts and packages, and in binary layers, each of which costs a process."""
        from hostile.damage import damaged, sources

        for suffix, data in sources(self.folder).items():
            for seed in range(binaries if suffix == ".usdc" else texts):
                self._read(f"damaged{seed}{suffix}", damaged(data, 10_000 + seed))

    def nesting(self) -> None:
        """Brackets in brackets, to the end of the stack."""
        for opening, closing in (('def "A"\n{\n', "}\n"), ("(", ")"), ("[", "]"), ("{", "}")):
            self._read("nested.usda", (HEAD + opening * 100_000 + closing * 100_000).encode())

    def swaps(self, name: str, count: int) -> None:
        """A link that leads now inside and now outside while a stage is read that names a file below it."""
        from hostile.attempt import write
        from hostile.values import Attempt
        from PIL import Image, PngImagePlugin

        from pipeline.scene.load import load

        outside = Path(tempfile.mkdtemp(dir=self.folder.parent))
        for place, text in ((outside, PART.replace("PUBLIC", "SECRET")), (self.folder / "own", PART)):
            place.mkdir(exist_ok=True)
            (place / "part.usda").write_text(text)
            with zipfile.ZipFile(place / "part.usdz", "w") as archive:
                archive.write(place / "part.usda", "part.usda")
            note = PngImagePlugin.PngInfo()
            note.add_text("doc", text)
            Image.new("L", (1, 1)).save(place / "picture.png", pnginfo=note)
        if name == "picture.png":
            sky = Attempt("sky", "Lamp", "inputs:texture:file", "asset", f"./folder/{name}")
            write(sky, self.folder).rename(self.folder / "swapped.usda")
        else:
            (self.folder / "swapped.usda").write_text(STAGE.replace("part.usda", name))
        (self.folder / "folder").unlink(missing_ok=True)
        (self.folder / "folder").symlink_to("own")
        code = "import itertools, os, sys\nfor to in itertools.cycle(sys.argv[2:]):\n"
        code += "    os.symlink(to, sys.argv[1] + '.new'); os.rename(sys.argv[1] + '.new', sys.argv[1])"
        command = [sys.executable, "-c", code, str(self.folder / "folder"), "own", str(outside)]
        swapper = subprocess.Popen(command)
        try:
            for _ in range(count):
                loaded = load(self.folder / "swapped.usda")
                pictures = loaded.dataset.pictures if loaded.dataset else ()
                told = loaded.flattened + "".join(map(str, loaded.problems))
                told += "".join(str(b64decode(one.encoded)) for one in pictures)
                self.tried += 1
                self.failed += bool(loaded.errors)
                if "SECRET" in told or not (loaded.errors or "PUBLIC" in told):
                    self.notes.append("told what lies outside")
        finally:
            swapper.kill()
            swapper.wait()

    def untrusted(self, count: int) -> None:
        """Damaged layers through `--untrusted`."""
        from hostile.damage import damaged, sources

        from pipeline.app.sandbox import problems_of_untrusted

        for suffix, data in sources(self.folder).items():
            for seed in range(count // 3):
                path = self.folder / f"untrusted{seed}{suffix}"
                path.write_bytes(damaged(data, 20_000 + seed))
                rows, _ = problems_of_untrusted(path, ())
                self._judge(path.name, [(row["file"], row["line"] or row["at"], row["severity"]) for row in rows])

    def _read(self, name: str, data: bytes) -> None:
        from pipeline.scene.load import load

        path, start = self.folder / name, time.monotonic()
        path.write_bytes(data)
        try:
            problems = load(path).problems
        except Exception as error:
            self.notes.append(f"{name}: {type(error).__name__}")
            return
        self._judge(name, [(one.file, one.line or one.at, one.severity) for one in problems])
        if time.monotonic() - start > SLOWEST_S:
            self.notes.append(f"{name} takes too long")

    def _judge(self, name: str, places: list[tuple]) -> None:
        self.tried += 1
        self.failed += any(severity == "error" for *_, severity in places)
        if not all(file and place for file, place, _ in places):
            self.notes.append(f"{name}: no place")
