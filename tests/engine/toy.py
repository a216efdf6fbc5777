"""A small project with the shape of a real one: a lens, its rays, frames, a report."""

import sys
from pathlib import Path

from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.project import Project
from pipeline.engine.records import Blob, Components, Record
from pipeline.engine.store.store import Store

KIT = Path(__file__).parent / "toykit"
FAULTY = {"fail", "flaky", "full", "hungry", "killed", "linked", "meddled", "noisy", "probe", "slow"}
POSES = ([[1.0, 0.0], [0.0, 1.0]], [[2.0, 0.0], [0.0, 1.0]])


def graph_of(*tasks) -> TaskGraph:
    graph = TaskGraph(("toykit.tasks",))
    for name, kind, params, *reads in tasks:
        module = f"faulty:{kind}" if kind in FAULTY else kind
        graph.add(name, f"toykit.tasks.{module}", params, *reads)
    return graph


def project(out: Path, *, power: float = 4.0, samples: int = 8, poses=POSES, stage: str = "toy", extra=()) -> Project:
    """Five tasks, five files."""
    tasks = [("lens", "lens", {"power": power}), ("rays/cam", "rays", {"samples": samples}, {"lens": "lens"})]
    files = {"dataset.usda": b"#usda 1.0\n", "cameras/cam/near.bin": ("rays/cam", "near.bin")}
    files["cameras/cam/far.bin"] = ("rays/cam", "planes/far.bin")
    names = []
    for number, pose in enumerate(poses):
        names.append(f"image/cam/{number:04d}")
        tasks.append((names[-1], "image", {"pose": pose}, {"rays": "rays/cam"}))
        files[f"frames/{number:04d}/cam/image.txt"] = (names[-1], "image.txt")
    tasks.append(("report", "report", {}, {name: name for name in names}))
    files["report/index.html"] = ("report", "index.html")
    head = {"stage": stage, "conventions": {"up": "Y"}, "versions": {}, "seeds": {"all": 1}, "certificate": None}
    return Project(graph=graph_of(*tasks, *extra), files=files, head=head, out=out, stage_id=stage)


def record(key: str, **outputs: Blob) -> Record:
    """A record of no task of ours."""
    none = Components(kind="none", code="", libraries={}, machine={}, params={}, inputs={})
    return Record(key=key, outputs=outputs, components=none)


def put(store: Store, data: bytes) -> Blob:
    """A blob of some bytes."""
    path = store.new_path()
    path.write_bytes(data)
    return store.put_file(path)


def bare(graph: TaskGraph, out: Path) -> Project:
    """A project that delivers nothing."""
    return Project(graph=graph, files={}, head={"stage": "bare"}, out=out, stage_id="bare")


def snapshot(folder: Path) -> dict[str, tuple[bytes, int, int]]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {
        path.relative_to(folder).as_posix(): (path.read_bytes(), path.stat().st_mtime_ns, path.stat().st_ino)
        for path in files
    }


def contents(folder: Path) -> dict[str, bytes]:
    return {name: facts[0] for name, facts in snapshot(folder).items()}


def executed(result) -> set[str]:
    return {task.name for task in result.tasks if task.state == "executed"}


def forget_imports() -> None:
    """Make the next import of the toy package read its source again."""
    from pipeline.engine.planning import task_code

    for name in [name for name in sys.modules if name.split(".")[0] == "toykit"]:
        del sys.modules[name]
    task_code._first_seen.clear()
