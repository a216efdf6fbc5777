"""Findings about versions, processor, device, store, disk and settings, with mends."""

import enum
import importlib.util
import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.app.progress import human
from pipeline.engine.maintenance import limit_from_environment
from pipeline.engine.planning.libraries import installed_version
from pipeline.engine.running.memory import available_bytes
from pipeline.engine.store.store import Store, default_root
from pipeline.errors import EnvironmentFault, PipelineError
from pipeline.folders import share
from pipeline.jit.decorators import cache_folder
from pipeline.machine.processor import level

_NEEDED = (
    *("usd-core", "numpy", "scipy", "numba", "embreex", "OpenEXR", "pillow", "colour-science", "networkx"),
    *("typer", "rich", "opencv-python-headless"),
)
_LEAST_DISK = 2_000_000_000
"""Free bytes of a disk below which a build of a few cameras may fill it: a store of the examples has about 1 GB."""
_LEAST_MEMORY = 2_000_000_000
"""Available bytes below which workers may not run side by side: each takes up to 350 MB, with large images more."""
_PROBE = "lenses/cooke_triplet_50mm.usda"


class State(enum.StrEnum):
    """Whether a finding is a problem."""

    FINE = "fine"
    DOUBT = "doubt"
    WRONG = "wrong"


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """Something about this machine; `mend` says what to do about it, unless it is fine."""

    name: str
    value: str
    state: State = State.FINE
    mend: str = ""

    def to_dict(self) -> dict[str, str]:
        """Plain data, as in `doctor --json`."""
        return {"name": self.name, "value": self.value, "state": self.state.value, "mend": self.mend}


def findings() -> Iterator[Finding]:
    """All findings, in the order in which they are asked for; none raises."""
    for look in (_python, _libraries, _processor, _memory, _device, _store, _kernels, _disk, _usd, _library, _settings):
        try:
            yield from look()
        except PipelineError as error:
            yield Finding(name=look.__name__[1:], value=error.what, state=State.WRONG, mend=error.hint or "")
        except OSError as error:
            yield Finding(name=look.__name__[1:], value=str(error), state=State.WRONG, mend="see the message")


def _python() -> Iterator[Finding]:
    yield Finding(name="pipeline", value=f"{installed_version('plenoptic-pipeline')}, {share('stages').parent}")
    yield Finding(name="python", value=f"{platform.python_version()}, {sys.prefix}")


def _libraries() -> Iterator[Finding]:
    for name in _NEEDED:
        try:
            yield Finding(name=name, value=installed_version(name))
        except EnvironmentFault:
            mend = 'install it: python -m pip install "plenoptic-pipeline"'
            yield Finding(name=name, value="is not installed", state=State.WRONG, mend=mend)


def _processor() -> Iterator[Finding]:
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    yield Finding(name="processor", value=f"{level()}, {usable} of {os.cpu_count()} cores may be used")


def _memory() -> Iterator[Finding]:
    found = available_bytes()
    if found is None:
        return
    short = found < _LEAST_MEMORY
    mend = "close other programs, or build with -j 1" if short else ""
    yield Finding(name="memory", value=f"{human(found)} available", state=_doubt(short), mend=mend)


def _device() -> Iterator[Finding]:
    """A device is an offer: without one everything runs on the processor."""
    from pipeline.jit.device import device_name

    try:
        yield Finding(name="device", value=device_name())
    except EnvironmentFault:
        yield Finding(name="device", value="none that --device could use; everything runs on the processor")


def _store() -> Iterator[Finding]:
    root = default_root().absolute()
    limit = limit_from_environment()
    if not root.exists():
        yield Finding(name="store", value=f"{root}, not made yet; at most {human(limit)}")
        return
    size, writable = Store().size(), os.access(root, os.W_OK)
    mend = "" if writable else "new results go to a private store; name another with PIPELINE_CACHE"
    value = f"{root}, {human(size)} of {human(limit)}{'' if writable else ', read-only'}"
    yield Finding(name="store", value=value, state=_doubt(not writable), mend=mend)


def _kernels() -> Iterator[Finding]:
    folder = cache_folder()
    count = sum(1 for _ in folder.glob("*")) if folder.is_dir() else 0
    said = f"{count} files" if count else "none yet: the first build compiles them, which takes about half a minute"
    yield Finding(name="kernels", value=f"{folder}, {said}")


def _disk() -> Iterator[Finding]:
    for name, place in (("disk here", Path.cwd()), ("disk of the store", _existing(default_root().absolute()))):
        free = shutil.disk_usage(place).free
        mend = "make room: `pipeline cache gc` removes old results" if free < _LEAST_DISK else ""
        yield Finding(name=name, value=f"{human(free)} free", state=_doubt(free < _LEAST_DISK), mend=mend)


def _usd() -> Iterator[Finding]:
    spec = importlib.util.find_spec("pxr")
    yield Finding(name="usd", value=str(Path(spec.origin).parent) if spec and spec.origin else "not found")
    place = share("schemas")
    listed = os.environ.get("PXR_PLUGINPATH_NAME", "").split(os.pathsep)
    here = any(part and Path(part).resolve() == place.resolve() for part in listed)
    other = [part for part in listed if "plen" in part.lower() and not Path(part).is_dir()]
    value = f"{place}{' (usdview knows it)' if here else ''}"
    if other:
        mend = f"PXR_PLUGINPATH_NAME names a folder that is gone: {other[0]}; set it to {place}"
        yield Finding(name="plug-in", value=value, state=State.DOUBT, mend=mend)
    else:
        yield Finding(name="plug-in", value=value)


def _library() -> Iterator[Finding]:
    """A lens of the library, read by USD with our schemas: what every command does first."""
    from pipeline.scene.load import load

    problems = load(share("stages") / _PROBE).errors
    if problems:
        mend = "install the package again; if another USD is on PYTHONPATH, take it off"
        yield Finding(name="library", value=str(problems[0]), state=State.WRONG, mend=mend)
    else:
        yield Finding(name="library", value=f"{share('stages')} can be read")


def _settings() -> Iterator[Finding]:
    doubts: tuple[tuple[str, Callable[[str], bool], str], ...] = (
        ("PYTHONDONTWRITEBYTECODE", bool, "unset it: every process compiles all modules anew"),
        ("NUMBA_DISABLE_JIT", lambda value: value not in ("", "0"), "unset it: kernels would run as plain Python"),
        ("NUMBA_ENABLE_CUDASIM", lambda value: value == "1", "unset it: --device would run in a simulator"),
        (
            "PYTHONPATH",
            lambda value: "pxr" in value.lower() or "usd" in value.lower(),
            "another USD may be found first",
        ),
    )
    for name, is_doubtful, mend in doubts:
        value = os.environ.get(name, "")
        if value and is_doubtful(value):
            yield Finding(name=name, value=value, state=State.DOUBT, mend=mend)
    encoding = (sys.stdout.encoding or "").lower().replace("-", "")
    if encoding not in ("utf8", ""):
        yield Finding(name="terminal", value=encoding, state=State.DOUBT, mend="set LC_ALL=C.UTF-8, or PYTHONUTF8=1")


def _doubt(is_doubtful: bool) -> State:
    return State.DOUBT if is_doubtful else State.FINE


def _existing(path: Path) -> Path:
    """The path, or the nearest folder above it that exists."""
    return next(place for place in (path, *path.parents) if place.exists())
