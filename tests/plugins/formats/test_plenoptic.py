"""A camera that is what libpleno assumes, through the formats for plenoptic cameras and their readers."""

import re
from dataclasses import replace

import numpy as np
import pytest
from plugins.formats.flipping import flips, require_notice
from plugins.formats.libpleno_reader import check_libpleno, kind, matrix, node, read, reprojection_errors, sections
from plugins.formats.plenoptic_readers import check_bok, check_lightfield, check_plenopticam
from plugins.formats.pretended import write_manifest
from plugins.formats.pretended_plenoptic import PlenopticScene, write_plenoptic_build

from pipeline.exports.export import Request, export
from pipeline.exports.micro_images import GridMesh, MicroImages, micro_image_grid
from pipeline.exports.noise import Noise
from pipeline.formats import Centre, ExportError, format_of, module_of
from pipeline.results.output import open_output

CHECKS = {
    "libpleno": check_libpleno,
    "bok": check_bok,
    "plenopticam": check_plenopticam,
    "lightfield": check_lightfield,
}
LAYOUTS = {
    "libpleno": ("hexagonal", "hexagonal-columns", "square"),
    "raytrix": ("hexagonal",),
    "bok": ("hexagonal",),
    "lftoolbox": ("hexagonal",),
    "plenopticam": ("hexagonal", "square"),
    "lightfield": ("hexagonal", "hexagonal-columns", "square"),
}
"""Arrays that a format knows."""
UNSEEN = {("plenopticam", "microlenses")}
"""It knows no types, and without numbers it writes nothing."""
ARRAYS = ("hexagonal", "hexagonal-columns", "square")
KNOWN = [(layout, name) for layout in ARRAYS for name in CHECKS if layout in LAYOUTS[name]]
REFUSED = [(layout, name) for layout in ARRAYS for name in LAYOUTS if layout not in LAYOUTS[name]]


def flips_of_known():
    """Every flip, with every array that its format knows: in `make test`, with one that takes turns."""
    for number, flip in enumerate(flips(CHECKS, UNSEEN)):
        known = LAYOUTS[flip.values[0]]
        for layout in known:
            marks = () if layout == known[number % len(known)] else pytest.mark.heavy
            yield pytest.param(layout, *flip.values, id=f"{layout}-{flip.id}", marks=marks)


@pytest.fixture(scope="module")
def scene(request):
    return PlenopticScene(layout=request.param)


@pytest.fixture(scope="module")
def output(tmp_path_factory, scene):
    return open_output(write_plenoptic_build(tmp_path_factory.mktemp("plenoptic") / "out", scene))


@pytest.mark.parametrize(("scene", "name"), KNOWN, indirect=["scene"])
def test_its_reader_gets_back_every_number(output, scene, name, tmp_path):
    (folder,) = export(output, [name], tmp_path)
    CHECKS[name](folder, scene)


@pytest.mark.parametrize(("scene", "name", "field", "other"), list(flips_of_known()), indirect=["scene"])
def test_a_flip_of_a_convention_is_noticed(output, scene, name, field, other, tmp_path, monkeypatch):
    require_notice(lambda folder: CHECKS[name](folder, scene), output, name, {field: other}, tmp_path, monkeypatch)


@pytest.mark.parametrize(("scene", "name"), REFUSED, indirect=["scene"])
def test_arrays_that_a_format_does_not_know_are_refused(output, scene, name, tmp_path):
    with pytest.raises(ExportError, match=r"supports only .*rows"):
        export(output, [name], tmp_path)


def test_the_reader_counts_as_published_observations_do():
    """Rows of examples/obs/bap-R12-A.csv of libpleno: rho tells the type, u the shift of even rows."""
    published = [(156, 69, 3628.13, -3.55412), (157, 69, 3650.59, -4.18067), (157, 68, 3660.97, -3.55412)]
    published += [(158, 69, 3671.92, -4.48739), (160, 68, 3726.85, -3.55412), (161, 68, 3749.73, -4.18067)]
    rho = {}
    for k, l, _, blur in published:
        assert rho.setdefault(kind({"geometry": 1}, 3, k, l), blur) == blur
    assert len(rho) == 3
    upright = {"rotation": [[1, 0], [0, 1]], "translation": [[0.0, 0.0]]}
    mesh = {"geometry": 1, "pitch": [[22.0, 22.0]], "pose": upright}
    for k, l, u, _ in published:
        assert node(mesh, k, l)[0] - node(mesh, 156, 69)[0] == pytest.approx(u - 3628.13, abs=2)


def test_a_real_lens_is_nearest_to_the_model_by_its_principal_point(tmp_path, plenoptic_build, monkeypatch):
    """Start values explain the rows of a double Gauss to 2 um on the sensor, 0.07 px; by the pinhole less well."""
    output, off = open_output(plenoptic_build), {}
    for centre in Centre:
        monkeypatch.setattr(module_of("libpleno"), "FORMAT", replace(format_of("libpleno"), centre=centre))
        (folder,) = export(output, ["libpleno"], tmp_path / centre.name)
        off[centre] = reprojection_errors(read(folder / "Rig.Camera"))
    found = off[Centre.PRINCIPAL_POINT]
    assert np.sqrt((found[:, :2] ** 2).mean()) < 0.07 and abs(found[:, 2].mean()) < 0.02
    assert (off[Centre.PINHOLE][:, :2] ** 2).mean() > 2 * (found[:, :2] ** 2).mean()


@pytest.mark.parametrize("scene", ARRAYS, indirect=True)
def test_rows_without_a_blur_radius_are_corners_alone(tmp_path, scene):
    out = write_plenoptic_build(tmp_path / "out", scene)
    table = out / "frames/0001/Rig.Camera/correspondences.csv"
    *lines, last = table.read_text().splitlines()
    table.write_text("\n".join([*lines, last.rpartition(",")[0] + ",", ""]))
    write_manifest(out)
    (folder,) = export(open_output(out), ["libpleno"], tmp_path)
    features = sections(folder / "Rig.Camera/observations.bin.gz")[2]
    corners = sections(folder / "Rig.Camera/corners.bin.gz")[1]
    assert len(features) == len(corners) - 1


def test_types_that_libpleno_cannot_count_are_refused(tmp_path):
    out = write_plenoptic_build(tmp_path / "out", PlenopticScene())
    table = out / "cameras/Rig.Camera/micro_images.csv"
    head, first, second, *rows = table.read_text().splitlines()
    swapped = [re.sub(r"^(\S+?,\S+?),\d", r"\1,1", row) if i % 5 == 0 else row for i, row in enumerate(rows)]
    table.write_text("\n".join([head, first, second, *swapped, ""]))
    write_manifest(out)
    with pytest.raises(ExportError, match="as libpleno counts"):
        export(open_output(out), ["libpleno"], tmp_path)


@pytest.mark.parametrize("seen", [2, 3])
def test_a_type_without_a_micro_image_in_the_picture_keeps_its_number(seen):
    """Of a row of types 1, 2, 0 an image shows two or all three; libpleno counts them 0, 1, 2 from the left."""
    images = MicroImages(
        layout="hexagonal",
        microlenses=np.array([(1, 0), (2, 0), (3, 0)]),
        types=np.array([1, 2, 0]),
        centres=np.array([(5.0, 5.0), (15.0, 5.0), (25.0, 5.0)]),
        focal_lengths_mm=np.array([1.9, 2.1, 2.3]),
        own_types=np.arange(3),
    )
    grid = micro_image_grid(images, (10 * seen, 10), np.empty((0, 2), np.int64))
    renumbered = grid.renumbered(images)
    assert renumbered.types.tolist() == list(range(seen))
    assert renumbered.own_types.tolist() == [1, 2, 0]
    assert renumbered.focal_lengths_mm.tolist() == [2.1, 2.3, 1.9]


@pytest.mark.parametrize("scene", ARRAYS, indirect=True)
def test_noise_moves_observations_and_no_centre(output, tmp_path):
    exact, noisy = (
        sections(
            export(output, ["libpleno"], tmp_path / str(i), Request(noise=noise))[0] / "Rig.Camera/observations.bin.gz"
        )
        for i, noise in enumerate((Noise(), Noise(noise_px=0.1)))
    )
    assert exact[0] == noisy[0] and len(exact[2]) == len(noisy[2])
    moved = [abs(a[2] - b[2]) for a, b in zip(exact[2], noisy[2], strict=True)]
    assert 0.05 < sum(moved) / len(moved) < 0.11


def test_raytrix_refuses_a_depth_of_field_that_reaches_the_focal_point(tmp_path, plenoptic_build):
    with pytest.raises(ExportError, match="up to the focal point"):
        export(open_output(plenoptic_build), ["raytrix"], tmp_path / "exports")


@pytest.mark.parametrize("layout", ["square", "hexagonal", "hexagonal-columns"])
@pytest.mark.parametrize("size", [(7, 8), (8, 7)])
def test_microlenses_of_libpleno_are_opposite_to_their_micro_images(layout, size):
    """The law of its central projection for any number of lines: (k, l) lies beyond (columns - 1 - k, rows - 1 - l)."""
    from pipeline.plugins.formats.plenoptic import libpleno as writer

    axis, per_px, (columns, rows) = np.array([90.0, 70.0]), 0.004, size
    mesh = GridMesh(
        layout=layout,
        columns=columns,
        rows=rows,
        pitch_px=(20.0, 20.5),
        angle_rad=0.1,
        origin=np.array([8.0, 6.0]),
        middle=np.zeros(2),
    )
    images = writer._mesh(mesh)
    pose = writer._array_pose(mesh, axis, per_px, 50.0)
    flat = {**images, "pitch": [[20.0 * per_px, 20.5 * per_px]]}
    flat["pose"] = {"rotation": np.eye(2), "translation": [[0.0, 0.0]]}
    for k in range(columns):
        for l in range(rows):
            here = node(flat, images["width"] - 1 - k, images["height"] - 1 - l)
            there = matrix(pose["rotation"])[:2, :2] @ here + pose["translation"][0][:2]
            np.testing.assert_allclose(there, -(node(images, k, l) - axis) * per_px, rtol=0, atol=1e-12)


def test_a_thin_lens_is_not_made_up_for_a_camera_that_looks_into_water(tmp_path):
    out = write_plenoptic_build(tmp_path / "out", PlenopticScene(layout="hexagonal"))
    record = out / "cameras/Rig.Camera/camera.json"
    record.write_text(record.read_text().replace('"lens": {', '"lens": {"index_in_front": 1.34, '))
    write_manifest(out)
    for name in ("libpleno", "raytrix"):
        with pytest.raises(ExportError, match="no air before it"):
            export(open_output(out), [name], tmp_path)
