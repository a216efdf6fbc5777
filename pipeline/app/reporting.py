"""The report of a build: its stage, the history of its tasks, and what the page is written from."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from pipeline.engine.output import manifest
from pipeline.engine.store.store import Store
from pipeline.errors import PipelineError
from pipeline.jit.files import say
from pipeline.report.page.diary import Diary
from pipeline.report.page.page import is_current, place_of, write_page
from pipeline.report.page.records import History, InformationPart, TaskRun
from pipeline.scene.load import Loaded, load

_STAGE = "dataset.usda"


def report(
    out: str | Path,
    place: str | Path | None = None,
    *,
    diary: Diary | None = None,
    warn: Callable[[str], None] = say,
    informed: Mapping[str, InformationPart] | None = None,
) -> Path:
    """Write the report of a finished build into a folder, by default `OUT.report`; returns its page, `index.html`.

    `diary` has notes about the build that has just ended; without it the history of an earlier report stays, or is made
    of the records in the store. `informed`: what `pipeline inform` has just said, by camera. It raises as `write_page`.
    """
    out = Path(out)
    where = place_of(out) if place is None else Path(place)
    loaded = _loaded(out, warn)
    ran = diary is not None and diary.has_run
    if not ran and (where / "data/history.js").is_file():
        return write_page(out, where, loaded, None, informed)
    return write_page(out, where, loaded, _history(out, diary if ran else None), informed)


def report_of_build(out: Path, diary: Diary, *, warn: Callable[[str], None]) -> Path | None:
    """Write the report of a build that has just ended, unless it is there already; its failure fails no build."""
    where = place_of(out)
    try:
        if not diary.has_run and is_current(out, where):
            return where / "index.html"
        return report(out, diary=diary, warn=warn)
    except PipelineError as error:
        warn(f"no report was written: {error.what}")
    except OSError as error:
        warn(f"no report was written to {where}: {error.strerror}")
    return None


def _loaded(out: Path, warn: Callable[[str], None]) -> Loaded | None:
    """The stage in the output folder; None, with a warning, if it does not pass `check`."""
    if not (out / _STAGE).is_file():
        return None
    loaded = load(out / _STAGE)
    if loaded.errors or loaded.dataset is None:
        warn(f"the report has no optics and no 3-D view: {out / _STAGE} does not pass `pipeline check`")
        return None
    return loaded


def _history(out: Path, diary: Diary | None) -> History:
    """History of all tasks of the manifest: from the notes about a build, and from records of the store."""
    store, runs = Store(), diary.runs if diary else {}
    tasks = tuple(_run(store, name, key, runs.get(name)) for name, key in manifest.read(out).tasks.items())
    return History(
        tasks=tasks,
        seconds=diary.seconds if diary else None,
        workers=diary.workers if diary else None,
    )


def _run(store: Store, name: str, key: str, noted: TaskRun | None) -> TaskRun:
    record = store.peek(key)
    made_by = record.made_by if record else None
    made = TaskRun(
        name=name,
        kind=name.split("/")[0],
        state="made before",
        start_s=None,
        end_s=None,
        cpu_s=made_by.cpu_seconds if made_by else None,
        peak_bytes=made_by.peak_bytes if made_by else None,
    )
    return replace(made, state=noted.state, start_s=noted.start_s, end_s=noted.end_s) if noted else made
