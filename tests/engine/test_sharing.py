"""A store of several users: root becomes others in forks of this process, after it has loaded everything."""

import os
import shutil
import tempfile
import traceback
from pathlib import Path

import pytest
from engine import toy
from faults.shim import in_fork

from pipeline.engine.maintenance import check
from pipeline.engine.options import ALONE
from pipeline.engine.running.session import build
from pipeline.engine.store.store import Store
from pipeline.errors import PipelineError

GROUP, FIRST, SECOND = 54320, 54321, 54322

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")


@pytest.fixture
def place(tmp_path, kit):
    """A folder that everybody reaches, with one for each user."""
    build(toy.project(tmp_path / "warm"), ALONE)  # loads what the forks inherit: others may not read our Python
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        place.chmod(0o755)
        for folder in (tmp_path, *tmp_path.parents):
            if folder.stat().st_uid == os.geteuid() and folder != Path("/"):
                folder.chmod(folder.stat().st_mode | 0o055)
        for user in (FIRST, SECOND):
            (place / str(user)).mkdir()
            os.chown(place / str(user), user, user)
        yield place


def make_store(place, mode, user=0, group=GROUP):
    root = place / "store"
    root.mkdir()
    os.chown(root, user, group)
    root.chmod(mode)


def build_as(place, user, umask):
    """Exit code of a build of that user, and what was said."""
    said = place / f"{user}/said.txt"

    def work():
        os.environ["XDG_CACHE_HOME"] = str(place / f"{user}/cache")
        os.setgroups([GROUP])
        os.setgid(user)
        os.setuid(user)
        os.umask(umask)
        try:
            warnings = []
            result = build(
                toy.project(place / f"{user}/out"), ALONE, store=Store(place / "store", warn=warnings.append)
            )
            said.write_text("\n".join([*warnings, *(str(task.error) for task in result.failures)]))
            return result.exit_code
        except PipelineError as error:
            said.write_text(str(error))
            return error.exit_code
        except BaseException:
            said.write_text(traceback.format_exc())
            return 70

    return in_fork(work), said.read_text()


def test_users_of_a_group_go_on_where_the_other_was(place):
    make_store(place, 0o2770)
    assert build_as(place, FIRST, 0o002) == (0, "")
    shutil.rmtree(place / "store/ac")
    shutil.rmtree(place / "store/history")
    assert build_as(place, SECOND, 0o002) == (0, "")
    assert build_as(place, FIRST, 0o002) == (0, "")
    assert {path.stat().st_gid for path in (place / "store").rglob("*") if path.is_dir()} == {GROUP}
    assert not check(Store(place / "store")).damaged
    assert toy.contents(place / str(FIRST) / "out") == toy.contents(place / str(SECOND) / "out")


def test_a_store_that_others_only_read_serves_what_it_has(place):
    make_store(place, 0o755, FIRST, FIRST)
    assert build_as(place, FIRST, 0o022) == (0, "")
    assert build_as(place, SECOND, 0o022) == (0, "")
    shutil.rmtree(place / "store/ac")
    code, said = build_as(place, SECOND, 0o022)
    assert code == 5 and "Permission denied" in said


def test_compiled_kernels_of_another_user_are_left_alone(tmp_path, monkeypatch):
    from pipeline.jit.decorators import cache_folder

    monkeypatch.setenv("PIPELINE_JIT_CACHE", str(tmp_path))
    usual = cache_folder()
    usual.mkdir()
    assert cache_folder() == usual
    os.chown(usual, FIRST, FIRST)
    assert cache_folder() == usual.with_name(f"{usual.name}-0")
