"""One or two of every pattern of targets."""

from pipeline.targets.patterns.checkerboard import Checkerboard, Deltille
from pipeline.targets.patterns.circles import CircleGrid
from pipeline.targets.patterns.lines import Lines, SlantedEdge
from pipeline.targets.patterns.stars import SiemensStar, Stars
from pipeline.targets.patterns.tags import AprilGrid, Charuco

EXAMPLES = [
    Checkerboard(columns=4, rows=3, square_mm=3.7),
    Charuco(columns=4, rows=3, square_mm=5.0, marker_mm=3.5, marker_corners=True),
    AprilGrid(columns=3, rows=2, tag_mm=8.0),
    AprilGrid(columns=2, rows=2, tag_mm=8.0, dictionary="apriltag_16h5", border_bits=1),
    CircleGrid(columns=4, rows=3, spacing_mm=5.0, diameter_mm=3.0),
    CircleGrid(columns=4, rows=5, spacing_mm=5.0, diameter_mm=3.0, asymmetric=True),
    Deltille(columns=4, rows=3, edge_mm=4.0),
    Stars(columns=3, rows=2, spacing_mm=9.0, diameter_mm=8.0, spokes=7),
    SiemensStar(spokes=36, diameter_mm=30.0),
    SiemensStar(spokes=24, diameter_mm=30.0, hub_mm=5.0),
    SlantedEdge(width_mm=20.0, height_mm=30.0, angle_deg=-7.0),
    Lines(columns=3, rows=2, spacing_mm=6.0, width_mm=0.5),
    Lines(columns=0, rows=4, spacing_mm=6.0, width_mm=0.5),
    Lines(columns=3, rows=0, spacing_mm=6.0, width_mm=0.5),
]


def name_of(pattern) -> str:
    return pattern.KIND
