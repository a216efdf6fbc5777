"""Build a dataset: the way from a stage to its output folder."""

import platform
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pipeline
from pipeline.declared import arguments_settled, number, whole
from pipeline.engine import session
from pipeline.engine.engines import Engine, Processes
from pipeline.engine.events import silent
from pipeline.engine.graph import TASKS, TaskGraph
from pipeline.engine.libraries import installed_version
from pipeline.engine.locks import Errand, locked
from pipeline.engine.project import Project
from pipeline.engine.result import Result
from pipeline.engine.store import Store
from pipeline.errors import UsageError
from pipeline.kernel_files import make_folder, read, say, write
from pipeline.limits import limits
from pipeline.processor import level
from pipeline.scene.dataset import Dataset
from pipeline.scene.load import Loaded, load, require_dataset
from pipeline.tasks.devices import on_device
from pipeline.tasks.first_order import CONVENTIONS
from pipeline.tasks.graph import graph_of
from pipeline.tasks.preview import folder_of, only_images, preview_of
from pipeline.tasks.sandbox import project_of_untrusted

__all__ = ["TASKS", "build", "compile_once", "default_out", "project"]

_VERSIONS = ("usd-core", "numpy", "scipy", "numba", "embreex", "OpenEXR", "pillow", "colour-science")

_MOST_JOBS = 10_000
_SHORTEST_S = 1e-3


def default_out(stage: Path) -> Path:
    """`build/<folder>/` for a file named dataset.usda, else `build/<stem>/`, in the working directory.

    Raises
    ------
    UsageError
        The file has no name to take.
    """
    stage = stage.resolve()
    name = stage.parent.name if stage.stem == "dataset" else stage.stem
    if name in ("", ".", ".."):  # as of `...usda`, whose folder would be the working directory
        raise UsageError(f"no output folder can be named after {stage}", hint="name one with -o")
    return Path("build") / name


def project(
    path: str | Path,
    out: str | Path | None = None,
    allow_roots: Iterable[str | Path] = (),
    *,
    untrusted: bool = False,
    preview: bool = False,
    warn: Callable[[str], None] = say,
) -> Project:
    """Everything that a build of a stage consists of. Nothing is run or written.

    Parameters
    ----------
    untrusted : bool
        Read the stage in a confined process, see `sandbox`.
    preview : bool
        Pictures of a quarter of the size instead, see `preview`, by default into a folder of their own.
    warn : callable
        Gets what a confined process lacks on this machine.

    Raises
    ------
    StageError
        The stage does not pass `check`; the error carries all problems.
    """
    place = Path(out) if out else default_out(Path(path))
    place = folder_of(place) if preview and not out else place
    if untrusted:
        return project_of_untrusted(Path(path), place, allow_roots, preview=preview, warn=warn)
    return project_from(load(path, allow_roots), Path(path), place, preview=preview)


def project_from(loaded: Loaded, path: Path, out: Path, *, preview: bool = False) -> Project:
    """The project of a stage that was loaded, or of its preview."""
    dataset = require_dataset(loaded, path)
    if preview:
        return only_images(_project_of(preview_of(dataset), loaded, path, out))
    return _project_of(dataset, loaded, path, out)


def _project_of(dataset: Dataset, loaded: Loaded, path: Path, out: Path) -> Project:
    graph, files, certificates = graph_of(dataset)
    files["dataset.usda"] = loaded.flattened.encode()
    head = {
        "stage": f"{path.name} </{dataset.stage_name}>",
        "conventions": CONVENTIONS,
        "versions": {
            "pipeline": pipeline.__version__,
            **{name: installed_version(name) for name in _VERSIONS},
        },
        "seeds": {"dataset": dataset.seed},
    }
    return Project(
        graph=graph,
        files=files,
        head=head,
        findings={
            "certificate": certificates,
            "points": {name: (task, "points.json") for name, (task, _) in certificates.items()},
        },
        out=out,
        stage_id=str(path.resolve()),
        reads=loaded.files,
        places={camera.name: f"{camera.file}:{camera.line}: at <{camera.prim_path}>" for camera in dataset.cameras},
        source=loaded.composed.to_plain() if loaded.composed else None,
    )


@arguments_settled(UsageError)
def build(
    path: str | Path,
    out: str | Path | None = None,
    *,
    jobs: int | None = None,
    keep_going: bool = False,
    force: Iterable[str] = (),
    until: Iterable[str] = (),
    targets: Iterable[str] = (),
    retries: int = 0,
    timeout_s: float | None = None,
    check_percent: float = 0.0,
    allow_roots: Iterable[str | Path] = (),
    untrusted: bool = False,
    preview: bool = False,
    engine: str | None = None,
    device: str | None = None,
    on_event: Callable[[dict[str, Any]], None] | None = None,
) -> Result:
    """Build a dataset stage: run what is missing, fill the output folder.

    Parameters
    ----------
    path : str or Path
        The stage, e.g. `examples/02_plenoptic/dataset.usda`.
    out : str or Path, optional
        Output folder; see `default_out`.
    jobs : int, optional
        Worker processes, by default one per core; 1 runs everything in this process.
    keep_going : bool
        Go on with what does not depend on a task that failed.
    force, until : iterable of str
        Tasks to run in any case; tasks after which to stop, with nothing delivered.
    targets : iterable of str
        Tasks, or files and folders of the output folder: what they need runs, and their files alone are delivered.
    retries : int
        How often a task that failed is tried again.
    timeout_s : float, optional
        A task that takes longer has failed [s].
    check_percent : float
        Share of the tasks that are computed twice, to compare their bytes [%].
    allow_roots : iterable of str or Path
        Further folders that the stage may reference.
    untrusted : bool
        Read the stage in a confined process, and bound memory and time of each task by `limits`.
    preview : bool
        Make pictures of a quarter of the size with few samples, and nothing else, into `OUT.preview`.
    engine : str, optional
        `dask:tcp://host:8786` or `dask:FILE`: run tasks on a Dask cluster, whose workers share only the store.
    device : str, optional
        `cuda`: trace position images on a CUDA device; their keys name it. See `devices`.
    on_event : callable, optional
        Gets a dict for every start and end of a task.

    Returns
    -------
    Result
        With `out`, `executed`, `cached`, `failed` and the tasks; failures are in it, not raised.

    Raises
    ------
    StageError
        The stage does not pass `check`; then nothing is written.
    UsageError
        An argument is not of its kind, or out of its range.
    """
    whole("jobs", 1 if jobs is None else jobs, UsageError, 1, _MOST_JOBS)
    whole("retries", retries, UsageError, 0, _MOST_JOBS)
    number("timeout_s", 1.0 if timeout_s is None else timeout_s, UsageError, _SHORTEST_S)
    number("check_percent", check_percent, UsageError, 0.0, 100.0)
    listener = on_event or silent

    def warn(text: str) -> None:
        listener({"event": "warning", "text": text})

    dataset = project(path, out, allow_roots, untrusted=untrusted, preview=preview, warn=warn)
    if device is not None:
        dataset = on_device(dataset, device, untrusted=untrusted, engine=engine)
    return session.build(
        dataset,
        jobs=jobs,
        keep_going=keep_going,
        force=force,
        until=until,
        targets=targets,
        retries=retries,
        timeout_s=timeout_s,
        check_percent=check_percent,
        engine=_place(engine, jobs, timeout_s, untrusted=untrusted),
        on_event=listener,
        prepare=lambda: compile_once(warn, dataset.graph),
    )


def _place(
    cluster: str | None, jobs: int | None, timeout_s: float | None, *, untrusted: bool
) -> Callable[[Store, tuple[str, ...]], Engine] | None:
    """Another place for tasks than usual: a cluster, or workers that may not take whatever a stage makes them need."""
    most = limits()
    if untrusted and timeout_s is None:
        timeout_s = most.task_s
    if cluster:
        from pipeline.engine.cluster import engine_of

        return engine_of(cluster, timeout_s)
    if not untrusted:
        return None
    return lambda store, packages: Processes(
        store, packages, session.worker_count(jobs), timeout_s=timeout_s, memory_bytes=most.task_bytes
    )


def compile_once(warn: Callable[[str], None] = say, graph: TaskGraph | None = None) -> None:
    """Compile kernels that are not there and whole, before several workers would each do it.

    All kernels, or those that the tasks of a graph call. A list beside them says which there are. Builders that start
    together wait for the first one.

    Raises
    ------
    EnvironmentFault
        The disk is full.
    """
    from pipeline.jit import cache_folder
    from pipeline.tasks.kernel_steps import STEPS, steps_of

    folder = cache_folder()
    steps = tuple(STEPS) if graph is None else steps_of(graph[name] for name in graph)
    made_by = f"{level()}-numba-{installed_version('numba')}-python-{platform.python_version()}"
    listed = folder / f"{'-'.join(steps)}-{made_by}"
    if _are_whole(listed, warn):
        return
    make_folder(folder, warn)
    with locked(folder / "lock", errand=Errand(doing="compiles kernels", say=warn)):
        if not _are_whole(listed, warn):
            from pipeline import kernel_cache
            from pipeline.tasks.compile import compile_kernels

            compile_kernels(steps)
            write(listed, "\n".join(sorted(kernel_cache.used)).encode(), warn)


def _are_whole(listed: Path, warn: Callable[[str], None]) -> bool:
    """Whether all kernels of a list can be read; those that cannot be are named and removed."""
    names = read(listed, warn)
    if names is None:
        return False
    bad = [name for name in names.decode().split() if read(listed.with_name(name), warn) is None]
    return not bad
