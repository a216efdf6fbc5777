"""How much memory does a worker take on a sensor of 29 megapixels? The highest resident size of every kind of task.

    python benchmarks/memory.py [--small] [--keep FOLDER]

The paper's plenoptic rig behind 6576 x 4384 pixels of 5.5 µm, K = 2, one frame, every method of ground truth. Each task
runs in a process of its own. One tile of each kind runs as it is. The whole, at full size, is joined from that
one and others of one value; tiles of micro-images and of target points run all. So position images see no point of the
board: the ground truth searches all of them.
"""

import argparse
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from kept import keep

from pipeline.engine.planning.graph import Task, TaskGraph
from pipeline.files.npy import read_npy, write_npy
from pipeline.machine.facts import peak_bytes, reset_peak
from pipeline.products.graph import graph_of
from pipeline.records.plain import from_plain
from pipeline.scene.load import load, require_dataset

CAMERA = "Rig.Camera"

STAGE = """#usda 1.0
(
    defaultPrim = "Large"
    endTimeCode = 1
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)

def PlenDataset "Large"
{{
    rel plen:cameras = </Large/Rig/Camera>
    rel plen:targets = </Large/Board>

    def "Rig" (
        prepend references = @rigs/plenoptic_michels_2019.usda@
    )
    {{
        over "Camera"
        {{
            float horizontalAperture = {width_tenths_mm}
            uniform token plen:truth:method = "{method}"
            float verticalAperture = {height_tenths_mm}
        }}

        over "Sensor"
        {{
            uniform double plen:pixelPitch = 0.0055
            uniform int2 plen:resolution = ({width_px}, {height_px})
        }}

        over "Microlenses"
        {{
            uniform double plen:height = {height_mm}
            uniform double plen:width = {width_mm}
        }}
    }}

    def PlenCheckerboard "Board"
    {{
        uniform int plen:columns = 7
        uniform int plen:rows = 4
        uniform double plen:squareSize = 2
        quatd xformOp:orient.timeSamples = {{
            1: (0.9844702839913732, 0.004545579370543608, 0.17358867277340387, -0.02577926164379328),
        }}
        double3 xformOp:translate.timeSamples = {{
            1: (-1, 0.5, -420),
        }}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
    }}
}}
"""


class Bench:
    """Runs tasks of graphs and keeps what they wrote and took.

    Parameters
    ----------
    folder : Path
        Gets a folder for each task.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.rows = folder, list[dict[str, Any]]()

    def run(self, graph: TaskGraph, name: str, label: str) -> None:
        """One task in a process of its own, on what is there of the tasks that it reads; noted under a label."""
        task, out = graph[name], self.folder / name
        took_file = out.parent / f"{out.name} {label}.took"
        if not took_file.exists():
            took_file.write_text(json.dumps(self._measured(task, out)), encoding="utf-8")
        self.rows.append({"task": label, **json.loads(took_file.read_text(encoding="utf-8"))})
        tell(self.rows[-1])

    def _measured(self, task: Task, out: Path) -> dict[str, float]:
        """What a task takes."""
        out.mkdir(parents=True, exist_ok=True)
        spec = {"kind": task.kind, "params": task.params, "inputs": self._inputs(task), "out": str(out)}
        (out.parent / f"{out.name}.json").write_text(json.dumps(spec), encoding="utf-8")
        command = [sys.executable, str(Path(__file__).resolve()), "--task", str(out.parent / f"{out.name}.json")]
        said = subprocess.run(command, capture_output=True, text=True, check=False)
        if said.returncode:
            raise SystemExit(f"{task.name}: {said.stderr}")
        return dict(json.loads(said.stdout.splitlines()[-1]))

    def run_all(self, graph: TaskGraph, kind: str) -> None:
        """All tasks of a kind; the largest counts."""
        before, self.rows = self.rows, []
        names = tiles_of(graph, kind)
        for name in names:
            self.run(graph, name, kind)
        if names:
            peak, total = max(row["peak_bytes"] for row in self.rows), sum(row["cpu_s"] for row in self.rows)
            before.append({"task": f"{kind}, largest of {len(names)}", "peak_bytes": peak, "cpu_s": round(total, 1)})
            tell(before[-1])
        self.rows = before

    def one_for_all(self, graph: TaskGraph, kind: str) -> None:
        """The first tile of a kind, and for the others arrays of its first value."""
        names = tiles_of(graph, kind)
        if not names:
            return
        self.run(graph, names[0], f"{kind}, one of {len(names)}")
        for name in names[1:]:
            (self.folder / name).mkdir(parents=True, exist_ok=True)
            share = height_of(graph[name]) / height_of(graph[names[0]])
            alike = next((one for one in names[1:] if height_of(graph[one]) == height_of(graph[name])), name)
            for file in (self.folder / names[0]).iterdir():
                copy = self.folder / name / file.name
                if copy.exists():
                    continue
                if alike != name:
                    os.link(self.folder / alike / file.name, copy)
                else:
                    pixels = read_npy(file)
                    write_npy(copy, np.full_like(pixels[: round(len(pixels) * share)], pixels.flat[0]))

    def _inputs(self, task: Task) -> dict[str, dict[str, str]]:
        return {
            role: {file.name: str(file) for file in sorted((self.folder / source).iterdir())}
            for role, source in task.reads.items()
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="few pixels: does it run at all?")
    parser.add_argument("--keep", type=Path, help="make files here, leave them, and go on with what is there")
    parser.add_argument("--task", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.task:
        work(json.loads(options.task.read_text(encoding="utf-8")))
        return
    size = (328, 220) if options.small else (6576, 4384)
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        rows = measure(Bench(folder / "tasks"), folder, size)
    if not options.small:
        keep("memory", {"width_px": size[0], "height_px": size[1], "supersampling": 2, "tasks": rows})


def work(spec: dict[str, Any]) -> None:
    """Run a task here, and print what it took."""
    inputs = {role: {name: Path(file) for name, file in files.items()} for role, files in spec["inputs"].items()}
    module, _, name = spec["kind"].partition(":")
    task = getattr(importlib.import_module(module), name or "run")
    reset_peak()
    start = time.process_time()
    record, out = typing.get_type_hints(task)["params"], Path(spec["out"])
    if typing.get_origin(record) is Sequence:  # it takes tasks in company
        task([from_plain(typing.get_args(record)[0], spec["params"])], inputs, [out])
    else:
        task(from_plain(record, spec["params"]), inputs, out)
    print(json.dumps({"peak_bytes": peak_bytes(), "cpu_s": round(time.process_time() - start, 2)}))


def measure(bench: Bench, folder: Path, size: tuple[int, int]) -> list[dict[str, Any]]:
    """All kinds of tasks; what each took."""
    print("task                                  peak MB     CPU s")
    rig, searched = graph_with(folder, size, "direct"), graph_with(folder, size, "two-plane")
    bench.run(rig, f"camera/{CAMERA}", "camera")
    bench.run(rig, f"camera/{CAMERA}/planes", "camera with planes")
    bench.run(rig, f"pinhole/{CAMERA}", "pinhole")
    bench.run_all(rig, "micro_images_tile")
    bench.run(rig, f"micro_images/{CAMERA}", "micro_images")
    bench.one_for_all(searched, "rays_tile")
    bench.run(searched, f"rays/{CAMERA}", "rays")
    bench.run_all(rig, "truth_tile")
    bench.run(rig, f"truth/{CAMERA}/0001", "truth, direct")
    bench.run(rig, f"certificate/{CAMERA}", "certificate")
    bench.run(searched, f"truth/{CAMERA}/0001", "truth, two-plane")
    for kind, joined in (("white_tile", f"white/{CAMERA}"), ("image_tile", f"image/{CAMERA}/0001")):
        bench.one_for_all(rig, kind)
        bench.run(rig, joined, kind.partition("_")[0])
    traced = graph_with(folder, size, "image")
    bench.run(traced, f"positions/{CAMERA}/0001", "positions")
    bench.run(traced, f"truth/{CAMERA}/0001", "truth, image")
    return bench.rows


def tiles_of(graph: TaskGraph, kind: str) -> list[str]:
    """Names of all tasks of a kind."""
    return [name for name in graph if graph[name].short_kind == kind]


def height_of(tile: Task) -> int:
    """Rows of the image in a tile."""
    first, end = tile.params["rows"] if "rows" in tile.params else (tile.params["first_row"], tile.params["end_row"])
    return int(end - first)


def graph_with(folder: Path, size: tuple[int, int], method: str) -> TaskGraph:
    """Tasks of the rig with so many pixels, by a method of ground truth."""
    width_mm, height_mm = (0.0055 * pixels + 0.4 for pixels in size)
    stage = folder / "dataset.usda"
    sides = {"width_px": size[0], "height_px": size[1], "width_mm": width_mm, "height_mm": height_mm}
    tenths = {"width_tenths_mm": 0.055 * size[0], "height_tenths_mm": 0.055 * size[1]}
    stage.write_text(STAGE.format(**sides, **tenths, method=method), encoding="utf-8")
    return graph_of(require_dataset(load(stage), stage))[0]


def tell(row: dict[str, Any]) -> None:
    """Print a line of the table."""
    print(f"{row['task']:34s}  {row['peak_bytes'] / 1e6:8.0f}  {row['cpu_s']:8.1f}", flush=True)


if __name__ == "__main__":
    main()
