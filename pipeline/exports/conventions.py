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
        Place in the consumer's code or documentation that says so.
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
        source="opencv/opencv: issues 10130, 24633; modules/calib/include/opencv2/calib.hpp",
    ),
    "opencv-multiview": Convention(
        consumer="calibrateMultiview of OpenCV 5",
        origin=Origin.ZERO,
        pose=Pose.CAMERA_FROM_FIRST,
        centre=Centre.ROWS,
        rotation=Rotation.VECTOR,
        unit=Unit.M,
        source="opencv/opencv: modules/calib/src/multiview_calibration.cpp",
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
        source="dkogan/mrcal: doc/conventions.org, mrcal/calibration.py, mrcal/cameramodel.py",
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
        source="ethz-asl/kalibr: kalibr_common/ConfigReader.py, GridCalibrationTargetCheckerboard.cpp",
    ),
    "colmap": Convention(
        consumer="COLMAP",
        note="the world is the target",
        origin=Origin.HALF,
        pose=Pose.CAMERA_FROM_TARGET,
        centre=Centre.ROWS,
        rotation=Rotation.QUATERNION,
        unit=Unit.M,
        source="colmap/colmap: doc/format.rst, doc/cameras.rst",
    ),
    "lensboy": Convention(
        consumer="lensboy: OpenCV.load",
        note="corners are arrays in its interface, as those of opencv",
        origin=Origin.ZERO,
        board=Board.NONE,
        unit=Unit.NONE,
        source="lensboy 4.0.3: camera_models/opencv.py, to_json and from_json",
    ),
    "vision-calibration": Convention(
        consumer="vision-calibration (calibration-rs): run_planar_intrinsics, run_scheimpflug_intrinsics",
        note="Observation.from_payload takes each entry obs of views",
        origin=Origin.ZERO,
        unit=Unit.M,
        source="vision-calibration 0.9.0: models.py, PlanarDataset.to_payload",
    ),
    "libpleno": Convention(
        consumer="libpleno, COMPOTE, BLADE",
        origin=Origin.ZERO,
        pose=Pose.TARGET_FROM_CAMERA,
        centre=Centre.PRINCIPAL_POINT,
        rotation=Rotation.COLUMNS,
        unit=Unit.MM,
        microlenses=Microlenses.MICRO_IMAGE_GRID,
        source="comsee-research/libpleno: pleno/geometry/{observation,mesh,mia,pose}.cpp, geometry/camera/camera.cpp",
    ),
    "raytrix": Convention(
        consumer="PlenopticToolbox 2.0, TLCT: calibration as RxLive writes it",
        origin=Origin.IMAGE_CENTRE,
        axes=ImageAxes.X_UP,
        board=Board.NONE,
        unit=Unit.NONE,
        microlenses=Microlenses.FROM_CENTRAL,
        source="freerafiki/PlenopticToolbox2.0: python/plenopticIO/{imgIO,lens_grid}.py",
    ),
    "pip": Convention(
        consumer="PlenopticImageProcessing",
        origin=Origin.ZERO,
        board=Board.NONE,
        unit=Unit.MM,
        source="Arne-Petersen/PlenopticImageProcessing: PIPBase/PlenopticTypes.hh, SampleData/MLAconfig.xml",
    ),
    "bok": Convention(
        consumer="MATLAB code of Bok 2017 and Nousias 2017",
        origin=Origin.ONE,
        board=Board.NONE,
        unit=Unit.MM,
        microlenses=Microlenses.TYPES_FROM_ONE,
        source="sotnousias/plenoptic-camera-calibration: src/, thirdParty/Geometric_Calibration_Lightfield/",
    ),
    "lftoolbox": Convention(
        consumer="LFToolbox (MATLAB)",
        note="the grid of micro-images that a white image would give",
        origin=Origin.ONE,
        board=Board.NONE,
        unit=Unit.NONE,
        microlenses=Microlenses.MICRO_IMAGE_GRID,
        source="doda42/LFToolbox 3bf4f55: SupportFunctions/LFBuildLensletGridModel.m, LFBuildHexGrid",
    ),
    "plenopticam": Convention(
        consumer="plenopticam",
        note="to stand beside the white image of the same name",
        origin=Origin.ZERO,
        axes=ImageAxes.Y_X,
        board=Board.NONE,
        unit=Unit.NONE,
        microlenses=Microlenses.MICRO_IMAGE_GRID,
        source="hahnec/plenopticam: plenopticam/lfp_calibrator/, cfg/constants.py",
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
        source="Foundry: Nuke, STMap; the identity is ((x + 0.5) / width, (y + 0.5) / height) from the bottom left",
    ),
    "omni-lut": Convention(
        consumer="Omniverse RTX, Isaac Sim: OmniLensDistortionLutAPI",
        origin=Origin.SHARE,
        board=Board.NONE,
        unit=Unit.NONE,
        rays=Rays.USD,
        source="NVIDIA: omni.usd.schema.omni_lens_distortion, lens calibration of ovrtx; DS-MSP: isaac_sim/lut.py",
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
