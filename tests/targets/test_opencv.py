"""Claim: OpenCV's detectors find in our drawings the points that we say are there, by the same ids and in order."""

import cv2
import numpy as np
import pytest
from tolerances import DETECTED_PX

from pipeline.targets.drawing import Drawing
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.patterns.circles import CircleGrid
from pipeline.targets.patterns.tags import DICTIONARIES, AprilGrid, Charuco, bits_of, size_of, tag_shapes

SCALE, SCALE_OF_TAGS = 6.0, 10.0
"""Pixels per mm; OpenCV refines the corners of a tag in a window that must not hold a second one."""


def scanned(drawing: Drawing, px_per_mm: float, turn_deg: float = 0.0) -> np.ndarray:
    """The sheet as 8-bit grey, each pixel the mean of 16 points; the sheet's centre is the centre of the image."""
    angle = np.radians(turn_deg)
    half = np.array([drawing.half_x_mm, drawing.half_y_mm])
    reach = np.abs([[np.cos(angle), np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ half
    width, height = (np.ceil(2 * reach * px_per_mm)).astype(int)
    steps = (np.arange(4) + 0.5) / 4 - 0.5
    x = ((np.arange(width)[:, None] + steps).ravel() - (width - 1) / 2) / px_per_mm
    y = -((np.arange(height)[:, None] + steps).ravel() - (height - 1) / 2) / px_per_mm
    grid_x, grid_y = np.meshgrid(x, y)
    c, s = np.cos(angle), np.sin(angle)
    value = drawing.whiteness((c * grid_x + s * grid_y).ravel(), (c * grid_y - s * grid_x).ravel())
    value = np.nan_to_num(value, nan=1.0).reshape(height, 4, width, 4).mean(axis=(1, 3))
    return np.rint(255 * value).astype(np.uint8)


def on_scan(drawing: Drawing, xy_mm: np.ndarray, px_per_mm: float) -> np.ndarray:
    """Where points of the chart lie in `scanned` without a turn, (n, 2); (0, 0) is the centre of the first pixel."""
    width, height = np.ceil(2 * px_per_mm * np.array([drawing.half_x_mm, drawing.half_y_mm]))
    return np.array([(width - 1) / 2, (height - 1) / 2]) + px_per_mm * np.asarray(xy_mm) * [1, -1]


def dictionary_of(name: str):
    (number,) = [getattr(cv2.aruco, known) for known in sorted(dir(cv2.aruco)) if known.lower() == "dict_" + name][:1]
    return cv2.aruco.getPredefinedDictionary(number)


def test_a_checkerboards_corners_are_opencvs():
    """findChessboardCornersSB tells the ends of the board apart, and counts from the other one."""
    board = Checkerboard(columns=7, rows=4, square_mm=5.0)
    found, corners = cv2.findChessboardCornersSB(scanned(board.drawing, SCALE), (7, 4), flags=cv2.CALIB_CB_ACCURACY)
    assert found
    assert np.abs(corners.reshape(-1, 2)[::-1] - on_scan(board.drawing, board.marks().xy_mm, SCALE)).max() < DETECTED_PX


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize(
    ("columns", "rows"), [*(pytest.param(*odd, marks=pytest.mark.heavy) for odd in ((5, 4), (4, 4), (5, 3))), (6, 3)]
)
def test_a_charuco_boards_corners_are_opencvs(columns, rows, legacy):
    """Also as before 4.6, which differs where rows of squares are even: OpenCV with the other flag finds nothing."""
    size = {"columns": columns, "rows": rows, "square_mm": 8.0, "marker_mm": 6.0}
    board = Charuco(**size, dictionary="5x5_100", first_tag=3, legacy_pattern=legacy)
    ids = np.arange(3, 3 + board.tags)
    theirs = cv2.aruco.CharucoBoard((columns + 1, rows + 1), 8.0, 6.0, dictionary_of("5x5_100"), ids)
    image = scanned(board.drawing, SCALE)
    theirs.setLegacyPattern(legacy != (rows % 2 == 1))
    assert (cv2.aruco.CharucoDetector(theirs).detectBoard(image)[1] is None) == (rows % 2 == 1)
    theirs.setLegacyPattern(legacy)
    corners, numbers, _, tag_numbers = cv2.aruco.CharucoDetector(theirs).detectBoard(image)
    assert sorted(numbers.ravel()) == list(range(columns * rows))
    assert sorted(tag_numbers.ravel()) == list(ids)
    expected = on_scan(board.drawing, board.marks().xy_mm, SCALE)
    assert np.abs(corners.reshape(-1, 2) - expected[numbers.ravel()]).max() < DETECTED_PX
    # OpenCV's own coordinates of the same ids: x right, y down, from the corner of the squares.
    objects, _ = theirs.matchImagePoints(corners, numbers)
    ours = board.marks().xy_mm[numbers.ravel()] * [1, -1] + np.array([columns + 1, rows + 1]) * 4.0
    assert objects.reshape(-1, 3)[:, :2] == pytest.approx(ours, abs=1e-5)


def test_the_corners_of_a_charuco_boards_tags_are_opencvs():
    board = Charuco(columns=3, rows=2, square_mm=8.0, marker_mm=6.0, dictionary="4x4_50", marker_corners=True)
    corners, numbers = tags_in(scanned(board.drawing, SCALE_OF_TAGS), "4x4_50")
    expected = on_scan(board.drawing, board.marks().xy_mm[6:], SCALE_OF_TAGS).reshape(-1, 4, 2)
    assert sorted(numbers) == list(range(6))
    assert np.abs(corners - expected[numbers]).max() < DETECTED_PX
    theirs = cv2.aruco.CharucoBoard((4, 3), 8.0, 6.0, dictionary_of("4x4_50")).getObjPoints()
    ours = board.marks().xy_mm[6:].reshape(-1, 4, 2) * [1, -1] + [16.0, 12.0]
    assert np.array(theirs)[..., :2] == pytest.approx(ours, abs=1e-5)


def tags_in(image: np.ndarray, dictionary: str, border: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 4, 2), from OpenCV's top left clockwise, and numbers (n,) of all tags."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border
    found, numbers, _ = cv2.aruco.ArucoDetector(dictionary_of(dictionary), parameters).detectMarkers(image)
    # The detector's own refinement stops early.
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-4)
    corners = cv2.cornerSubPix(image, np.array(found, np.float32).reshape(-1, 1, 2), (5, 5), (-1, -1), criteria)
    return corners.reshape(-1, 4, 2), numbers.ravel()


@pytest.mark.parametrize("border", [pytest.param(1, marks=pytest.mark.heavy), 2])
def test_an_aprilgrids_corners_are_kalibrs(border):
    """Tag t has Kalibr's corners 2 t + 2 columns (t // columns) (and + 1, + 2 columns, + 2 columns + 1); OpenCV sees
    the tags upside down: its first corner is our lower right one."""
    board = AprilGrid(columns=2, rows=2, tag_mm=12.0, border_bits=border, first_tag=7)
    corners, numbers = tags_in(scanned(board.drawing, SCALE_OF_TAGS), "apriltag_36h11", border)
    assert sorted(numbers) == list(range(7, 11))
    expected = on_scan(board.drawing, board.marks().xy_mm, SCALE_OF_TAGS)
    for four, number in zip(corners, numbers - 7, strict=True):
        base = 4 * 2 * (number // 2) + 2 * (number % 2)
        lower_right, lower_left, upper_left, upper_right = base + 1, base, base + 4, base + 5
        mine = expected[[lower_right, lower_left, upper_left, upper_right]]
        assert np.abs(four - mine).max() < DETECTED_PX


def test_tag_0_of_an_aprilgrid_is_the_published_code():
    """36h11 begins with d5d628584 (AprilTag, tag36h11.c): rows from the top, highest bit first, as Kalibr prints."""
    board = AprilGrid(columns=1, rows=1, tag_mm=10.0, border_bits=2)
    cells = (np.arange(6) + 2.5 - 5) * 1.0
    x, y = np.meshgrid(cells, cells[::-1])
    bits = board.drawing.whiteness(x.ravel(), y.ravel())
    assert int("".join(str(int(bit)) for bit in bits), 2) == 0xD5D628584


@pytest.mark.parametrize("name", DICTIONARIES)
def test_every_tag_looks_as_opencv_draws_it(name):
    count, edge = size_of(name)
    for number in {0, 1, count // 2, count - 1}:
        picture = cv2.aruco.generateImageMarker(dictionary_of(name), number, edge + 2) // 255
        drawing = Drawing(10.0, 10.0, tag_shapes(bits_of(name, number), -6.0, -6.0, 12.0, 1))
        cells = ((np.arange(edge + 2) + 0.5) / (edge + 2) - 0.5) * 12.0
        x, y = np.meshgrid(cells, cells[::-1])
        assert np.array_equal(drawing.whiteness(x.ravel(), y.ravel()).reshape(picture.shape), picture)


def test_a_symmetric_circle_grids_centres_are_opencvs():
    board = CircleGrid(columns=7, rows=5, spacing_mm=8.0, diameter_mm=4.0)
    found, centres = cv2.findCirclesGrid(scanned(board.drawing, 5.0), (7, 5), flags=cv2.CALIB_CB_SYMMETRIC_GRID)
    assert found
    expected = on_scan(board.drawing, board.marks().xy_mm, 5.0)
    # The grid looks the same upside down, and OpenCV may begin at either end.
    turned = expected if np.abs(centres.reshape(-1, 2)[0] - expected[0]).max() < 5 else expected[::-1]
    assert np.abs(centres.reshape(-1, 2) - turned).max() < DETECTED_PX


def test_an_asymmetric_circle_grids_centres_are_opencvs():
    board = CircleGrid(columns=4, rows=11, spacing_mm=6.0, diameter_mm=4.0, asymmetric=True)
    image = scanned(board.drawing, 5.0)
    found, centres = cv2.findCirclesGrid(image, (4, 11), flags=cv2.CALIB_CB_ASYMMETRIC_GRID)
    assert found
    expected = on_scan(board.drawing, board.marks().xy_mm, 5.0)
    assert np.abs(centres.reshape(-1, 2) - expected).max() < DETECTED_PX
    # Its object points as in OpenCV's calibration sample: ((2 j + i % 2) spacing, i spacing).
    ours = (board.marks().xy_mm - board.marks().xy_mm[0]) * [1, -1] / 6.0
    assert ours == pytest.approx(np.array([(2 * j + i % 2, i) for i in range(11) for j in range(4)]))
