"""Settings of the documentation site: `make site` builds it with Sphinx, MyST and furo.

The source folder is the root of the repository, so that every link between pages is one between files, and works in
a file browser as on the site. `docs/index.md` is the first page.
"""

import re
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path.insert(0, str(ROOT))

from sphinx.application import Sphinx  # noqa: E402

import pipeline as documented  # noqa: E402

project = "plenoptic-pipeline"
author = "the authors of plenoptic-pipeline"
release = documented.__version__
language = "en"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "docs/index"
include_patterns = [
    *("docs/**.md", "CONVENTIONS.md", "CONTRIBUTING.md", "CHANGELOG.md", "README.md", "SECURITY.md"),
    *(
        "examples/*/README.md",
        "stages/README.md",
        "stages/lenses/README.md",
        "schemas/README.md",
        "benchmarks/README.md",
    ),
    "pipeline/optics/glass/README.md",
    "pipeline/plugins/lenses/README.md",
]
exclude_patterns = [".*", "build", "dist", "web", "docs/report", "tests/data"]

myst_heading_anchors = 4

autodoc_typehints = "none"
autodoc_member_order = "bysource"
toc_object_entries_show_parents = "hide"
default_role = "code"
napoleon_numpy_docstring = True
napoleon_use_rtype = False
nitpicky = True
nitpick_ignore_regex = [
    ("py:.*", ".*")
]  # types in docstrings are words with shapes, such as "(n, 3) float64, optional"

html_theme = "furo"
html_title = project
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0b5d6b", "color-brand-content": "#0b5d6b"},
    "dark_css_variables": {"color-brand-primary": "#5cc6d6", "color-brand-content": "#5cc6d6"},
    "navigation_with_keys": True,
}
highlight_language = "none"  # blocks without a language are what a command prints
pygments_style = "friendly"
pygments_dark_style = "github-dark"

LINK = re.compile(r"\[([^\[\]]*)\]\(([^()#:\s]+)\)")
"""A link to a file or folder of the repository: its text and its target."""

TOCTREE_PATTERN = re.compile(r"^([\w/]+\*)\n", re.MULTILINE)
"""A line such as `notebook*` of a toctree: room for pages that are not there yet, else a warning."""


def finish_source(_app: Sphinx, page: str, source: list[str]) -> None:
    """Lead links to folders to the page that describes them, and fill what is only on the site."""
    here = (ROOT / page).parent

    def led(link: re.Match[str]) -> str:
        text, target = link.groups()
        if not (here / target).is_dir():
            return link[0]
        return f"[{text}]({target.rstrip('/')}/README.md)" if (here / target / "README.md").is_file() else text

    source[0] = LINK.sub(led, source[0])
    if page == "docs/cli":
        source[0] += reference_of_the_command()
    if page == root_doc:
        source[0] = TOCTREE_PATTERN.sub(lambda line: line[0] if any(here.glob(f"{line[1]}.md")) else "", source[0])


def reference_of_the_command() -> str:
    """Every verb with its options, as Typer documents them."""
    command = [sys.executable, "-m", "typer", "pipeline.cli", "utils", "docs", "--name", "pipeline"]
    text = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    return text[text.index("\n## ") :]


def lead_to_the_first_page(app: Sphinx, exception: Exception | None) -> None:
    """Write index.html at the top of the site, which opens the first page."""
    if exception is None and app.builder.format == "html":
        page = '<!doctype html><meta charset="utf-8"><title>{0}</title><meta http-equiv="refresh" content="0; url={1}">'
        text = page.format(project, "docs/index.html") + '<a href="docs/index.html">Documentation</a>\n'
        (Path(app.outdir) / "index.html").write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> None:
    """Connect what this file adds."""
    app.connect("source-read", finish_source)
    app.connect("env-get-outdated", lambda *_: ["docs/cli"])  # its source is the command
    app.connect("build-finished", lead_to_the_first_page)
