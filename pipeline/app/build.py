"""Build a dataset: turn a stage into its output folder."""

import contextlib
import dataclasses
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from inspect import signature
from pathlib import Path
from typing import Unpack

import pipeline
from pipeline.engine.events import Compiling, Emit, silent, warner
from pipeline.engine.files import reporting_machine_faults
from pipeline.engine.interrupts import Interrupts
from pipeline.engine.locks import locked
from pipeline.engine.options import USUAL, BuildKeywords, BuildOptions, Caller
from pipeline.engine.planning.graph import Task, TaskGraph
from pipeline.engine.planning.task_code import installed_version
from pipeline.engine.project import Project
from pipeline.engine.running import session
from pipeline.engine.running.result import Result
from pipeline.entry_points import offered, plugged_in
from pipeline.errors import UsageError
from pipeline.jit.files import cache_folder, count, make_folder, ready, set_ready
from pipeline.jit.waits import before_compiling
from pipeline.machine.facts import command
from pipeline.machine.processor import settings
from pipeline.products.camera.params import CONVENTIONS
from pipeline.products.graph import graph_of
from pipeline.products.variants import folder_of, on_device, only_images, preview_of, without_pictures
from pipeline.records.declared import arguments_settled
from pipeline.records.plain import from_plain
from pipeline.scene.load import Loaded, load, require_dataset
from pipeline.scene.usd.problems import StageError
from pipeline.scene.usd.roots import real_path
from pipeline.scene.views import NOT_SEEN
from pipeline.spelling import nearest

__all__ = ["build", "build_with", "compile_once", "default_out", "project", "run_together"]

_OWN = "lens", "aspheres", "microlenses", "micro_images", "images", "company", "shapes", "search", "sensor"
STEPS = (*_OWN, *sorted(offered("kernel")))
"""Steps of kernel compilation: tracing and quadrature of any lens; conics and aspheres; tilted and refractive
microlenses; micro-images; images of a flat sheet; images with occlusion; curved targets; the search in position images;
the noise of raw images; and those of plug-ins.
"""
_KERNELS = dict(zip(_OWN, (19, 2, 8, 1, 7, 5, 2, 3, 2), strict=True))
"""Number of kernels that each step adds, for progress reports."""
_OF_PLUG_IN = 9
"""Number of kernels that the step of a plug-in is taken to add: that of light paths."""
_KERNEL_S = 0.9
"""Processor time to compile a kernel and its callees [s], on an AMD EPYC."""
_TRUST = 0.2
"""Share of the kernels after which the speed of this machine weighs as much as that time."""
_STEP_OF_PRODUCT = {
    "image": "images",
    "white": "images",
    "micro_images": "micro_images",
    "expose": "sensor",
    "fixed_pattern": "sensor",
}
_NOT_FLAT = {"warped", "height-map", "cylinder", "mesh"}
_PART_NUMBERS = bytes(range(100))
"""Numbers of the parts in which kernels are compiled, and of more than there are."""
_VERSIONS = ("usd-core", "numpy", "scipy", "numba", "embreex", "OpenEXR", "pillow", "colour-science")


def default_out(stage: Path) -> Path:
    """`build/<folder>/` for a file named dataset.usda, else `build/<stem>/`; UsageError if that is no valid name."""
    stage = real_path(stage)
    name = stage.parent.name if stage.stem == "dataset" else stage.stem
    if name in ("", ".", ".."):  # `...usda` would name the working directory itself
        raise UsageError(f"no output folder can be named after {stage}", hint="name one with -o")
    return Path("build") / name


def project(
    path: str | Path, out: str | Path | None = None, allow_roots: Iterable[str | Path] = (), *, preview: bool = False
) -> Project:
    """The project of a stage: tasks, files and options. Nothing is run or written.

    With `preview` only small pictures, a quarter of the size (see `products.variants`), by default for another output
    folder. StageError if the stage does not pass `check`.
    """
    return project_from(load(path, allow_roots), Path(path), out, preview=preview)


def project_from(loaded: Loaded, path: Path, out: str | Path | None, *, preview: bool = False) -> Project:
    """The project of a stage that was read; parameters and errors as for `project`."""
    destination = Path(out) if out else default_out(path)
    destination = folder_of(destination) if preview and not out else destination
    dataset = require_dataset(loaded, path)
    dataset = preview_of(dataset) if preview else dataset
    draft = graph_of(dataset)
    draft.files["dataset.usda"] = loaded.flattened.encode()
    head = {
        "stage": f"{path.name} </{dataset.stage_name}>",
        "conventions": CONVENTIONS,
        "versions": {"pipeline": pipeline.__version__, **{name: installed_version(name) for name in _VERSIONS}},
        "seeds": {"dataset": dataset.seed},
    }
    project = Project(
        graph=draft.graph,
        files=draft.files,
        head=head,
        findings={
            "certificate": draft.certificates,
            "points": {name: (task, "points.json") for name, (task, _) in draft.certificates.items()},
        },
        out=destination,
        stage_id=str(path.resolve()),
        reads=loaded.files,
        places={camera.name: f"{camera.file}:{camera.line}: at <{camera.prim_path}>" for camera in dataset.cameras},
        source={"written": loaded.written, "read": {part: list(paths) for part, paths in dataset.sources.items()}},
    )
    return only_images(project) if preview else project


@arguments_settled(UsageError)
def build(
    path: str | Path,
    out: str | Path | None = None,
    *,
    on_event: Emit | None = None,
    **options: Unpack[BuildKeywords],
) -> Result:
    """Build a dataset stage: run the missing tasks and fill the output folder.

    Parameters
    ----------
    path : str or Path
        The stage, e.g. `examples/02_plenoptic/dataset.usda`.
    out : str or Path, optional
        Output folder; see `default_out`.
    on_event : callable, optional
        Called with an event of `engine.events` at every start and end of a task.
    **options
        Fields of `engine.options.BuildOptions`: jobs, keep_going, force, until, targets, retries, timeout_s,
        check_percent, engine, device, allow_roots, preview, pictures.

    Returns
    -------
    Result
        Holds `out`, `executed`, `cached`, `failed` and the tasks. Failed tasks are listed in it and raise nothing.

    Raises
    ------
    StageError
        The stage does not pass `check`; then nothing is written.
    UsageError
        An argument has the wrong type or is out of range, or an option is unknown.
    """
    names = list(signature(BuildOptions).parameters)
    for name in options.keys() - set(names):
        near = nearest(name, names)
        hint = f"did you mean {near}?" if near else f"there are {', '.join(names)}"
        raise UsageError(f"build has no option {name!r}", hint=hint)
    return build_with(path, out, BuildOptions(**options), on_event or silent)  # type: ignore[arg-type]  # or sequences


_before = list(signature(build).parameters.values())[:-1]
build.__signature__ = signature(build).replace(  # type: ignore[attr-defined]  # what notebooks complete
    parameters=[*_before, *signature(BuildOptions).parameters.values()]
)


def build_with(path: str | Path, out: str | Path | None, options: BuildOptions, on_event: Emit = silent) -> Result:
    """Build a dataset stage as `build` does, with the options in one record."""
    warn = warner(on_event)
    stages = [load(path, options.allow_roots, later=True)]
    to_build = project_from(stages[0], Path(path), out, preview=options.preview)
    to_build = to_build if options.pictures else without_pictures(to_build)
    if options.device is not None:
        to_build = on_device(to_build, options)

    def prepare() -> None:
        """Compile kernels and finish the check of the stage, once it is clear that a task has to run."""
        compile_once(on_event, steps_of(to_build.graph[name] for name in to_build.graph), options.workers)
        loaded = stages.pop()
        problems = [*loaded.problems, *loaded.doubts()]
        if any(problem.is_error for problem in problems):
            raise StageError(problems)
        for problem in problems:
            if problem.code in NOT_SEEN:
                warn(f"{problem.message}\n    hint: {problem.hint}")
        if minor := [problem for problem in problems if problem.code not in NOT_SEEN]:
            more = f" (and {len(minor) - 1} more)" if len(minor) > 1 else ""
            warn(f"{minor[0].message}{more}\n    hint: `pipeline check {path}` has file, line and prim")

    engine = None
    if options.engine:  # tasks run on a cluster, and not in workers of this machine
        kind, _, where = options.engine.partition(":")
        engine = plugged_in("engine", kind)(where, options.timeout_s)
    try:
        return session.build(to_build, options, engine=engine, caller=Caller(on_event=on_event, prepare=prepare))
    finally:
        stages.clear()  # a traceback would hold the stage, and edits of its files would not be seen


def run_together(stages: Mapping[Path, Path], options: BuildOptions, on_event: Emit = silent) -> Result:
    """Run the missing tasks of several builds, stage -> output folder, at once, and deliver nothing: the builds will
    find the results in the store. Workers are shared, and a task that fails ends no other.
    """
    projects = {out.name: project(path, out, options.allow_roots) for path, out in stages.items()}
    if not options.pictures:
        projects = {name: without_pictures(member) for name, member in projects.items()}
    graphs = {name: member.graph.before_delivery for name, member in projects.items()}
    out = next(iter(stages.values()))
    graph = TaskGraph.joined(graphs)
    head = {"stage": "an ensemble"}
    shared = Project(graph=graph, files={}, head=head, out=out.parent, stage_id=str(out.parent.resolve()))

    def prepare() -> None:
        compile_once(on_event, steps_of(graph[name] for name in graph), options.workers)

    options = dataclasses.replace(options, keep_going=True)
    return session.build(shared, options, caller=Caller(on_event=on_event, prepare=prepare))


def compile_once(on_event: Emit = silent, steps: tuple[str, ...] = STEPS, workers: int = 1) -> None:
    """Compile the kernels of steps that are missing in the cache, so that workers need not compile them.

    With more than one worker, two helper processes share the work. If several processes start together, one compiles
    and the others wait. Raises EnvironmentFault if the disk is full.
    """
    before_compiling.clear()  # it would wait for this
    if ready(cache_folder()).issuperset(steps):
        return
    with reporting_machine_faults("keep compiled kernels in", cache_folder()):
        folder = make_folder()
        warn = warner(on_event)
        progress = _reported(folder, steps, workers, on_event)
        with progress, locked(folder / "lock", doing="compiles kernels", say=warn):
            if not ready(folder).issuperset(steps):
                if workers == 1 or not _compiled_by_helpers(steps):
                    from pipeline.app.compile_kernels import compile_kernels

                    compile_kernels(steps)
                set_ready(folder, steps)


def warm_up(steps: tuple[str, ...] = ("lens",)) -> None:
    """Compile these steps' kernels that this process calls, and report progress; KeyboardInterrupt after Ctrl-C."""
    from pipeline.app.progress import display

    progress = display(-1 if {"--json", "--quiet", "-q"} & {*sys.argv} else 0)
    with Interrupts() as interrupts, interrupts.stopping(), progress:
        compile_once(progress, steps, USUAL.workers)
    if interrupts.arrived:
        raise KeyboardInterrupt


@contextlib.contextmanager
def _reported(folder: Path, steps: tuple[str, ...], workers: int, on_event: Emit) -> Iterator[None]:
    """Context that reports the share of compiled kernels and the time left, at once and every second, whichever process
    compiles.

    The time left is that of the mean kernel times the number of those that are missing. The mean is taken over the
    kernels compiled since the start, and over `_TRUST` of all as if these had taken the expected time.
    """
    finished_steps = ready(folder)
    ended = threading.Event()
    start = time.monotonic()
    to_compile = max(1, sum(_KERNELS.get(step, _OF_PLUG_IN) for step in steps if step not in finished_steps))
    at_start = count(folder)
    expected = _TRUST * to_compile
    # Kernels of finished steps do not count. Without any, those in the folder are of a process that compiles now, or
    # that was ended.
    not_counted = at_start if finished_steps else 0

    def report() -> None:
        while True:
            in_folder = count(folder)
            share = min((in_folder - not_counted) / to_compile, 0.99)
            elapsed_s = time.monotonic() - start + expected * _KERNEL_S / min(workers, 2)
            mean_s = elapsed_s / (in_folder - at_start + expected)
            left_s = (1 - share) * to_compile * mean_s
            on_event(Compiling(share=share, seconds_left=round(left_s, 1)))
            if ended.wait(1.0):
                return

    with ThreadPoolExecutor() as reporter, contextlib.ExitStack() as cleanup:
        cleanup.callback(ended.set)
        reporter.submit(report)
        yield


def _compiled_by_helpers(steps: tuple[str, ...]) -> bool:
    """Whether two helper processes have compiled the kernels of steps; if not, this process compiles, and meets the
    fault itself.

    Both take numbers of parts from one pipe, so that they end together on any machine; and it is open as long as this
    process lives, so that they end with it.
    """
    environment = {**os.environ, **settings()}
    helper = command("pipeline.app.compile_kernels:compile_apart", *steps)
    with contextlib.suppress(OSError), contextlib.ExitStack() as cleanup:
        numbers, writing = os.pipe()
        cleanup.callback(os.close, numbers)
        cleanup.callback(os.close, writing)
        os.write(writing, _PART_NUMBERS)
        processes = []
        for _ in range(2):
            process = subprocess.Popen(
                helper, env=environment, stdin=numbers, stdout=subprocess.DEVNULL, start_new_session=True
            )
            processes.append(cleanup.enter_context(process))
            cleanup.callback(process.kill)
        codes = [process.wait() for process in processes]
        return not any(codes)
    return False


def steps_of(tasks: Iterable[Task]) -> tuple[str, ...]:
    """Steps of compilation that tasks need, in the order of `STEPS`; a worker compiles whatever else is missing."""
    steps = {"lens"}
    for task in tasks:  # parameters are read as plain values: to make records of thousands of tasks would take seconds
        steps.add(_STEP_OF_PRODUCT.get(task.product, "lens"))
        if task.short_kind == "camera":
            array = task.params["microlenses"]
            surfaces = task.params["prescription"]["surfaces"]
            if any(row["conic"] or row["even_coefficients"] or row["odd_coefficients"] for row in surfaces):
                steps.add("aspheres")
            if array and (array["model"] != "thin" or array["tilt_x_deg"] != 0 or array["tilt_y_deg"] != 0):
                steps.add("microlenses")
        if task.product == "truth" and task.params["table"]["settings"]["method"] != "direct":
            steps.add("search")
        if view := task.params.get("view"):
            shapes = [placed["target"].get("surface", placed["target"])["kind"] for placed in view.get("targets", ())]
            may_hide = shapes != ["flat"] or view.get("occluders")
            if task.product == "image" and may_hide:
                steps.add("company")
            if set(shapes) & _NOT_FLAT:
                steps.add("shapes")
        if task.record and hasattr(task.record, "steps"):
            steps.update(from_plain(task.record, task.params).steps)
    return tuple(step for step in STEPS if step in steps)
