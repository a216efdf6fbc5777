"""Findings about versions, processor, device, store, disk and settings, with remedies."""

import importlib.metadata
import importlib.util
import os
import platform
import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.app.build import STEPS
from pipeline.engine.files import nearest_existing
from pipeline.engine.maintenance import limit_from_environment
from pipeline.engine.options import USUAL
from pipeline.engine.planning.task_code import installed_version
from pipeline.engine.store.store import Store, default_root
from pipeline.errors import EnvironmentFault, PipelineError
from pipeline.folders import shipped_folder
from pipeline.jit.files import REMEDY, cache_folder, can_keep, ready
from pipeline.machine.facts import available_bytes
from pipeline.machine.processor import level
from pipeline.spelling import human

_NEEDED = (
    *("usd-core", "numpy", "scipy", "numba", "embreex", "OpenEXR", "pillow", "colour-science", "networkx"),
    *("typer", "rich", "opencv-python-headless"),
)
_LEAST_DISK = 2_000_000_000
"""Free bytes of a disk below which a build of a few cameras may fill it: a store of the examples has about 1 GB."""
_LEAST_MEMORY = 2_000_000_000
"""Available bytes below which workers may not run side by side: each takes up to 350 MB, with large images more."""
_PROBE = "lenses/cooke_triplet_50mm.usda"


@dataclass(frozen=True, slots=True)
class Finding:
    """Finding about this machine; `mend` is its remedy, empty if all is well."""

    name: str
    value: str
    mend: str = ""
    is_wrong: bool = False

    @property
    def state(self) -> str:
        """`fine`, `doubt`: it may cost time or room, or `wrong`: it keeps the pipeline from working."""
        return "wrong" if self.is_wrong else "doubt" if self.mend else "fine"

    def to_dict(self) -> dict[str, str]:
        """Plain data, as in `doctor --json`."""
        return {"name": self.name, "value": self.value, "state": self.state, "mend": self.mend}


def findings() -> Iterator[Finding]:
    """All findings, each computed when it is asked for; none raises."""
    subjects = (
        *(_python, _libraries, _processor, _memory, _store, _kernels, _device, _disk, _usd, _library, _settings),
    )
    for look_at in subjects:
        try:
            yield from look_at()
        except (PipelineError, OSError) as error:
            message, hint = (error.message, error.hint) if isinstance(error, PipelineError) else (str(error), None)
            yield Finding(look_at.__name__[1:], message, hint or "see the message", is_wrong=True)


def _python() -> Iterator[Finding]:
    yield Finding("pipeline", f"{installed_version('plenoptic-pipeline')}, {shipped_folder('stages').parent}")
    yield Finding("python", f"{platform.python_version()}, {sys.prefix}")


def _libraries() -> Iterator[Finding]:
    for name in _NEEDED:
        try:
            yield Finding(name, installed_version(name))
        except importlib.metadata.PackageNotFoundError:
            mend = 'install it: python -m pip install "plenoptic-pipeline"'
            yield Finding(name, "is not installed", mend, is_wrong=True)


def _processor() -> Iterator[Finding]:
    yield Finding("processor", f"{level()}, {USUAL.workers} of {os.cpu_count()} cores may be used")


def _memory() -> Iterator[Finding]:
    available = available_bytes()
    if available is not None:
        mend = "close other programs, or build with -j 1" if available < _LEAST_MEMORY else ""
        yield Finding("memory", f"{human(available)} available", mend)


def _device() -> Iterator[Finding]:
    """A device is optional: without one everything runs on the processor."""
    from pipeline.jit.device import device_name

    try:
        yield Finding("device", device_name())
    except EnvironmentFault:
        yield Finding("device", "none that --device could use; everything runs on the processor")


def _store() -> Iterator[Finding]:
    root = default_root().absolute()
    limit = limit_from_environment()
    if not root.exists():
        yield Finding("store", f"{root}, not made yet; at most {human(limit)}")
    elif os.access(root, os.W_OK):
        yield Finding("store", f"{root}, {human(Store().size())} of {human(limit)}")
    else:
        mend = "only what it has can be delivered; name another with PIPELINE_CACHE"
        yield Finding("store", f"{root}, {human(Store().size())} of {human(limit)}, read-only", mend)


def _kernels() -> Iterator[Finding]:
    folder = cache_folder()
    compiled = ready(folder)
    names = ", ".join(step for step in STEPS if step in compiled) or "nothing yet"
    advice = "" if compiled.issuperset(STEPS) else "; others are compiled when needed, or now by `pipeline warm`"
    yield Finding("kernels", f"{folder}, ready for {names}{advice}", "" if can_keep() else REMEDY)


def _disk() -> Iterator[Finding]:
    for name, folder in (("disk here", Path.cwd()), ("disk of the store", nearest_existing(default_root()))):
        free = shutil.disk_usage(folder).free
        mend = "make room: `pipeline cache gc` removes old results" if free < _LEAST_DISK else ""
        yield Finding(name, f"{human(free)} free", mend)


def _usd() -> Iterator[Finding]:
    """The USD that Python imports, and whether usdview would find our schemas."""
    spec = importlib.util.find_spec("pxr")
    yield Finding("usd", str(Path(spec.origin).parent) if spec and spec.origin else "not found")
    schemas = shipped_folder("schemas")
    listed = os.environ.get("PXR_PLUGINPATH_NAME", "").split(os.pathsep)
    is_listed = any(part and Path(part).resolve() == schemas.resolve() for part in listed)
    gone = [part for part in listed if "plen" in part.lower() and not Path(part).is_dir()]
    mend = f"PXR_PLUGINPATH_NAME names a folder that is gone: {gone[0]}; set it to {schemas}" if gone else ""
    yield Finding("plug-in", f"{schemas}{' (usdview knows it)' if is_listed else ''}", mend)


def _library() -> Iterator[Finding]:
    """A lens of the library, read by USD with our schemas: the first step of every command."""
    from pipeline.scene.load import load

    if problems := load(shipped_folder("stages") / _PROBE).errors:
        mend = "install the package again; if another USD is on PYTHONPATH, take it off"
        yield Finding("library", str(problems[0]), mend, is_wrong=True)
    else:
        yield Finding("library", f"{shipped_folder('stages')} can be read")


def _settings() -> Iterator[Finding]:
    """Environment variables with doubtful values, and a terminal without UTF-8."""
    for name, doubtful, mend in (
        ("PYTHONDONTWRITEBYTECODE", ".", "unset it: every process compiles all modules anew"),
        ("NUMBA_DISABLE_JIT", "[^0]", "unset it: kernels would run as plain Python"),
        ("NUMBA_ENABLE_CUDASIM", "1", "unset it: --device would run in a simulator"),
        ("PYTHONPATH", "pxr|usd", "another USD may be found first"),
    ):
        value = os.environ.get(name, "")
        if re.search(doubtful, value, re.IGNORECASE):
            yield Finding(name, value, mend)
    encoding = (sys.stdout.encoding or "").lower().replace("-", "")
    if encoding not in ("utf8", ""):
        yield Finding("terminal", encoding, "set LC_ALL=C.UTF-8, or PYTHONUTF8=1")
