"""The table of conventions: what the numbers of every format mean. `conversion` applies it, and nobody else does.

Ours are those of CONVENTIONS.md: the centre of the top-left pixel is (0, 0), x right, y down; mm; poses from the
target, whose frame has its origin in the middle, x right, y up, z towards the viewer.
"""

from dataclasses import dataclass
from enum import StrEnum


class Origin(StrEnum):
    """Number that a format has for the centre of the top-left pixel; the middle of an image lies between pixels."""

    ZERO = "0"
    HALF = "0.5"
    ONE = "1"
    IMAGE_CENTRE = "from the image centre"
    SHARE = "0.5 / size"
    """Shares of width and height, from a corner: half a pixel of them."""


class ImageAxes(StrEnum):
    """Order and direction of image coordinates."""

    X_Y = "x right, y down"
    Y_X = "y down, then x right"
    X_UP = "x right, y up"


class Rays(StrEnum):
    """Axes in which a format counts rays, and where they start."""

    VISION = "x right, y down, z forward, from the centre of the aperture stop"
    USD = "x right, y up, z backward, from the equivalent pinhole"
    NONE = "none"


class Board(StrEnum):
    """Frame in which a format counts target points."""

    RIGHT_DOWN = "from point 0, x right, y down, z away from the viewer"
    KALIBR = "from point 0, z towards the viewer; x down, y right, but x right, y up of AprilGrids"
    OURS = "from the middle of the pattern, x right, y up, z towards the viewer"
    NONE = "none, columns and rows alone"


class Pose(StrEnum):
    """Direction of a stored pose."""

    CAMERA_FROM_TARGET = "camera from target"
    TARGET_FROM_CAMERA = "target from camera"
    CAMERA_FROM_FIRST = "camera from first camera"
    CAMERA_FROM_PREVIOUS = "camera from previous camera"
    NONE = "none"


class Centre(StrEnum):
    """Point of the camera that a pose leads to."""

    PINHOLE = "equivalent pinhole"
    ROWS = "pinhole of the rows"
    """Of the exported rows, as export.json states it; the equivalent pinhole where these determine none."""
    PRINCIPAL_POINT = "front principal point"


class Rotation(StrEnum):
    """Form of a stored rotation."""

    VECTOR = "Rodrigues vector"
    MATRIX = "matrix, by rows"
    COLUMNS = "matrix, by columns"
    QUATERNION = "quaternion w, x, y, z"
    NONE = "none"


class Unit(StrEnum):
    """Unit of lengths in space."""

    MM = "mm"
    M = "m"
    NONE = "none"


class Microlenses(StrEnum):
    """Numbers of microlenses and of their types."""

    NONE = "none"
    AXIAL = "axial (k, l); type as in CONVENTIONS.md"
    FROM_CENTRAL = "type counted from that of the microlens nearest to the middle of the image"
    TYPES_FROM_ONE = "type 1, 2, 3 for 0, 1, 2 of ours"
    MICRO_IMAGE_GRID = "column, row of the micro-image from the top left; type ((row mod 2) + column) mod 3"


@dataclass(frozen=True, slots=True, kw_only=True)
class Convention:
    """Meaning of the numbers of a format.

    Attributes
    ----------
    consumer : str
        Who reads it.
    note : str
        Facts that a reader of its files has to know, beside their names.
    source : str
        How we know: programs that are run on files, in every test or in a proof, and what was only read.
    """

    consumer: str
    note: str = ""
    origin: Origin
    axes: ImageAxes = ImageAxes.X_Y
    board: Board = Board.RIGHT_DOWN
    pose: Pose = Pose.NONE
    centre: Centre = Centre.PINHOLE
    rotation: Rotation = Rotation.NONE
    unit: Unit
    microlenses: Microlenses = Microlenses.NONE
    rays: Rays = Rays.NONE
    source: str


CONVENTIONS = {
    "opencv": Convention(
        consumer="OpenCV 4 and 5",
        note="stereo- of pairs of cameras",
        origin=Origin.ZERO,
        pose=Pose.CAMERA_FROM_TARGET,
        centre=Centre.ROWS,
        rotation=Rotation.VECTOR,
        unit=Unit.MM,
        source="run: cv2 5.0.0. Read: opencv/opencv issues 10130, 24633 on the centres of pixels",
    ),
    "opencv-multiview": Convention(
        consumer="calibrateMultiview of OpenCV 5",
        origin=Origin.ZERO,
        pose=Pose.CAMERA_FROM_FIRST,
        centre=Centre.ROWS,
        rotation=Rotation.VECTOR,
        unit=Unit.M,
        source="run: cv2 5.0.0",
    ),
    "mrcal": Convention(
        consumer="mrcal",
        note="LENSMODEL_OPENCV5",
        origin=Origin.ZERO,
        board=Board.NONE,
        pose=Pose.CAMERA_FROM_FIRST,
        centre=Centre.ROWS,
        rotation=Rotation.VECTOR,
        unit=Unit.M,
        source="proof: mrcal 2.2 of Debian calibrates from the corners and reads the models",
    ),
    "kalibr": Convention(
        consumer="Kalibr",
        note="Kalibr itself does not read corners.csv",
        origin=Origin.ZERO,
        board=Board.KALIBR,
        pose=Pose.CAMERA_FROM_PREVIOUS,
        centre=Centre.ROWS,
        rotation=Rotation.MATRIX,
        unit=Unit.M,
        source="proof: ConfigReader.py of ethz-asl/kalibr 1f60227. Read: GridCalibrationTarget*.cpp there",
    ),
    "colmap": Convention(
        consumer="COLMAP",
        note="the world is the target",
        origin=Origin.HALF,
        pose=Pose.CAMERA_FROM_TARGET,
        centre=Centre.ROWS,
        rotation=Rotation.QUATERNION,
        unit=Unit.M,
        source="run: pycolmap 4.2.1",
    ),
    "lensboy": Convention(
        consumer="lensboy: OpenCV.load",
        note="corners are arrays in its interface, as those of opencv",
        origin=Origin.ZERO,
        board=Board.NONE,
        unit=Unit.NONE,
        source="proof: lensboy 4.0.3 loads the camera and projects",
    ),
    "vision-calibration": Convention(
        consumer="vision-calibration (calibration-rs): run_planar_intrinsics, run_scheimpflug_intrinsics",
        note="Observation.from_payload takes each entry obs of views",
        origin=Origin.ZERO,
        unit=Unit.M,
        source="run: vision-calibration 0.9.0",
    ),
    "libpleno": Convention(
        consumer="libpleno, COMPOTE, BLADE",
        origin=Origin.ZERO,
        pose=Pose.TARGET_FROM_CAMERA,
        centre=Centre.PRINCIPAL_POINT,
        rotation=Rotation.COLUMNS,
        unit=Unit.MM,
        microlenses=Microlenses.MICRO_IMAGE_GRID,
        source="proof: projections of comsee-research/libpleno 48db282. Read: camera.js, in its pleno/io/cfg/",
    ),
    "raytrix": Convention(
        consumer="PlenopticToolbox 2.0, TLCT: calibration as RxLive writes it",
        origin=Origin.IMAGE_CENTRE,
        axes=ImageAxes.X_UP,
        board=Board.NONE,
        unit=Unit.NONE,
        microlenses=Microlenses.FROM_CENTRAL,
        source="proof: load_from_xml of freerafiki/PlenopticToolbox2.0 79f2761. Read: SIGS-TZ/TLCT 9ef550c",
    ),
    "pip": Convention(
        consumer="PlenopticImageProcessing",
        origin=Origin.ZERO,
        board=Board.NONE,
        unit=Unit.MM,
        source="read: Arne-Petersen/PlenopticImageProcessing f72013a, PlenopticTypes.hh, PlenopticTools.cpp",
    ),
    "bok": Convention(
        consumer="MATLAB code of Bok 2017 and Nousias 2017",
        origin=Origin.ONE,
        board=Board.NONE,
        unit=Unit.MM,
        microlenses=Microlenses.TYPES_FROM_ONE,
        source="proof: GNU Octave 7.3 loads the files. Read: sotnousias/plenoptic-camera-calibration d41208d",
    ),
    "lftoolbox": Convention(
        consumer="LFToolbox (MATLAB)",
        note="the grid of micro-images that a white image would give",
        origin=Origin.ONE,
        board=Board.NONE,
        unit=Unit.NONE,
        microlenses=Microlenses.MICRO_IMAGE_GRID,
        source="proof: LFBuildHexGrid of doda42/LFToolbox 3bf4f55, LFBuildLensletGridModel.m, in GNU Octave 7.3",
    ),
    "plenopticam": Convention(
        consumer="plenopticam",
        note="to stand beside the white image of the same name",
        origin=Origin.ZERO,
        axes=ImageAxes.Y_X,
        board=Board.NONE,
        unit=Unit.NONE,
        microlenses=Microlenses.MICRO_IMAGE_GRID,
        source="read: hahnec/plenopticam 24bb523, cfg/cfg.py, lfp_aligner/lfp_local_resampler.py",
    ),
    "parquet": Convention(
        consumer="pandas, Polars, R and all else that reads Parquet",
        origin=Origin.ZERO,
        board=Board.OURS,
        pose=Pose.CAMERA_FROM_TARGET,
        rotation=Rotation.VECTOR,
        unit=Unit.MM,
        microlenses=Microlenses.AXIAL,
        source="CONVENTIONS.md: nothing is converted",
    ),
    "npz": Convention(
        consumer="NumPy",
        note="an array per column",
        origin=Origin.ZERO,
        board=Board.OURS,
        pose=Pose.CAMERA_FROM_TARGET,
        rotation=Rotation.VECTOR,
        unit=Unit.MM,
        microlenses=Microlenses.AXIAL,
        source="CONVENTIONS.md: nothing is converted",
    ),
    "rays": Convention(
        consumer="ray tracers and robotics simulators; NumPy, OpenEXR",
        note="origin and direction of the ray of each pixel, the top row first",
        origin=Origin.ZERO,
        board=Board.NONE,
        unit=Unit.MM,
        microlenses=Microlenses.AXIAL,
        rays=Rays.VISION,
        source="CONVENTIONS.md, The ray of a position",
    ),
    "stmap": Convention(
        consumer="Nuke and other compositors: STMap",
        note="s and t of each pixel in R and G, the top row first",
        origin=Origin.SHARE,
        axes=ImageAxes.X_UP,
        board=Board.NONE,
        unit=Unit.NONE,
        source="proof: st_warp of OpenImageIO 3.2 with flip_t. Read: documentation of Foundry Nuke, STMap",
    ),
    "omni-lut": Convention(
        consumer="Omniverse RTX, Isaac Sim: OmniLensDistortionLutAPI",
        origin=Origin.SHARE,
        board=Board.NONE,
        unit=Unit.NONE,
        rays=Rays.USD,
        source="read: documentation of NVIDIA, omni.usd.schema.omni_lens_distortion; DS-MSP, isaac_sim/lut.py",
    ),
    "depth": Convention(
        consumer="robotics, compositors; OpenEXR",
        note="channel Z, how far the first surface is that the ray of a pixel meets",
        origin=Origin.ZERO,
        board=Board.NONE,
        unit=Unit.MM,
        rays=Rays.VISION,
        source="CONVENTIONS.md, The ray of a position",
    ),
    "lightfield": Convention(
        consumer="light-field code in Python; NumPy",
        note="views (v, u, row, column), the top row first",
        origin=Origin.ZERO,
        board=Board.NONE,
        unit=Unit.NONE,
        microlenses=Microlenses.MICRO_IMAGE_GRID,
        source="CONVENTIONS.md; columns and rows as in libpleno, pleno/geometry/mesh.cpp",
    ),
}
"""Format -> convention, in the order of `pipeline export --list`."""
OMNIVERSE = Convention(
    consumer="Omniverse RTX, Isaac Sim, Newton: schemas OmniLensDistortion…API",
    origin=Origin.HALF,
    board=Board.NONE,
    unit=Unit.NONE,
    source="NVIDIA: omni.usd.schema.omni_lens_distortion; newton-physics/newton: usd camera rays and their tests",
)
"""Meaning of pixels in attributes of Omniverse: `pipeline fit` writes them."""
