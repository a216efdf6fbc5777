"""Records of the engine: the data that it passes to other processes and keeps in the store.

They are JSON only at these two borders: `as_json` writes any of them, `records.plain.from_plain` reads it.
"""

import hashlib
import json
from dataclasses import dataclass, field
from typing import Any

from pipeline.engine.digest import DIGEST, key_of

KEY_DOMAIN = "task/v1"
"""Domain of the keys of tasks."""

_TRAILER = b"\n#sha256="
"""Beginning of the last line of a sealed file."""

Params = dict[str, Any]
"""Plain parameters of a task, as `records.plain.to_plain` makes them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Blob:
    """Bytes in the store, by their digest and number."""

    sha256: str
    size: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Components:
    """All parts of the key of a task; kept in its record, so that a rerun can be explained.

    `code` is the fingerprint of its module and of everything that it imports from its own package; `libraries` are
    versions and `machine` facts by name; `inputs` are digests by role and name of an output.
    """

    kind: str
    code: str
    libraries: dict[str, str]
    machine: dict[str, str]
    params: Params
    inputs: dict[str, dict[str, str]]

    @property
    def key(self) -> str:
        return key_of(KEY_DOMAIN, fields_of(self))

    def digests(self) -> list[str]:
        """sha256 of all outputs that the task reads."""
        return [digest for outputs in self.inputs.values() for digest in outputs.values()]


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """The run that made a record: wall time, processor time, and the part of it spent loading or compiling code [s].

    `kernels` holds the nonzero fields of `jit.work.KernelWork` by name of the kernel. `news` is a short message of the
    task to the user who watches the build. Each build repeats its `warning`.
    """

    seconds: float = 0.0
    cpu_seconds: float | None = None
    loading_seconds: float = 0.0
    peak_bytes: int = 0
    kernels: dict[str, dict[str, float]] = field(default_factory=dict)
    news: str = ""
    warning: str = ""
    host: str = ""
    pid: int = 0
    when: str = ""

    @property
    def rays(self) -> float:
        """Number of rays started."""
        return sum(kernel.get("rays", 0) for kernel in self.kernels.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """The result of a task: its outputs by name, and the run that made them."""

    key: str
    outputs: dict[str, Blob]
    components: Components
    made_by: Run = field(default_factory=Run)

    @property
    def is_sound(self) -> bool:
        """Whether all digests and sizes are well-formed; to be checked for records that were read."""
        sizes = [self.made_by.peak_bytes, *(blob.size for blob in self.outputs.values())]
        digests = [blob.sha256 for blob in self.outputs.values()]
        return {*map(type, sizes)} == {int} and all(map(DIGEST.fullmatch, digests))


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec:
    """A task ready to run, without its graph. With `force` it runs even if there is a record of the key.

    `folder`: output folder that it reads after delivery; then it is not given the outputs of its inputs.
    """

    name: str
    key: str
    components: Components
    force: bool = False
    folder: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """An engine's reply about a task: its end, or news of it.

    Its state is executed, cached, failed, or lost, if its worker died; begun and waiting announce that it has or lacks
    its lock. `differs` lists outputs whose bytes differ from those that the store already had for the key. `machine`,
    `memory`: the task is not to blame. `damaged`: an input was damaged, or was written to while the task used it.
    """

    name: str
    state: str
    seconds: float = 0.0
    record: Record | None = None
    differs: tuple[str, ...] = ()
    error: str = ""
    log: str | None = None
    machine: bool = False
    damaged: bool = False
    memory: bool = False
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskResult:
    """The end of a task.

    Its state is executed, cached (or computed meanwhile by another builder), failed or skipped; `seconds` is the wall
    time spent now. The key is None if it was skipped before its inputs were available. A failed task may have failed
    because of the `machine` (disk full, …); `place` is the location of its subject in the stage, and `spec` the file
    from which `pipeline run-task` repeats it. `differs` lists outputs that differ from earlier ones with the same key.
    """

    name: str
    kind: str
    state: str
    seconds: float = 0.0
    key: str | None = None
    error: str | None = None
    log: str | None = None
    machine: bool = False
    place: str | None = None
    spec: str | None = None
    differs: tuple[str, ...] = ()
    made_by: Run | None = None

    def to_dict(self) -> dict[str, Any]:
        """The result as in the summary of a build."""
        facts = {"name": self.name, "kind": self.kind, "state": self.state, "seconds": self.seconds, "key": self.key}
        if self.state == "failed":
            facts |= {"error": self.error, "log": self.log, "place": self.place, "spec": self.spec}
        return {**facts, "differs": list(self.differs)} if self.differs else facts


def as_json(value: Any) -> bytes:
    """JSON text of plain values and records, with names in order."""
    return json.dumps(value, sort_keys=True, default=fields_of).encode()


def fields_of(record: Any) -> dict[str, Any]:
    """Fields of a record by name; their values stay as they are."""
    return {name: getattr(record, name) for name in record.__dataclass_fields__}


def seal(value: Any) -> bytes:
    """JSON text of plain values and records with a last line that holds its digest, so that damage is noticed."""
    body = as_json(value)
    return body + _TRAILER + hashlib.sha256(body).hexdigest().encode() + b"\n"


def unseal(raw: bytes | None) -> Any:
    """The sealed content; None if a byte is missing or altered, or if it is not JSON that can be parsed safely."""
    body, _, tail = (raw or b"").rpartition(_TRAILER)
    if tail != hashlib.sha256(body).hexdigest().encode() + b"\n":
        return None
    try:
        return json.loads(body)
    except (ValueError, RecursionError):
        return None
