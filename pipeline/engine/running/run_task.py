"""Running one task from a file, to repeat a failure, in job arrays of batch systems, or on render farms."""

import json
from dataclasses import replace
from pathlib import Path

from pipeline.engine.digest import DIGEST
from pipeline.engine.planning.plan import PlannedTask
from pipeline.engine.records import Reply, Spec, as_json
from pipeline.engine.running.execute import perform
from pipeline.engine.store.store import Store
from pipeline.errors import UsageError
from pipeline.records.plain import from_plain


def write_specs(planned: list[PlannedTask], folder: Path) -> list[Path]:
    """Write 0.json, 1.json, … for all tasks that can run now, in place of older ones; UsageError if one is no spec."""
    folder.mkdir(parents=True, exist_ok=True)
    old = [path for path in folder.glob("*.json") if path.stem.isdecimal()]
    for path in old:
        _read(path)
    for path in old:
        path.unlink()
    specs = [task.spec for task in planned if task.state == "run" and task.spec is not None]
    paths = [folder / f"{number}.json" for number in range(len(specs))]
    for path, spec in zip(paths, specs, strict=True):
        path.write_bytes(as_json(spec) + b"\n")
    return paths


def run_task(path: Path, store: Store, packages: tuple[str, ...], *, force: bool = False) -> Reply:
    """Bring the result of one task into the store; UsageError if the file is not a spec, or was altered."""
    spec = _read(path)
    with store.in_use():
        (reply,) = perform([replace(spec, force=force)], store, packages)
    return reply


def _read(path: Path) -> Spec:
    hint = "`pipeline plan STAGE --specs FOLDER` writes such files, and so does a task that fails"
    try:
        spec = from_plain(Spec, json.loads(path.read_text(encoding="utf-8")))
        key, names = spec.components.key, [spec.name, spec.components.kind]
        is_spec = {*map(type, names)} == {str} and all(map(DIGEST.fullmatch, [spec.key, *spec.components.digests()]))
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}", hint=hint) from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        is_spec = False
    if not is_spec:
        raise UsageError(f"{path} is not the spec of a task", hint=hint)
    if key != spec.key:
        raise UsageError(f"{path} was altered: its key does not match its content", hint=hint)
    return spec
