"""The folder of compiled kernels: of one user, for one state of all that kernels are made of.

Numba keeps the code there, and executes what it finds, so a folder in which others may have put something is not used.
Numba writes each file under another name first: a process that is killed leaves none half written.
"""

import atexit
import contextlib
import fcntl
import functools
import hashlib
import os
import pickle
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from pipeline.errors import EnvironmentFault, warn_once
from pipeline.folders import user_cache
from pipeline.machine.processor import level

_HOME = "PIPELINE_JIT_CACHE"
REMEDY = f"set {_HOME} to a folder that is yours alone and that you may write to"
_PACKAGE = Path(__file__).resolve().parents[1]
_DECORATED = re.compile(rb"^@(kernel|opaque|unit|inline)$", re.MULTILINE)
_IMPORTED = re.compile(rb"^(?:from|import) (pipeline[\w.]*)", re.MULTILINE)
_READY = ".ready"
"""Ending of a file's name that says which kernels are all there."""


def cache_folder() -> Path:
    """Folder of compiled kernels, below $PIPELINE_JIT_CACHE or `jit/` in the user's cache folder; it may not be there.

    Its name is a digest of all sources that kernels reach, because a callee in another file may change, or a constant,
    which is compiled in. Numba keeps kernels by the place of their source, so that a copy of this package has its own.
    """
    home = os.environ.get(_HOME)
    return (Path(home) if home else user_cache() / "jit") / _digest()


def can_keep() -> bool:
    """Make the folder of compiled kernels, and say whether this user, and no other, may write to it."""
    folder = cache_folder()
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return _is_private(folder) and os.access(folder, os.W_OK)


def make_folder() -> Path:
    """Make a folder for compiled kernels.

    Where none can be kept, a temporary one stands in, for this process and those that it starts, with a copy of what
    may be read: Numba takes no code from a folder that it cannot write to.
    """
    folder = cache_folder()
    if can_keep():
        return folder
    home = Path(tempfile.mkdtemp(prefix="kernels-"))
    atexit.register(shutil.rmtree, home, ignore_errors=True)
    stand_in = home / folder.name
    if _is_private(folder):
        shutil.copytree(folder, stand_in)
    else:
        warn_once(f"cannot keep compiled kernels in {folder}, so that each run compiles them; {REMEDY}")
        stand_in.mkdir()
    os.environ[_HOME] = str(home)
    return stand_in


@contextlib.contextmanager
def held(kernel: str) -> Iterator[None]:
    """Hold a kernel while it is compiled or loaded: other processes wait, and then load what they would have compiled.

    Numba would mix up the code of two processes that save a kernel for other types at a time. Without locks, as on some
    network file systems, nothing is held. EnvironmentFault where the power failed before code was on the disk.
    """
    folder = cache_folder()
    with contextlib.ExitStack() as last:
        with contextlib.suppress(OSError):
            handle = os.open(folder / f"{kernel}.lock", os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
            last.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX)
        try:
            yield
        except (EOFError, pickle.UnpicklingError) as error:
            raise EnvironmentFault(
                f"the compiled kernel {kernel} is damaged: {error}",
                hint=f"remove {folder}; it is made again",
            ) from error


def ready(folder: Path) -> set[str]:
    """Names under which kernels were said to be all there."""
    return {path.stem for path in folder.glob(f"*{_READY}")}


def set_ready(folder: Path, names: Iterable[str]) -> None:
    """Say under some names that their kernels are all there."""
    for name in names:
        (folder / f"{name}{_READY}").touch()


def count(folder: Path) -> int:
    """Number of the kernels in a folder."""
    return sum(1 for _ in folder.glob("*/*.nbi"))


@functools.cache
def _digest() -> str:
    """Digest of the sources that kernels reach, with their place, and of what compiles them."""
    from importlib.metadata import version

    compilers = " ".join(f"{name} {version(name)}" for name in ("numba", "llvmlite"))
    digest = hashlib.sha256(f"{sys.version} {level()} {compilers}".encode())
    for path, source in sorted(_sources_of_kernels(_PACKAGE).items()):
        digest.update(f"\0{path}\0{len(source)}\0".encode() + source)
    return digest.hexdigest()[:16]


def _sources_of_kernels(package: Path) -> dict[Path, bytes]:
    """Files with kernels, and those from whose modules their globals may come; all of a package that is imported."""
    sources = {path: path.read_bytes() for path in package.rglob("*.py")}
    reached, todo = dict[Path, bytes](), [path for path, source in sources.items() if _DECORATED.search(source)]
    while todo:
        path = todo.pop()
        if path in sources and path not in reached:
            reached[path] = sources[path]
            for name in _IMPORTED.findall(sources[path]):
                module = package.parent / name.decode().replace(".", "/")
                todo += [module.with_suffix(".py"), *module.glob("*.py")]
    return reached


def _is_private(folder: Path) -> bool:
    """Whether something is a folder into which only this user, or the administrator, can have put anything."""
    with contextlib.suppress(OSError):
        facts = folder.lstat()
        is_trusted = facts.st_uid in (os.geteuid(), 0) and not facts.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        return is_trusted and stat.S_ISDIR(facts.st_mode)
    return False
