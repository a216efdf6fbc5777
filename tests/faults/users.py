"""R31: a second user. Root becomes another one in a fork of a process that has loaded everything."""

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

from faults.workbench import Row, Workbench

from pipeline.engine.maintenance import check
from pipeline.engine.store.store import Store

_GROUP, _FIRST, _SECOND = 54320, 54321, 54322
_UMASKS = (0o022, 0o077)


def _user(number: int, umask: int, place: Path, out: str) -> Callable[[], None]:
    """Become a user of the group, without a home, who delivers to a folder of his own."""

    def become() -> None:
        os.environ["XDG_CACHE_HOME"] = str(place / f"cache{number}")
        os.setgroups([_GROUP])
        os.setgid(number)
        os.setuid(number)
        os.umask(umask)

    (place / out).mkdir(exist_ok=True)
    (place / f"cache{number}").mkdir(exist_ok=True)
    for path in (place / out, place / f"cache{number}"):
        os.chown(path, number, number)
    return become


def second_users(bench: Workbench) -> Row:
    """One builds, another goes on in the same store: all in it is of the group, or the build says what mends it."""
    row = Row("R31", "a second user: shared store, one that was not meant to be, read-only one")
    if os.geteuid():
        row.notes.append("not tried: only root can be another user")
        return row
    bench.folder.chmod(0o755)
    cases = [(mode, umask) for mode in (0o2770, 0o2775, 0o777) for umask in _UMASKS]
    for number in bench.some(len(cases), 2):
        _share(bench, row, *cases[number - 1])
    _mended_by_its_hint(bench, row)
    _read_only(bench, row)
    return row


def _new_place(bench: Workbench, mode: int) -> Path:
    place = bench.new_place()
    place.chmod(0o755)
    (place / "store").mkdir()
    os.chown(place / "store", 0, _GROUP)
    (place / "store").chmod(mode)
    return place


def _share(bench: Workbench, row: Row, mode: int, umask: int) -> None:
    """Two users in turns: the second finds all results, makes lost ones again, and the first finds those."""
    place = _new_place(bench, mode)
    first, second = _user(_FIRST, umask, place, "out"), _user(_SECOND, umask, place, "out2")
    row.wrong += bench.build_in_fork(place, meanwhile=first) != 0
    shutil.rmtree(place / "store/ac")
    for user, out in ((second, "out2"), (first, "out")):
        row.tried += 1
        row.wrong += bench.build_in_fork(place, meanwhile=user, out=out) != 0 or bench.differs(place, out)
    row.notes += bench.unexpected()
    made = {path.stat().st_gid for path in (place / "store").rglob("*") if path.is_dir()}
    row.wrong += made != {_GROUP}
    shutil.rmtree(place / "out2")
    bench.judge(row, place)


def _mended_by_its_hint(bench: Workbench, row: Row) -> None:
    """A store that was made for one user, and whose root alone was then opened for others."""
    place = _new_place(bench, 0o755)
    os.chown(place / "store", _FIRST, _GROUP)
    row.wrong += bench.build_in_fork(place, meanwhile=_user(_FIRST, 0o077, place, "out")) != 0
    (place / "store").chmod(0o2770)
    second = _user(_SECOND, 0o077, place, "out2")
    said = place / "said.txt"
    said.touch()
    said.chmod(0o666)
    row.tried += 1
    row.failed += bench.build_in_fork(place, meanwhile=second, out="out2", said=said) == 5
    row.wrong += "-exec chmod g+rwx {} +" not in said.read_text()
    subprocess.run(said.read_text().partition("mends it: ")[2], shell=True, check=True)
    row.wrong += bench.build_in_fork(place, meanwhile=second, out="out2") != 0 or bench.differs(place, "out2")
    row.notes += bench.unexpected()
    shutil.rmtree(place)


def _read_only(bench: Workbench, row: Row) -> None:
    """Of a user who lets others only read: what is new goes to a private store."""
    place = _new_place(bench, 0o755)
    os.chown(place / "store", _FIRST, _FIRST)
    row.wrong += bench.build_in_fork(place, meanwhile=_user(_FIRST, 0o022, place, "out")) != 0
    shutil.rmtree(place / "store/ac")
    row.tried += 1
    second = _user(_SECOND, 0o022, place, "out2")
    row.wrong += bench.build_in_fork(place, meanwhile=second, out="out2") != 0 or bench.differs(place, "out2")
    row.notes += bench.unexpected()
    row.bad += bool(check(Store(place / "store")).damaged)
    shutil.rmtree(place)
