"""Options of the whole test run."""

import collections
import fcntl
import gc
import os
import signal

from pipeline.machine.processor import pin

pin()  # before anybody imports NumPy: tests compute as the command does

import checked_shapes  # noqa: E402
import pytest  # noqa: E402

checked_shapes.install()  # before anybody imports a module that has shapes

# Tests of the command build often; those of the report ask for it.
os.environ["PIPELINE_REPORT"] = "no"

# A shell that runs this in the background tells it to ignore Ctrl-C, and what the tests start would ignore it too.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    """Tests of minutes begin first, each in another worker: one that began last would leave the other cores idle.

    To begin with, pytest-xdist gives each worker a stretch of the list, in its order.
    """
    workers = getattr(config, "workerinput", {"workercount": 1})["workercount"]
    long = sorted(filter(_minutes, items), key=_minutes, reverse=True)
    short, total = [item for item in items if not _minutes(item)], len(items)
    items.clear()
    for number in range(workers):
        first = long[number::workers]
        count = max((total - len(items)) // (workers - number) - len(first), 0)
        items += [*first, *short[:count]]
        del short[:count]


def _minutes(item):
    mark = item.get_closest_marker("heavy")
    return mark.kwargs.get("minutes", 0) if mark else 0


@pytest.hookimpl(wrapper=True)
def pytest_collection(session):
    """What is imported and collected stays: a quarter of the time was spent on a search for garbage in it.

    The first time, other workers wait for the one that makes byte code of tests and libraries: each would make it all.
    """
    gc.disable()
    if not hasattr(session.config, "workerinput"):
        return (yield)
    folder = session.config.cache.mkdir("byte-code")
    made = folder / "made"
    with (folder / "lock").open("w") as lock:
        if not made.exists():
            fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            result = yield
            made.touch()
            return result
    return (yield)


def pytest_collection_finish():
    """From now on garbage is looked for again, in what comes, but seldom: tests make stages by the thousand."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)
    gc.enable()


def pytest_sessionfinish():
    """Garbage is looked for once: pytest does so five times, which took a second of each worker."""
    gc.collect()
    gc.freeze()


def pytest_runtest_setup():
    """Each test checks shapes as if it ran alone."""
    checked_shapes.start_counting_anew()


def pytest_addoption(parser):
    """`--update-golden` is the only writer of golden files."""
    parser.addoption("--update-golden", action="store_true", help="write tests/golden anew and show what changes")


def pytest_terminal_summary(terminalreporter):
    """Say how long the tests of the core took, and those of each plug-in."""
    seconds = collections.Counter()
    for report in (report for reports in terminalreporter.stats.values() for report in reports):
        if hasattr(report, "duration"):
            folders = report.nodeid.split("/")
            seconds[folders[2] if folders[1:2] == ["plugins"] else "core"] += report.duration
    terminalreporter.write_line(", ".join(f"{room} {spent:.0f} s" for room, spent in seconds.most_common()))
