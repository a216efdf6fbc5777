"""How far do the tasks of a build spread? Measured durations, scheduled on some numbers of workers.

    python benchmarks/schedule.py [STAGE] [--method METHOD] [--small]

Every task runs once, alone, in this process and with an empty store, after a tiny stage has loaded kernels and
libraries. Its duration is CPU time, user and system, which other jobs touch little; reading and checking of its inputs
are in it. The schedule is that of the engine: whoever is free takes the ready task with the longest chain of tasks
behind it. The critical path is the chain that takes longest, the time on any number of workers; efficiency is the sum
over workers times their time.
"""

import argparse
import heapq
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from kept import keep

import pipeline
from pipeline.app.build import compile_once
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.planning.plan import Specs
from pipeline.engine.running.execute import perform
from pipeline.engine.store.store import Store
from pipeline.machine.processor import settings
from pipeline.products.graph import graph_of
from pipeline.scene.load import load, require_dataset

EXAMPLES = Path(pipeline.__file__).resolve().parents[1] / "examples"
TINY = EXAMPLES.parent / "tests/data/tiny_plenoptic/dataset.usda"
WORKERS = (1, 2, 8, 64)

METHOD = """#usda 1.0
(
    defaultPrim = "{root}"
    metersPerUnit = 0.001
    upAxis = "Y"
    startTimeCode = {first}
    endTimeCode = {last}
    timeCodesPerSecond = 24
    subLayers = [
        @{stage}@
    ]
)

over "{root}"
{{
    over "Rig"
    {{
        over "Camera"
        {{
            uniform token plen:truth:method = "{method}"
        }}
    }}
}}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stage", nargs="?", type=Path, default=EXAMPLES / "02_plenoptic/dataset.usda")
    parser.add_argument("--method", help="of the ground truth; else as the stage says")
    parser.add_argument("--small", action="store_true", help="a tiny stage: does it run at all?")
    options = parser.parse_args()
    if any(os.environ.get(name) != value for name, value in settings().items()):
        # NumPy reads them when it is loaded, and tasks refuse a process that rounds otherwise than their keys say.
        os.execve(sys.executable, sys.orig_argv, {**os.environ, **settings()})
    stage = TINY if options.small else options.stage
    compile_once()
    with tempfile.TemporaryDirectory() as folder:
        durations(graph_at(TINY, options.method, Path(folder)), Store(Path(folder) / "warm"))
        graph = graph_at(stage.resolve(), options.method, Path(folder))
        seconds = durations(graph, Store(Path(folder) / "store"))
    found = schedules(graph, seconds)
    tell(graph, seconds, found)
    if not options.small:
        keep(f"schedule_{stage.resolve().parent.name}{'_' + options.method if options.method else ''}", found)


def graph_at(stage: Path, method: str | None, folder: Path) -> TaskGraph:
    """Tasks of a stage, with another method of ground truth if one is named."""
    if method:
        dataset = require_dataset(load(stage), stage)
        numbers = [frame.number for frame in dataset.frames]
        frames = {"first": min(numbers), "last": max(numbers)}
        path = folder / "dataset.usda"
        text = METHOD.format(stage=stage, root=dataset.stage_name, method=method, **frames)
        path.write_text(text, encoding="utf-8")
        stage = path
    return graph_of(require_dataset(load(stage, [stage.parent, EXAMPLES.parent]), stage))[0]


def durations(graph: TaskGraph, store: Store) -> dict[str, float]:
    """CPU seconds of every task."""
    specs, records, seconds = Specs(store), dict[str, Any](), {}
    for name in graph:
        spec = specs.of(graph[name], records)
        start = time.process_time()
        (reply,) = perform([spec], store, graph.packages)
        seconds[name] = time.process_time() - start
        if reply.state == "failed":
            raise SystemExit(f"{name}: {reply.error}")
        records[name] = reply.record
    return seconds


def schedules(graph: TaskGraph, seconds: dict[str, float]) -> dict[str, Any]:
    """Sum, critical path, and for each number of workers the time and efficiency: plain data."""
    longest: dict[str, float] = {}
    before: dict[str, str] = {}
    for name in graph:
        first = max(graph.sources(name), key=lambda source: longest[source], default=None)
        longest[name] = seconds[name] + (longest[first] if first else 0.0)
        before[name] = first or ""
    path = [max(longest, key=lambda name: longest[name])]
    while before[path[-1]]:
        path.append(before[path[-1]])
    whole = sum(seconds.values())
    times = {str(workers): time_on(graph, seconds, workers) for workers in WORKERS}
    return {
        "tasks": len(seconds),
        "sum_s": round(whole, 3),
        "critical_path_s": round(longest[path[0]], 3),
        "critical_path": [{"task": name, "seconds": round(seconds[name], 3)} for name in reversed(path)],
        "workers": {
            number: {"seconds": round(took, 3), "efficiency": round(whole / (int(number) * took), 3)}
            for number, took in times.items()
        },
    }


def time_on(graph: TaskGraph, seconds: dict[str, float], workers: int) -> float:
    """Time of the engine's schedule on some workers."""
    priority, waiting = graph.priorities(), {name: len(set(graph.sources(name))) for name in graph}
    ready = [(-priority[name], name) for name in graph if not waiting[name]]
    heapq.heapify(ready)
    running: list[tuple[float, str]] = []
    now = 0.0
    while ready or running:
        while ready and len(running) < workers:
            _, name = heapq.heappop(ready)
            heapq.heappush(running, (now + seconds[name], name))
        now, done = heapq.heappop(running)
        for reader in graph.readers(done):
            waiting[reader] -= 1
            if not waiting[reader]:
                heapq.heappush(ready, (-priority[reader], reader))
    return now


def tell(graph: TaskGraph, seconds: dict[str, float], found: dict[str, Any]) -> None:
    """Print kinds, path and schedules."""
    kinds: dict[str, list[float]] = {}
    for name, took in seconds.items():
        kinds.setdefault(graph[name].short_kind, []).append(took)
    print("kind                tasks   CPU s   longest")
    for kind, each in sorted(kinds.items(), key=lambda item: -sum(item[1])):
        print(f"{kind:18s}  {len(each):5d}  {sum(each):6.2f}  {max(each):8.2f}")
    chain = " > ".join(f"{step['task']} {step['seconds']:.2f}" for step in found["critical_path"])
    print(f"sum {found['sum_s']:.1f} s; critical path {found['critical_path_s']:.2f} s: {chain}")
    for number, on in found["workers"].items():
        print(f"{number:>3s} workers: {on['seconds']:7.2f} s, efficiency {on['efficiency']:.0%}")


if __name__ == "__main__":
    main()
