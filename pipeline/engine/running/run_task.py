"""Running one task from a file, to repeat a failure, in job arrays of batch systems, or on render farms."""

import json
from pathlib import Path
from typing import Any

from pipeline.engine.digest import DIGEST, key_of
from pipeline.engine.planning.plan import PlannedTask
from pipeline.engine.planning.task_spec import KEY_DOMAIN
from pipeline.engine.running.execute import perform
from pipeline.engine.store.store import Store
from pipeline.errors import UsageError


def write_specs(planned: list[PlannedTask], folder: Path) -> list[Path]:
    """Write 0.json, 1.json, … for all tasks of a plan that can run now; older such files are removed.

    Raises
    ------
    UsageError
        A file with such a name in the folder is not a spec, so it must not be overwritten.
    """
    folder.mkdir(parents=True, exist_ok=True)
    old = [path for path in folder.glob("*.json") if path.stem.isdecimal()]
    for path in old:
        _read(path)
    for path in old:
        path.unlink()
    specs = [task.spec for task in planned if task.state == "run" and task.spec is not None]
    paths = [folder / f"{number}.json" for number in range(len(specs))]
    for path, spec in zip(paths, specs, strict=True):
        path.write_text(json.dumps(spec.to_plain(), sort_keys=True) + "\n", encoding="utf-8")
    return paths


def run_task(path: Path, store: Store, packages: tuple[str, ...], *, force: bool = False) -> dict[str, Any]:
    """Bring the result of one task into the store; returns the reply of `perform`.

    Raises
    ------
    UsageError
        The file is not a spec, or its key does not match its content, which would store a wrong result under the key.
    """
    spec = _read(path)
    with store.in_use():
        return perform({**spec, "force": force}, store, packages)


def _read(path: Path) -> dict[str, Any]:
    hint = "`pipeline plan STAGE --specs FOLDER` writes such files, and so does a task that fails"
    try:
        spec = json.loads(path.read_text(encoding="utf-8"))
        whole = isinstance(spec["name"], str) and DIGEST.fullmatch(spec["key"]) is not None
        components = spec["components"]
        whole = whole and isinstance(components["kind"], str) and isinstance(components["params"], dict)
        digests = [digest for files in components["inputs"].values() for digest in files.values()]
        whole = whole and all(DIGEST.fullmatch(digest) for digest in digests)
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}", hint=hint) from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise UsageError(f"{path} is not the spec of a task", hint=hint) from None
    if not whole:
        raise UsageError(f"{path} is not the spec of a task", hint=hint)
    if key_of(KEY_DOMAIN, components) != spec["key"]:
        raise UsageError(f"{path} was altered: its key does not match its content", hint=hint)
    return {name: spec[name] for name in ("name", "key", "components")}
