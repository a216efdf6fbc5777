"""Pictures of records in notebooks: drawn where the numbers are, by matplotlib only where it is installed."""

import dataclasses
import math
import re
import sys

import matplotlib
import numpy as np
import pytest
from builds import cells

import pipeline
from pipeline.errors import UsageError
from pipeline.files.png import write_png
from pipeline.results import drawing
from pipeline.results.notebook import html_table
from pipeline.results.rows import Backdrop, with_backdrop

matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def closed_figures():
    yield
    from matplotlib import pyplot

    pyplot.close("all")


@pytest.fixture(scope="module")
def ready_ideal(ideal):
    return pipeline.ready(ideal)


def crosses(axes) -> np.ndarray:
    """Places of all crosses of a plot, (n, 2), sorted."""
    places = [np.column_stack(line.get_data()) for line in axes.lines if line.get_marker() == "+"]
    return np.array(sorted(map(tuple, np.concatenate(places))))


def test_crosses_lie_at_the_positions_of_the_table_over_the_pixels_of_the_image(plenoptic_build):
    """(0, 0) is the centre of the first pixel: the image reaches half a pixel beyond it."""
    rows = cells(plenoptic_build / "frames/0002/Rig.Camera/correspondences.csv")
    stated = [(float(row["x_px"]), float(row["y_px"])) for row in rows]
    axes = pipeline.open_output(plenoptic_build).correspondences.plot(2)
    assert crosses(axes).tolist() == sorted(map(list, stated))
    (image,) = axes.images
    assert image.get_extent() == [-0.5, 47.5, 39.5, -0.5] and axes.get_ylim() == (39.5, -0.5)
    types = {f"Board, microlenses of type {kind}" for kind in range(3)}
    assert {text.get_text().split(":")[0] for text in axes.get_legend().get_texts()} == types


def test_a_selection_of_rows_still_knows_its_image_and_several_frames_have_none(plenoptic_build):
    rows = pipeline.open_output(plenoptic_build).camera.correspondences
    chosen = rows[(rows.frame == 1) & (rows.microlens_type == 0)]
    assert len(crosses(chosen.plot())) == len(chosen) > 0 and len(chosen.plot().images) == 1
    assert not rows.plot().images
    assert type(rows.x_px) is np.ndarray


def test_a_channel_of_a_sensor_is_drawn_over_its_own_image(tmp_path):
    """Rows of two channels share the name of their camera."""
    columns = {"camera": ["Cam"] * 3, "channel": ["red", "blue", "blue"], "target": ["Board"] * 3, "frame": [1] * 3}
    arrays = [np.array(column) for column in columns.values()] + [np.array([1.0, 2.0, 3.0])] * 2
    rows = np.rec.fromarrays(arrays, names=[*columns, "x_px", "y_px"])
    write_png(tmp_path / "blue.png", np.full((8, 8), 7, np.uint8))
    sizes = {"Cam@red": (9, 9), "Cam@blue": (8, 8)}
    shown = with_backdrop(rows, Backdrop(sizes, {("Cam@blue", 1): tmp_path / "blue.png"}))
    assert shown.seen_by.tolist() == ["Cam@red", "Cam@blue", "Cam@blue"]
    blue = shown.plot(1, "Cam@blue")
    assert crosses(blue).tolist() == [[2.0, 2.0], [3.0, 3.0]] and blue.images[0].get_array().max() == 7
    with pytest.raises(UsageError, match="several cameras") as told:
        shown.plot(1)
    assert told.value.hint == "choose: Cam@blue, Cam@red"


def test_what_cannot_be_plotted_is_named(plenoptic_build, monkeypatch):
    rows = pipeline.open_output(plenoptic_build).correspondences
    with pytest.raises(UsageError, match=r"no row is of frame 9") as told:
        rows.plot(9)
    assert told.value.hint == "frames with rows: 1, 2"
    with pytest.raises(UsageError, match="did you mean") as told:
        rows.plot(1, "Rig.Camra")
    with pytest.raises(UsageError, match="no rows to plot"):
        rows[:0].plot()
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.delitem(sys.modules, "matplotlib.pyplot", raising=False)
    with pytest.raises(UsageError, match=r"plenoptic-pipeline\[plot\]"):
        rows.plot(1)


def test_the_rays_of_an_ideal_lens_meet_on_the_sensor_and_pass_its_stop(ideal):
    """Object points are in focus: rays of one end at one point, which is as far from the axis as its place."""
    for field, height in ((0.0, 0.0), (0.7, 1.4), (1.0, 2.0)):
        rays = [np.array(ray) for ray in drawing.bundle(ideal, field, -100.0)]
        ends = np.array([ray[-1] for ray in rays])
        assert len(rays) == 7 and np.ptp(ends, axis=0).max() < 1e-9
        np.testing.assert_allclose(abs(ends[0]), [ideal.sensor_distance_mm, height], atol=1e-9)
        assert max(abs(np.interp(0, *ray.T)) for ray in rays) < 5 + 1e-9


def test_rays_of_an_ideal_lens_meet_on_a_tilted_sensor(ideal):
    """By Scheimpflug's rule: all rays of a point end at one place of the sensor, turned about the axis's point."""
    tilted = dataclasses.replace(ideal, sensor=dataclasses.replace(ideal.sensor, tilt_deg=(25.0, 10.0)))
    for field in (0.7, 1.0):
        ends = np.array([ray[-1] for ray in drawing.bundle(tilted, field, -100.0)])
        sine, cosine = math.sin(math.radians(25.0)), math.cos(math.radians(25.0))
        expected = [ideal.sensor_distance_mm + 2 * field * sine, 2 * field * cosine]
        assert len(ends) == 7 and np.abs(ends - expected).max() < 1e-9


def test_spots_are_drawn_to_scale(ready_ideal):
    """At the near end of the depth of field a disc, whose radius similar triangles state."""
    diagram = ready_ideal.spots()
    z_mm = diagram.rows[0][0].distance_mm
    radius_px = 5.0 * abs(z_mm - 500) / 500 * ready_ideal.camera.sensor_distance_mm / z_mm / 0.01
    shown = diagram.figure().axes[0]
    outline, dots = (np.array(line.get_data()) for line in shown.lines)
    assert np.ptp(outline, axis=1).tolist() == [1.0, 1.0]  # the pixel
    assert np.hypot(*dots).max() == pytest.approx(radius_px, rel=0.02)
    said = float(re.search(r"mm: ([\d.]+) px rms", shown.get_title(loc="left"))[1])
    assert said == pytest.approx(radius_px / math.sqrt(2), rel=0.01)
    assert shown.get_ylim()[0] > shown.get_ylim()[1] and "px rms" in diagram._repr_svg_()


def test_notebooks_show_figures_rows_and_images(plenoptic_build, ready_ideal):
    output = pipeline.open_output(plenoptic_build)
    shown = output._repr_html_()
    assert f"<td>{len(output.correspondences)}</td>" in shown and "<td>48 x 40</td>" in shown
    rows = output.correspondences._repr_html_()
    assert rows.count("<tr>") == 9 and f"{output.correspondences.x_px[0]:.6g}" in rows
    assert "<td>50 mm</td>" in ready_ideal._repr_html_() and "<svg" in ready_ideal._repr_html_()
    assert output.view(1)._repr_png_()[:4] == b"\x89PNG"
    assert "<b>" not in html_table(("a<b>",), [("<b>",)], "<b>")
