"""What the engine costs: a dataset of many frames that is finished already, and the price of a node as graphs grow.

    python benchmarks/engine.py [--small]

At the end both commits plan and build the finished dataset in turns: what a machine does besides changes the time of a
process by a tenth from one minute to the next, which is more than the two differ by.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from beside import sides
from kept import keeping

from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.planning.plan import Specs, plan
from pipeline.engine.records import Record
from pipeline.engine.running.driver import run
from pipeline.engine.store.store import Store

STAGE = """#usda 1.0
(
    defaultPrim = "Many"
    endTimeCode = {frames}
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)

def PlenDataset "Many"
{{
    rel plen:cameras = </Many/Rig/Camera>
    rel plen:targets = </Many/Board>

    def "Rig" (
        prepend references = @rigs/conventional_100mm.usda@
    )
    {{
        over "Camera"
        {{
            float horizontalAperture = 8
            uniform int plen:image:samples = 4
            uniform int plen:truth:samples = 4
            float verticalAperture = 6
        }}

        over "Sensor"
        {{
            uniform double plen:pixelPitch = 0.1
            uniform int2 plen:resolution = (8, 6)
        }}
    }}

    def PlenCheckerboard "Board"
    {{
        uniform int plen:columns = 3
        uniform int plen:rows = 2
        uniform double plen:squareSize = 0.3
        double3 xformOp:translate.timeSamples = {{
{samples}
        }}
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
}}
"""

EDITS = (
    ("1: (0, 0, -434", "1: (0.001, 0, -434"),
    ("squareSize = 0.3", "squareSize = 0.31"),
    ("pixelPitch = 0.1", "pixelPitch = 0.11"),
    ("image:samples = 4", "image:samples = 8"),
    ("truth:samples = 4", "truth:samples = 8"),
)


def stage_of(frames: int) -> str:
    """Text of a dataset whose board moves by a micrometre from frame to frame."""
    samples = "\n".join(f"            {n}: (0, 0, {-434 - n / 1000})," for n in range(1, frames + 1))
    return STAGE.format(frames=frames, samples=samples)


def many_frames(folder: Path, frames: int, turns: int) -> None:
    """Times of `plan` and `build` when there is nothing to do, and after edits, each in a process of its own."""
    stage = folder / "dataset.usda"
    stage.write_text(stage_of(frames), encoding="utf-8")
    environment = {**os.environ, "PIPELINE_REPORT": "no", "PIPELINE_CACHE": str(folder / "store")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # else every process compiles all modules anew

    def command_line(*arguments: str) -> tuple[float, float, str]:
        start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "pipeline.cli", *arguments]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
        wall_s, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
        return wall_s, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout

    cold_s, _, output = command_line("build", "dataset.usda", "-o", "out", "--json")
    tasks = len(json.loads(output)["tasks"])
    print(f"{frames} frames, {tasks} tasks: cold build {cold_s:.1f} s")
    for name, arguments in {"plan": ("plan",), "build": ("build", "--json", "-q")}.items():
        times = [command_line(*arguments, "dataset.usda", "-o", "out") for _ in range(turns)]
        wall_s, cpu_s = min(wall_s for wall_s, _, _ in times), min(cpu_s for _, cpu_s, _ in times)
        print(f"  warm {name:<6} {wall_s:.2f} s, of them computing {cpu_s:.2f} s (best of {turns})", flush=True)
    assert json.loads(times[0][2])["executed"] == 0
    text = stage.read_text(encoding="utf-8")
    for count, edited in enumerate(_edited(text), 1):
        stage.write_text(edited, encoding="utf-8")
        wall_s, cpu_s, output = command_line("plan", "dataset.usda", "-o", "out")
        assert "dataset.usda:" in output
        print(f"  plan after {count} edits {wall_s:.2f} s, of them computing {cpu_s:.2f} s", flush=True)


def in_turns(frames: int, turns: int, *, now_alone: bool) -> None:
    """Computing time to plan and to build a finished dataset, the least of some turns; the old commit begins each."""
    with sides(now_alone=now_alone) as found:
        stage = found[0].home.parent / "dataset.usda"
        stage.write_text(stage_of(frames), encoding="utf-8")
        verbs = {"plan": ("plan",), "build": ("build", "--json", "-q")}
        for side in found:
            side.cpu_s("build", str(stage), "-q", "-o", str(side.home / "out"))
        print(f"finished, {frames} frames, the least of {turns} turns")
        for name, words in verbs.items():
            rows = [
                [side.cpu_s(*words, str(stage), "-o", str(side.home / "out")) for side in found] for _ in range(turns)
            ]
            least = [min(column) for column in zip(*rows, strict=True)]
            told = ", ".join(f"{side.name} {seconds:.2f} s" for side, seconds in zip(found, least, strict=True))
            print(f"  {name:<6} {told}, the last over the first {least[-1] / least[0]:.2f}", flush=True)


def _edited(text: str) -> Iterator[str]:
    """The stage after one edit, after two, and so on: all frames depend on all but the first."""
    for old, new in EDITS:
        assert old in text
        text = text.replace(old, new, 1)
        yield text


def price_of_a_node(folder: Path, sizes: tuple[int, ...]) -> None:
    """Computing time per task to make it, to keep its result, to plan it and to build it again, for graphs that grow.

    One task reads all others, as a certificate reads all frames.
    """
    for size in sizes:
        store = Store(folder / f"store{size}")
        start = time.process_time()
        graph = TaskGraph()
        kind = "pipeline.products.camera.make:camera"
        graph.add("first", kind, {"camera": {}})
        for n in range(2, size):
            graph.add(f"image/{n:05d}", kind, {"pose": [[n * 0.1] * 4] * 4}, {"camera": "first"})
        graph.add("last", kind, {}, {name: name for name in graph})
        graph.priorities()
        made_s = time.process_time() - start
        specs, records = Specs(store), {}
        specs.of(graph["first"], {})  # reads the code once
        start = time.process_time()
        for name in graph:
            spec = specs.of(graph[name], records)
            path = store.new_path()
            path.write_text(name, encoding="utf-8")
            entry = store.put_file(path)
            records[name] = store.put_record(Record(key=spec.key, outputs={"a": entry}, components=spec.components))
        kept_s = time.process_time() - start
        start = time.process_time()
        assert all(task.state == "cached" for task in plan(graph, Store(store.root), {}))
        plan_s = time.process_time() - start
        start = time.process_time()
        assert len(run(graph, Store(store.root)).records) == size
        run_s = time.process_time() - start
        made, kept, planned, passed = (1e6 * seconds / size for seconds in (made_s, kept_s, plan_s, run_s))
        print(
            f"{size:6} nodes: {made:4.0f} µs to make, {kept:4.0f} µs to keep, {planned:4.0f} µs to plan,"
            f" {passed:4.0f} µs to build again, each",
            flush=True,
        )


def main() -> None:
    """Run both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="only to show that it runs")
    parser.add_argument("--frames", type=int, default=1000)
    chosen = parser.parse_args()
    small = chosen.small
    with tempfile.TemporaryDirectory() as folder:
        price_of_a_node(Path(folder), (100, 300) if small else (100, 1000, 10_000))
        many_frames(Path(folder), 3 if small else chosen.frames, 1 if small else 5)
    in_turns(3 if small else chosen.frames, 1 if small else 9, now_alone=small)


if __name__ == "__main__":
    with keeping("engine", compared=True):
        main()
