"""R31: a second user. Root becomes another one in a fork of a process that has loaded everything."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

from faults.workbench import Row, Workbench, damage

_GROUP, _FIRST, _SECOND = 54320, 54321, 54322


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
    """One builds, another goes on in the same store: all in it is of the group."""
    row = Row("R31", "a second user: a store of the group, and one that others may only read")
    if os.geteuid():
        row.notes.append("not tried: only root can be another user")
        return row
    bench.folder.chmod(0o755)
    for mode in (0o2770, 0o2775):
        _share(bench, row, mode)
    _read_only(bench, row)
    return row


def _new_place(bench: Workbench, mode: int) -> Path:
    place = bench.new_place()
    place.chmod(0o755)
    (place / "store").mkdir()
    os.chown(place / "store", 0, _GROUP)
    (place / "store").chmod(mode)
    return place


def _share(bench: Workbench, row: Row, mode: int) -> None:
    """Two users in turns: the second finds all results, makes lost ones again, and the first finds those."""
    place = _new_place(bench, mode)
    first, second = _user(_FIRST, 0o002, place, "out"), _user(_SECOND, 0o002, place, "out2")
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


def _read_only(bench: Workbench, row: Row) -> None:
    """Of a user who lets others only read: what is there serves them, what is not ends their build."""
    place = _new_place(bench, 0o755)
    os.chown(place / "store", _FIRST, _FIRST)
    row.wrong += bench.build_in_fork(place, meanwhile=_user(_FIRST, 0o022, place, "out")) != 0
    second = _user(_SECOND, 0o022, place, "out2")
    row.tried += 2
    row.wrong += bench.build_in_fork(place, meanwhile=second, out="out2") != 0 or bench.differs(place, "out2")
    shutil.rmtree(place / "store/ac")
    row.failed += bench.build_in_fork(place, meanwhile=second, out="out2") == 5
    row.wrong += row.failed != 1
    row.notes += bench.unexpected()
    row.bad += bool(damage(place).damaged)
    shutil.rmtree(place)
