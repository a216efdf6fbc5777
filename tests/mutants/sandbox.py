"""A copy of the tree in which mistakes are made, one at a time, and the tests that may notice them."""

import ast
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mutants.imports import Imports, module_of
from mutants.mutations import Mutant

from pipeline.jit.decorators import cache_folder

ROOT = Path(__file__).resolve().parents[2]
OPTICS = ("optics", "naive/test_trace.py", "naive/test_aspheres.py", "laws/test_surfaces.py", "laws/test_apertures.py")
CAMERA = (
    *("naive/test_bundle.py", "naive/test_microlenses.py", "laws/test_microlenses.py", "laws/test_regions.py"),
    *("laws/test_edges.py", "laws/test_symmetry.py", "laws/test_arrays.py", "laws/test_displacement.py", "camera"),
    *("laws/test_focus.py", "laws/test_f_numbers.py", "laws/test_limits.py", "laws/test_depth_of_field.py"),
    *("laws/test_ideal_lens.py", "laws/test_travel.py", "laws/test_offsets.py", "laws/test_footprint.py"),
    *("laws/test_pinhole.py", "scene/test_viewers.py"),
)
TRUTH = (
    *("laws/test_search.py", "laws/test_second_moments.py", "laws/test_second_order.py", "naive/test_quad_search.py"),
    *("laws/test_truth.py", "laws/test_direct.py", "laws/test_hit_fraction.py", "laws/test_visibility.py"),
    *("laws/test_corner_image.py", "laws/test_measure.py", "laws/test_column_sets.py", "laws/test_methods.py"),
    *("naive/test_properties.py", "laws/test_footprint.py", "laws/test_own_bundle.py", "laws/test_certificate.py"),
)
ROOMS = {
    "optics": (*OPTICS, "published", "laws/test_travel.py", "laws/test_displacement.py", "naive/test_bundle.py"),
    "camera": (*CAMERA, "naive/test_micro_light.py", "laws/test_direct.py", "published"),
    "truth": TRUTH,
    "targets": (
        "targets",
        "scene/test_viewers.py",
        "naive/test_targets.py",
        "laws/test_visibility.py",
        "laws/test_methods.py",
    ),
}
"""Tests of each room below `tests/`; of those equally near the first ones run first: twins, laws of whole bundles."""
PLAIN = (
    *("optics", "naive/test_aspheres.py", "naive/test_trace.py", "laws/test_surfaces.py", "laws/test_apertures.py"),
    *("laws/test_second_moments.py", "laws/test_search.py", "naive/test_quad_search.py", "laws/test_corner_image.py"),
    *("targets", "naive/test_targets.py", "laws/test_edges.py", "laws/test_regions.py", "laws/test_footprint.py"),
    *("laws/test_own_bundle.py", "laws/test_measure.py", "laws/test_ideal_lens.py", "laws/test_microlenses.py"),
)
"""Tests that may be short enough for kernels in plain Python."""
_NO_LAWS = ("test_jit.py", "test_golden.py", "test_mutations.py")
LIMIT_S = 900
"""A mistake whose tests take so long is not judged: the machine may be busy."""
TOO_LATE = "time:"
IN_PLAIN_PYTHON = ", in plain Python"


@dataclass(frozen=True, slots=True)
class Site:
    """A mistake and the file that it is made in, relative to the root."""

    file: Path
    mutant: Mutant

    @property
    def module(self) -> str:
        """Dotted name."""
        return ".".join(self.file.with_suffix("").parts)

    @property
    def functions(self) -> set[str]:
        """Names of the functions around it."""
        line = self.mutant.place[0]
        return {
            node.name
            for node in ast.walk(ast.parse(self.mutant.original))
            if isinstance(node, ast.FunctionDef) and node.lineno <= line <= (node.end_lineno or 0)
        }


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a mistake: the test that failed, or why none could; empty where it survived."""

    site: Site
    noticed_by: str
    seconds: float


class Sandbox:
    """A copy of the tree, and of the kernels that are compiled for it.

    Kernels are kept in a folder for all sources together: after one edit all would be compiled again. So
    `jit/decorators.py` of the copy takes the folder as it is told, and only those that a mistake reaches are removed.
    """

    def __init__(self, folder: Path, nearest: int, root: Path = ROOT) -> None:
        self.tree, self.nearest = folder / "tree", nearest
        self.sound: set[str] = set()
        shutil.rmtree(self.tree, ignore_errors=True)
        tracked = subprocess.run(["git", "ls-files", "-z", "-co", "--exclude-standard"], cwd=root, capture_output=True)
        for name in filter(None, tracked.stdout.decode().split("\0")):
            if (root / name).is_file():
                (self.tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(root / name, self.tree / name)
        with (self.tree / "pipeline/jit/decorators.py").open("a", encoding="utf-8") as file:
            file.write('\n\ndef cache_folder() -> Path:\n    return Path(os.environ["PIPELINE_JIT_CACHE"])\n')
        self.imports = Imports(self.tree)
        self.kernels = folder / "kernels"
        shutil.rmtree(self.kernels, ignore_errors=True)
        if root == ROOT and cache_folder().is_dir():
            shutil.copytree(cache_folder(), self.kernels)

    def glance(self, site: Site) -> Verdict | None:
        """The verdict of plain Python on a mistake in a kernel; None where compiled kernels have the last word."""
        start = time.monotonic()
        noticed_by = self.refuted_in_plain_python(site)
        return Verdict(site, noticed_by, time.monotonic() - start) if noticed_by else None

    def judge(self, site: Site) -> Verdict:
        """Make a mistake, run the tests of its room, and take it back."""
        start = time.monotonic()
        with self._made(site):
            kernels = self._kernels_without(site) if site.mutant.in_kernel else self.kernels
            noticed_by = self.tests(self.chosen(site), kernels)
        self._must_pass(noticed_by)
        return Verdict(site, noticed_by, time.monotonic() - start)

    @contextmanager
    def _made(self, site: Site) -> Iterator[None]:
        """The tree with a mistake."""
        path = self.tree / site.file
        original, stat = path.read_bytes(), path.stat()
        path.write_text(site.mutant.source, encoding="utf-8")
        try:
            yield
        finally:
            path.write_bytes(original)
            os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))

    def refuted_in_plain_python(self, site: Site) -> str:
        """The test whose assertion fails in plain Python, and does not without the mistake; empty where none does.

        Where all pass, or raise other errors, or take long, compiled kernels have the last word.
        """
        short = [name for name in self.reaching(site) if any(f"{name}/".startswith(f"tests/{one}/") for one in PLAIN)]
        with self._made(site):
            test = self.refuted_by(short[: self.nearest])
        return f"{test}{IN_PLAIN_PYTHON}" if test and not self.refuted_by([f"tests/{test}"]) else ""

    def refuted_by(self, tests: list[str]) -> str:
        """The first of some tests whose assertion fails in plain Python, see `plain`; empty where none does."""
        refuted = self.tree.parent / "refuted.txt"
        refuted.write_text("", encoding="utf-8")
        told = {"PLAIN_REFUTED": str(refuted), "PIPELINE_JIT_CACHE": str(self.kernels)}
        if tests:
            self._pytest(["-p", "mutants.plain", *tests], told)
        return refuted.read_text(encoding="utf-8").removeprefix("tests/")

    def _must_pass(self, test: str) -> None:
        """A test that fails without any mistake says nothing about one."""
        if ".py" in test and test not in self.sound:
            if self.tests([f"tests/{test}"], self.kernels):
                raise SystemExit(f"tests/{test} fails without a mistake, too")
            self.sound.add(test)

    def chosen(self, site: Site) -> list[str]:
        """Test files that shall judge a mistake."""
        return self.reaching(site)[: self.nearest]

    def reaching(self, site: Site) -> list[str]:
        """Test files that name the function, then those that reach the module through fewest imports.

        They are those of the room; where none of these reaches the module, any that do, but golden files.
        """
        away = self.imports.distances(site.module)
        places = [self.tree / "tests" / name for name in ROOMS[site.file.parts[1]]]
        files = [file for place in places for file in (sorted(place.rglob("test_*.py")) if place.is_dir() else [place])]
        anywhere = sorted((self.tree / "tests").rglob("test_*.py"))
        reached = self._reached(files, away) or self._reached(anywhere, away)
        named = re.compile("|".join(rf"\b{name}\b" for name in site.functions) or "(?!)")
        silent = {name: not named.search((self.tree / name).read_text(encoding="utf-8")) for name in reached}
        return sorted(reached, key=lambda name: (silent[name], away[module_of(name)]))

    def _reached(self, files: list[Path], away: dict[str, int]) -> list[str]:
        names = [str(file.relative_to(self.tree)) for file in files if file.name not in _NO_LAWS]
        return [name for name in names if module_of(name) in away]

    def tests(self, files: list[str], kernels: Path) -> str:
        """The first test that fails, or the reason why tests could not run; empty where all pass, or there are none."""
        if not files:  # without files pytest would run all tests
            return ""
        found = self._pytest(["-x", *files], {"PIPELINE_JIT_CACHE": str(kernels)})
        if found is None:
            return f"{TOO_LATE} {LIMIT_S} s"
        if found.returncode == 0:
            return ""
        test = re.search(r"^(?:FAILED|ERROR) (?:tests/)?(.*?)(?: - .*)?$", found.stdout, re.MULTILINE)
        return test[1] if test else f"exit code {found.returncode}"

    def _pytest(self, arguments: list[str], told: dict[str, str]) -> subprocess.CompletedProcess[str] | None:
        """Run tests in the copy; None where they take too long."""
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join((str(self.tree), str(self.tree / "tests"))),
            "PYTHONDONTWRITEBYTECODE": "1",
            "PIPELINE_CACHE": str(self.tree.parent / "store"),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            **told,
        }
        command = [sys.executable, "-m", "pytest", "-q", "--tb=no", "-p", "no:cacheprovider", *arguments]
        options = {"cwd": self.tree, "env": environment, "capture_output": True, "text": True, "timeout": LIMIT_S}
        try:
            return subprocess.run(command, check=False, **options)
        except subprocess.TimeoutExpired:
            return None

    def _kernels_without(self, site: Site) -> Path:
        """Compiled kernels that a mistake in a module cannot reach, in a folder of its own."""
        folder = self.kernels.with_name("kernels_of_mutant")
        shutil.rmtree(folder, ignore_errors=True)
        ignore = shutil.ignore_patterns(*(f"{module}.*-*" for module in self.imports.distances(site.module)))
        if self.kernels.is_dir():
            shutil.copytree(self.kernels, folder, ignore=ignore)
        return folder
