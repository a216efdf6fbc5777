"""A real browser opens the report from disk: it switches overlays, zooms, reads a row, and misses nothing."""

import json
import os
import shutil
import warnings
from pathlib import Path

import chromium
import numpy as np
import pytest
from builds import cells, tiny
from PIL import Image

from pipeline.files import svg
from pipeline.files.png import write_png
from pipeline.plugins.report.parts import picture_of
from pipeline.plugins.report.report import Report
from pipeline.records.plain import to_plain
from pipeline.results.records import BuiltFolder

pytestmark = pytest.mark.heavy  # a browser takes ten seconds of processor time


@pytest.fixture(scope="module")
def page(tmp_path_factory, common_store) -> tuple[Path, Path]:
    out = tiny("plenoptic", tmp_path_factory.mktemp("built"), common_store)
    maps = svg.document((300, 200), svg.element("rect", x=10, y=10, width=280, height=180, fill="#08306b"))
    report = Report()
    report.tell("Information", "Rig.Camera", ["fx  645.2", "fy  645.3"], maps)
    return out, report.write(out)


@pytest.fixture(scope="module")
def program() -> str:
    found = chromium.found()
    if found is None:
        loud = "NO CHROMIUM: THE REPORT WAS NOT TRIED IN A BROWSER. Debian, Ubuntu: apt install chromium"
        warnings.warn(loud, stacklevel=1)
        pytest.skip(loud)
    return found


def at_the_images(tab, page: Path) -> None:
    """Open a page and go to its images, until these are drawn."""
    tab.look_as(1400, 900)
    tab.open(page)
    tab.run("document.documentElement.style.scrollBehavior = 'auto'")
    tab.run("document.querySelector('#images').scrollIntoView()")
    tab.wait("(one => one.scale && one.rows > 0)(document.querySelector('.viewer-stage').dataset)")


@pytest.fixture
def tab(program, page):
    with chromium.browser(program) as tab:
        at_the_images(tab, page[1])
        yield tab


INK = """(() => { const canvas = document.querySelector('.overlay');
  const pixels = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  let drawn = 0; for (let i = 3; i < pixels.length; i += 4) drawn += pixels[i] > 0; return drawn })()"""
SCALE = "Number(document.querySelector('.viewer-stage').dataset.scale)"


def test_overlays_switch_by_keys_and_buttons(tab):
    inks = {}
    for key, name in (("1", "Points"), ("3", "Outlines"), ("4", "Lattice"), ("2", "Blur")):
        pressed = f"document.querySelector('[data-name={name}]').getAttribute('aria-pressed')"
        before = tab.run(pressed)
        tab.press(key)
        tab.wait(f"{pressed} !== '{before}'")
        inks[name] = tab.run(INK)
    assert inks["Points"] == 0  # they were switched on at first
    assert 0 < inks["Outlines"] < inks["Lattice"] < inks["Blur"]
    tab.run("document.querySelector('[data-name=Outlines]').click()")
    assert tab.run(INK) < inks["Blur"]
    assert tab.errors == []


def test_a_row_under_the_pointer_is_the_row_of_the_table_and_zoom_shows_its_pixel(tab, page):
    rows = cells(page[0] / "frames/0001/Rig.Camera/correspondences.csv")
    tab.run("document.querySelector('.viewer-stage').focus()")
    before = tab.settle(SCALE)
    tab.press("n")
    tab.wait(f"{SCALE} > 20")
    assert tab.run(SCALE) > before
    shown = "document.querySelector('[data-column={}]')?.textContent"
    assert tab.run(shown.format("x_px")) == rows[0]["x_px"]
    assert tab.run(shown.format("y_px")) == rows[0]["y_px"]
    tab.run("[...document.querySelectorAll('.zoom button')].find(one => one.ariaLabel === 'Show all').click()")
    assert tab.settle(SCALE) == pytest.approx(before)
    box = tab.run("(({left, top}) => [left, top])(document.querySelector('.viewer-stage').getBoundingClientRect())")
    corner = [float(one) for one in tab.settle("document.querySelector('.viewer-stage').dataset.corner").split()]
    last = rows[-1]
    x, y = (box[i] + corner[i] + float(last[name]) * before for i, name in enumerate(("x_px", "y_px")))
    tab.move(x + 1, y)
    tab.wait(f"{shown.format('x_px')} === '{last['x_px']}'")
    assert tab.run(shown.format("sigma_x_px")) == last["sigma_x_px"]
    assert tab.errors == []


def test_every_section_is_there_in_light_and_dark_and_nothing_comes_from_a_network(tab, tmp_path):
    """Pictures are kept where REPORT_PICTURES says, else with the test."""
    kept = Path(os.environ.get("REPORT_PICTURES", tmp_path))
    kept.mkdir(parents=True, exist_ok=True)
    signs = {
        "overview": ".card",
        "images": ".viewer-stage canvas",
        "scene": ".scene-box canvas",
        "lens": ".drawing svg polyline",
        "optics": ".u-over",
        "residuals": ".bar-fill",
        "information": ".drawing svg rect",
        "build": ".panel",
    }
    for width, theme in ((1400, "light"), (800, "dark")):
        tab.look_as(width, 900, theme)
        for name, sign in signs.items():
            tab.run(f"document.querySelector('#{name}').scrollIntoView()")
            tab.wait(f"document.querySelector('#{name} {sign}')")
            assert tab.picture(kept / f"{name}_{width}_{theme}.png").stat().st_size > 5000
        wide = tab.run("document.documentElement.scrollWidth")
        assert wide <= width, "the page scrolls sideways"
    assert tab.run("document.querySelector('#information pre').textContent") == "fx  645.2\nfy  645.3"
    dark = tab.run("getComputedStyle(document.body).backgroundColor.match(/[0-9]+/g).map(Number)")
    assert max(dark) < 64
    assert tab.errors == []
    assert [url for url in tab.requests if not url.startswith(("file:", "data:", "about:"))] == []


def test_everything_that_can_be_pressed_has_a_name(tab):
    """As a screen reader finds it."""
    for name in ("scene", "lens", "optics", "residuals", "information", "build"):
        tab.run(f"document.querySelector('#{name}').scrollIntoView()")
    tab.wait("document.querySelector('#build .panel')")
    nameless = """[...document.querySelectorAll('button, select, input, [role=img], canvas:not([aria-hidden]), a')]
      .filter(one => !one.closest('[aria-hidden], .viewer-stage, .scene-box, .u-wrap')
        && !(one.ariaLabel || one.textContent.trim() || one.labels?.length)).map(one => one.outerHTML.slice(0, 90))"""
    assert tab.run(nameless) == []


def test_all_words_stand_out_from_what_is_behind_them_in_light_and_dark(tab):
    """4.5 to 1, as WCAG 2 asks; a colour that does not is found."""
    contrast = (Path(__file__).parent / "scripts/contrast.js").read_text()
    for theme in ("light", "dark"):
        tab.look_as(1400, 900, theme)
        for name in ("images", "scene", "lens", "optics", "residuals", "information", "build"):
            tab.run(f"document.querySelector('#{name}').scrollIntoView()")
            tab.settle("document.body.innerHTML.length")
        assert tab.run(contrast) == {}, theme
    tab.run("document.documentElement.style.setProperty('--muted', '#46505e')")
    assert "P.muted" in tab.run(contrast)


def test_the_link_of_the_section_that_is_read_says_so(tab):
    current = "[...document.querySelectorAll('nav [aria-current]')].map((one) => [one.hash, one.ariaCurrent])"
    for name in ("images", "residuals", "lens", "overview"):
        for _ in range(2):  # what is filled in late moves what lies below it
            tab.run(f"document.querySelector('#{name}').scrollIntoView()")
            tab.settle("document.body.scrollHeight")
        tab.wait(f"document.querySelector('nav [aria-current]')?.hash === '#{name}'")
        assert tab.run(current) == [[f"#{name}", "location"]]


def test_a_link_lands_at_its_section_n_works_at_once_and_all_is_there_without_scrolling(program, page):
    """Of a page that was just opened; links used to land where a section had been before others were filled."""
    with chromium.browser(program) as tab:
        for link in ("build", "residuals"):
            tab.look_as(800, 900)
            tab.open(page[1])
            tab.run(f"document.querySelector('nav a[href=\"#{link}\"]').click()")
            tab.wait("!document.querySelector('[aria-busy]') && document.querySelector('#build .panel')")
            tab.settle("window.scrollY + document.body.scrollHeight")
            end = "window.scrollY + window.innerHeight > document.body.scrollHeight - 2"
            top = tab.run(f"document.querySelector('#{link}').getBoundingClientRect().top")
            assert 90 < top < 130 or tab.run(end), link
        tab.press("n")
        tab.wait("document.querySelector('[data-column=x_px]')")
        assert tab.run("document.querySelectorAll('.card, .bar-fill, .spot circle, .u-over').length") > 50
        assert (
            tab.run("[...new Set([...document.querySelectorAll('.spot svg')].map(one => one.clientWidth))].length") == 1
        )
        assert "all points in" in tab.run("document.querySelector('#overview').textContent")
        assert tab.errors == []


def test_the_view_in_space_comes_closer_by_keys_and_histograms_have_their_values(tab):
    tab.run("document.querySelector('#residuals').scrollIntoView()")
    tab.wait("document.querySelector('#residuals details')")
    charts = "[...document.querySelectorAll('#residuals .chart:not(.map)')]"
    rows = f"{charts}.map((one) => one.querySelectorAll('tbody tr').length)"
    high = "[...one.querySelectorAll('.bar-fill')].filter((bar) => Number(bar.getAttribute('height')) > 0)"
    bars = f"{charts}.map((one) => {high}.length)"
    assert tab.run(rows) == tab.run(bars) and min(tab.run(rows)) > 0
    tab.run("document.querySelector('#scene').scrollIntoView()")
    tab.wait("document.querySelector('.scene-box canvas')")
    drawn = "document.querySelector('.scene-box canvas').toDataURL().length"
    before = tab.settle(drawn)
    tab.run("document.querySelector('.scene-box').focus()")
    for _ in range(4):
        tab.press("+")
    assert tab.settle(drawn) != before
    assert tab.errors == []


@pytest.fixture
def large(page, tmp_path) -> tuple[Path, np.ndarray]:
    """The page with a frame of 12 megapixels, as tiles, and its grey values."""
    place = tmp_path / "large.report"
    shutil.copytree(page[1].parent, place)
    grey = np.random.default_rng(5).integers(0, 256, (3000, 4000), dtype=np.uint8)
    write_png(place / "frame.png", grey)
    folder = BuiltFolder(path=place, stage="", digests={"frame.png": "cd" * 32})
    picture = to_plain(picture_of(folder, "frame.png", "image", place))
    head, _, rest = (place / "data/page.js").read_text().partition(",")
    content = json.loads(rest.rstrip(";\n").removesuffix(")"))
    content["cameras"][0]["views"][0]["pictures"] = [picture]
    (place / "data/page.js").write_text(f"{head},{json.dumps(content)});\n")
    return place / "index.html", grey


def test_every_pixel_of_a_large_frame_is_where_its_position_says(program, large, tmp_path):
    """(0, 0) is the centre of the first pixel: colours on the screen are those of the image."""
    with chromium.browser(program) as tab:
        at_the_images(tab, large[0])
        tab.press("1")  # no crosses over the pixels
        tab.run("[...document.querySelectorAll('.zoom button')].find(one => one.textContent === '1:1').click()")
        corner = [float(one) for one in tab.settle("document.querySelector('.viewer-stage').dataset.corner").split()]
        scale = tab.run(SCALE)
        box = tab.run("(({left, top}) => [left, top])(document.querySelector('.viewer-stage').getBoundingClientRect())")
        shown = np.array(Image.open(tab.picture(tmp_path / "large.png")).convert("L"))
        assert tab.errors == []
    assert scale == pytest.approx(16, rel=1e-3)
    columns, rows = np.meshgrid(np.arange(1975, 2012), np.arange(1485, 1515))
    x, y = (np.floor(box[i] + corner[i] + place * scale).astype(int) for i, place in enumerate((columns, rows)))
    assert (shown[y, x] == large[1][rows, columns]).mean() > 0.99
