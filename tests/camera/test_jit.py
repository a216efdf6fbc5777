"""Compiled kernels are kept under a digest of all sources that can change them."""

import pytest

from pipeline.jit import _source_digest

SOURCES = {
    "room/__init__.py": "LAST = 3",
    "room/kernels.py": "from pipeline.jit import kernel\nfrom pipeline.room.table import ROW\n@kernel\ndef f(x): ...",
    "room/table.py": "from pipeline import units\nimport pipeline.room\nROW = units.MM",
    "units.py": "MM = 1",
    "apart.py": "from pipeline.room import kernels",
}


@pytest.fixture
def package(tmp_path):
    """A package with a kernel that reads a constant which comes from another one."""
    for name, text in SOURCES.items():
        path = tmp_path / "pipeline" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return tmp_path / "pipeline"


@pytest.mark.parametrize("name", ["room/kernels.py", "room/table.py", "units.py", "room/__init__.py"])
def test_an_edit_of_what_a_kernel_reaches_compiles_anew(package, name):
    """Numba compiles constants in and looks at the kernel's own file alone."""
    before = _source_digest(package)
    (package / name).write_text(SOURCES[name] + "\nX = 1", encoding="utf-8")
    assert _source_digest(package) != before


def test_comments_and_modules_that_no_kernel_reaches_do_not_count(package):
    before = _source_digest(package)
    (package / "apart.py").write_text("Y = 2", encoding="utf-8")
    (package / "units.py").write_text("# a remark\nMM = 1", encoding="utf-8")
    assert _source_digest(package) == before
