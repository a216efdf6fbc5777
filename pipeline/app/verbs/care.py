"""`pipeline cache`, `doctor` and `warm`: care of the store of results, of the machine and of kernels."""

import os
from dataclasses import asdict
from typing import Annotated

import typer

from pipeline.app.verbs.terminal import Json, Verb, new_family, note, number_of, say, say_json
from pipeline.errors import Exit
from pipeline.spelling import human

cache = new_family(help="Inspect and clean up the store of results, $PIPELINE_CACHE.")


@cache.command(cls=Verb)
def path(as_json: Json = False) -> None:
    """Print the folder of the store."""
    from pipeline.engine.store.store import default_root

    store = str(default_root().absolute())
    say_json({"store": store}) if as_json else say(store)


@cache.command(cls=Verb)
def info(as_json: Json = False) -> None:
    """Print the size of the store, and how much of it finished builds refer to."""
    from pipeline.engine.maintenance import info as contents_of
    from pipeline.engine.store.store import Store

    store = Store()
    contents = contents_of(store)
    if as_json:
        say_json({"store": str(store.root), **asdict(contents)})
        return
    say(f"store    {store.root}")
    say(f"results  {contents.records:,} tasks, {contents.blobs:,} files, {human(contents.bytes)}")
    say(f"held     {human(contents.pinned_bytes)} by output folders that are still there")
    say(f"limit    {human(contents.limit_bytes)} ($PIPELINE_CACHE_SIZE)")


@cache.command(cls=Verb)
def gc(
    size: Annotated[str | None, typer.Option("--size", metavar="SIZE", help="Keep this much, e.g. 20G.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", "-n", help="Only print what would be removed.")] = False,
    as_json: Json = False,
) -> None:
    """Remove the least recently used results until the store fits the size, and files that nothing refers to.

    Results of finished builds are kept.
    """
    from pipeline.engine.maintenance import bytes_of, collect, limit_from_environment
    from pipeline.engine.store.store import Store
    from pipeline.errors import EnvironmentFault

    limit = bytes_of(size, "--size") if size else limit_from_environment()
    store = Store(warn=note)
    if not dry_run and not os.access(store.root, os.W_OK):
        raise EnvironmentFault(f"{store.root} is read-only", hint="a user who may write to it can collect")
    done = collect(store, limit, dry_run=dry_run, wait_s=10.0)
    if done.busy:
        raise EnvironmentFault(f"a build uses {store.root}", hint="collect when it has ended")
    if as_json:
        say_json({"store": str(store.root), "dry_run": dry_run, **asdict(done)})
        return
    verb = "would drop" if dry_run else "dropped"
    say(f"{verb} {done.records:,} tasks and {done.blobs:,} files, {human(done.bytes)}; {human(done.bytes_left)} stay")


def warm() -> None:
    """Compile all kernels now, after an upgrade or in a container image, so that no build waits for them."""
    from pipeline.app.build import STEPS, warm_up
    from pipeline.errors import EnvironmentFault
    from pipeline.jit.files import REMEDY, cache_folder, can_keep, ready

    if not ready(cache_folder()).issuperset(STEPS) and not can_keep():
        raise EnvironmentFault(f"cannot keep compiled kernels in {cache_folder()}", hint=REMEDY)
    warm_up(STEPS)
    say(f"kernels are ready in {cache_folder()}")


_SIGNS = {"fine": " ", "doubt": "?", "wrong": "!"}


def doctor(as_json: Json = False) -> None:
    """Check versions, processor, device, store, disk, plug-in and settings; exit with 5 if something is wrong.

    Lines that begin with ? may cost time or room; those with ! keep the pipeline from working. Both state a remedy.
    """
    from pipeline.app.doctor import findings

    rows = list(findings())
    wrong = sum(finding.state == "wrong" for finding in rows)
    doubts = sum(finding.state == "doubt" for finding in rows)
    if as_json:
        say_json({"wrong": wrong, "doubts": doubts, "findings": [finding.to_dict() for finding in rows]})
    else:
        width = max(len(finding.name) for finding in rows)
        for finding in rows:
            say(f"{_SIGNS[finding.state]} {finding.name:<{width}}  {finding.value}")
            if finding.mend:
                say(f"  {'':<{width}}  mend: {finding.mend}")
        say(f"{number_of(wrong, 'problem')}, {number_of(doubts, 'doubt')}")
    raise typer.Exit(Exit.MACHINE if wrong else Exit.DONE)
