"""Memory of this process and of the machine. It decides what runs at the same time and never changes a result."""

import contextlib
import resource
import sys
from pathlib import Path

_CGROUP = Path("/sys/fs/cgroup")


def reset_peak() -> None:
    """Let `peak_bytes` count from now on, where the system can."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # resets VmHWM; see proc(5)


def peak_bytes() -> int:
    """Largest resident size of this process so far [bytes]."""
    peak = _bytes_in(Path("/proc/self/status"), "VmHWM")
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit if peak is None else peak


def available_bytes() -> int | None:
    """Available memory [bytes]: the estimate of the system, or less inside a container; None if unknown."""
    available = _bytes_in(Path("/proc/meminfo"), "MemAvailable")
    try:
        limit, used = (int((_CGROUP / name).read_text()) for name in ("memory.max", "memory.current"))
    except (OSError, ValueError):  # no container, or one without a limit ("max")
        return available
    free = max(0, limit - used)
    return free if available is None else min(free, available)


def _bytes_in(path: Path, name: str) -> int | None:
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{name}:")), None)
