"""Memory of earlier tasks, and whether one more task fits. The estimates save time and never change a result."""

import contextlib
import resource
import sys
from collections.abc import Iterable
from pathlib import Path

_CGROUP = Path("/sys/fs/cgroup")


class PeakMeter:
    """Peak memory of this process since now; since its start, if the system cannot tell."""

    def __init__(self) -> None:
        with contextlib.suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # resets VmHWM; see proc(5)

    def read_bytes(self) -> int:
        """Largest resident size so far [bytes]."""
        peak_bytes = _bytes_in(Path("/proc/self/status"), "VmHWM")
        if peak_bytes is not None:
            return peak_bytes
        unit = 1 if sys.platform == "darwin" else 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def available_bytes() -> int | None:
    """Available memory [bytes]: the estimate of the system, or less inside a container; None if unknown."""
    limits = _bytes_in(Path("/proc/meminfo"), "MemAvailable"), _cgroup_bytes()
    known = [value for value in limits if value is not None]
    return min(known) if known else None


class Budget:
    """Peak memory by kind of task, and the memory available to all running tasks together."""

    def __init__(self, limit_bytes: int | None, peaks: dict[str, int] | None = None) -> None:
        self._limit_bytes = limit_bytes
        self._before = dict(peaks or {})
        self.peaks: dict[str, int] = {}

    def learn(self, kind: str, peak_bytes: int) -> None:
        """Update the peak of a kind with a measured one [bytes]."""
        self.peaks[kind] = max(peak_bytes, self.peaks.get(kind, 0))

    def fits(self, kind: str, running: Iterable[str]) -> bool:
        """Whether a task may start beside the running ones. Alone it always may; kinds never measured count as 0."""
        others = [self._of(other) for other in running]
        return not others or self._limit_bytes is None or sum(others) + self._of(kind) <= self._limit_bytes

    def _of(self, kind: str) -> int:
        return self.peaks.get(kind, self._before.get(kind, 0))


def _bytes_in(path: Path, name: str) -> int | None:
    try:
        for line in path.read_text(encoding="ascii").splitlines():
            if line.startswith(f"{name}:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    return None


def _cgroup_bytes() -> int | None:
    try:
        limit, used = (int((_CGROUP / name).read_text()) for name in ("memory.max", "memory.current"))
    except (OSError, ValueError):  # no container, or one without a limit ("max")
        return None
    return max(0, limit - used)
