"""Which kinds of tasks depend on which attribute of the schemas, in words of the user's manual."""

from dataclasses import KW_ONLY, dataclass, field
from typing import Any

from pxr import Gf
from stage_text import plen

RAYS = {"rays_tile", "rays"}
IMAGES = {"image", "white"}
LABELS = {"labels"}
STRIPS = {"image_strip", "white_strip"} | IMAGES
IN_PASSES = {"image_first", "white_first"} | STRIPS
POSES = {"frame_poses", "baselines"}
"""Where cameras and targets stand; to the pinhole, which is fitted between the near and the far plane."""
PINHOLE = {"pinhole"} | POSES
PLANES = {"camera", "first_order"} | PINHOLE
FURTHER = {"camera", "white", "micro_images"}
TRUTH = {"truth", "certificate"}
SEEN = {"camera", "parts", "first_order"} | PINHOLE | TRUTH | {"image"}
"""What sees a window that stands in the world."""
CAMERA = {"camera", "parts", "first_order", "micro_images"} | PINHOLE | IMAGES | TRUTH
POSITIONS = {"positions"} | TRUTH
PATTERN = {"expose", "fixed_pattern"}
LOST = {"expose", "transmission"}
"""What a lens takes of the light of raw images."""
RAW = {"expose"}
"""Raw images: what the sensor makes of images that are there. They are made anew where images are."""
TARGET = {"image"} | TRUTH
"""`truth` gets the drawing of a target, so the bits of its tags make it run again, too: work that gives the same
correspondences, not a wrong result."""
DRAWN, PAINTED = TARGET | {"sheet"}, {"image", "sheet"}
"""`sheet` is the picture of a pattern, for viewers; a mesh has none."""


@dataclass(frozen=True)
class Case:
    """A change of one attribute of one prim, and the kinds of tasks that depend on it.

    What it needs to mean something is `given` before and after; what the checks ask for is changed `along`. A `refused`
    one is declared and not built yet.
    """

    at: str
    value: Any
    kinds: set[str] = field(default_factory=set)
    _: KW_ONLY
    given: dict[tuple[str, str], Any] = field(default_factory=dict)
    along: dict[tuple[str, str], Any] = field(default_factory=dict)
    refused: bool = False


A, B, LENS, STOP, GLASS, GROUP = "A/Camera", "B/Camera", "A/Lens", "A/Lens/Stop", "A/Lens/S1", "A/Lens/Rear"
SENSOR, ARRAY = "A/Sensor", "B/Microlenses"
CHARUCO, TAGS, CIRCLES, TRIANGLES = "More/Charuco", "More/Tags", "More/Circles", "More/Triangles"
STARS, SIEMENS, EDGE, LINES, MESH = "More/Stars", "More/Siemens", "More/Edge", "More/Lines", "More/Marked"

PORT, OUTER = "A/Camera/Port", "A/Camera/Port/Outer"
PORTED = plen(A, camera__windows=[PORT])
UNEVEN = PORTED | plen(OUTER, heights=[0.0] * 63 + [0.01], heightColumns=8, heightSpacing=60.0)
NO_GLASS = plen(OUTER, glass=None)
POLYGON = plen(STOP, apertureShape="polygonal", blades=6)
FOCUSED = plen(B, camera__focusDistance=420.0, camera__sensorDistance=None)
CATALOGUE = plen(LENS, indexSource="catalogue")
SWAPPED = ["S3", "S2", "S1", "S4", "S5", "Stop", "S7", "S8", "S9", "S10", "S11"]
PINHOLE_MODEL = plen(A, camera__model="pinhole")
TWO_PLANE = plen(A, truth__method="two-plane")
NEAREST = TWO_PLANE | plen(A, truth__search="nearest")
DELIVERED = plen(A, truth__rays=True)
SADDLE = plen(A, truth__columns=["saddle"])
AUTHORED = plen(A, camera__near=400.0, camera__far=500.0)
# The method image takes no mesh.
BOARDS = plen("", targets=["One", "Two"])
IMAGE = BOARDS | plen(A, truth__method="image")
TIMED = {"first_order", "frame_poses"} | TRUTH
MOVED = {"image"} | TIMED
FLIES = BOARDS | {("One", "xformOp:translate"): {number: (0.2 * number, 0.0, -434.4) for number in range(4)}}
SCANNED = FLIES | plen(A, shutter__scanOrder="topToBottom", shutter__lineOffset=(1.0, 2000.0))


COLOUR = plen("", cameras=["A/Camera", "C/Camera"])
EXPORTED = plen("", exports=["npz"])
RAYS_EXPORTED = plen("", exports=["rays"])
ONE_CAMERA = plen("", cameras=["A/Camera"])
IN_COLOUR = {"first_order", "camera", "colour_image"} | IMAGES | TRUTH
RED = "C/Sensor/Red"
NAMED = COLOUR | plen(RED, wavelengths=[], response=[], sensitivity="Nikon 5100 (NPL)", component="green")


def _each(
    at: str, kinds: set[str], given: dict[tuple[str, str], Any] | None = None, **values: Any
) -> dict[str, list[Case]]:
    """Attributes of one prim, by their names without the namespace, on which the same kinds of tasks depend."""
    return {name: [Case(at, value, kinds, given=given or {})] for (_, name), value in plen(at, **values).items()}


COUNTED = plen(ARRAY, width=None, height=None, columns=100, rows=115)
TABLED = plen(ARRAY, typeTable=[0, 1, 2], typePeriod=Gf.Vec2i(3, 1))
PLATES = plen(ARRAY, model="two-plane", index=1.5, thickness=0.1)
FACES = plen(ARRAY, model="refractive", index=1.5, thickness=0.1, frontRadii=[1.0, 1.1, 1.2], rearRadii=[-9.0] * 3)
DISCS = plen(ARRAY, aperture="disc", discDiameter=0.2)
COSINE = plen(SENSOR, acceptance="cosine", acceptancePower=2.0)
CONE = plen(SENSOR, acceptance="cone", acceptanceHalfAngle=20.0)
LIT: dict[tuple[str, str], Any] = {("Sun", "visibility"): "inherited"}
DECENTRED = plen(GROUP, decentre=(0.1, 0.0))
TILTED = plen(GROUP, tilt=(0.1, 0.0))
WARPED = plen("One", shape="warped", shape__deflection=(0.1, 0.2))
MEASURED = plen(
    "One", shape="heightMap", shape__resolution=Gf.Vec2i(2, 3), shape__heights=[0.0, 0.1, 0.0, 0.2, 0.0, 0.1]
)
ROLLED = plen("One", shape="cylinder", shape__radius=20.0)
CUBE = plen("One", shape="cube", shape__edge=10.0)
STAIRS = plen("One", shape="stairs", shape__steps=2, shape__depth=1.0)

ALONE = CAMERA - {"micro_images", "baselines"}
WET = ONE_CAMERA | plen("", medium="water") | AUTHORED
WET |= plen(B, camera__near=400.0, camera__far=500.0) | plen("C/Camera", camera__near=400.0, camera__far=500.0)

DATASET = {
    # J and position images do not depend on what stands between camera and target.
    "plen:occluders": [Case("", [], TARGET), Case("", [], TARGET, given=IMAGE)],
    # Certificate and poses of a camera are one task for all frames.
    "plen:frames": [Case("", [2], {"certificate"} | POSES)],
    "plen:seed": [
        Case("", 9, IMAGES | TRUTH),
        Case("", 9, RAYS | IMAGES | TRUTH, given=TWO_PLANE),
        Case("", 9, RAYS | IMAGES | TRUTH, given=DELIVERED),
        Case("", 9, RAYS | IMAGES | POSITIONS, given=IMAGE),
    ],
    "plen:medium:temperature": [Case("", 15.0, CAMERA), Case("", 15.0, ALONE, given=WET)],
    "plen:medium:salinity": [Case("", 35.0), Case("", 35.0, ALONE, given=WET)],
    # Points that have such a position; rays have no points.
    "plen:exports:position": [
        Case("", "chief", {"export"}, given=EXPORTED | plen(A, truth__columns=["chief"]) | ONE_CAMERA)
    ],
    "plen:exports:noise": [Case("", 0.1, {"export"}, given=EXPORTED), Case("", 0.1, given=RAYS_EXPORTED)],
    "plen:illuminant": [Case("", "A"), Case("", "A", IN_COLOUR, given=COLOUR)],
    "plen:cameras": [Case("", ["A/Camera"])],
    "plen:targets": [Case("", ["One"], TARGET | {"frame_poses"})],
    "plen:background": [Case("", 0.5, {"image"})],
    **_each("", CAMERA, medium="vacuum", medium__pressure=90.0),
    **_each("", {"export"}, EXPORTED, exports=["npz", "rays"], exports__outliers=0.1, exports__missed=0.1),
    "plen:exports:outlierReach": [Case("", 9.0, {"export"}, given=EXPORTED | plen("", exports__outliers=0.1))],
    "plen:exports:noiseSeed": [Case("", 2, {"export"}, given=EXPORTED | plen("", exports__noise=0.1))],
}

MAIN_LENS = {
    "plen:surfaceOrder": [Case(LENS, SWAPPED, CAMERA), Case(PORT, ["Inner", "Outer"], CAMERA, given=PORTED | AUTHORED)],
    # Printed indices stay what they are: only what says the wavelength has to be written again.
    "plen:wavelength": [
        Case(PORT, 546.1, CAMERA, given=PORTED | {(OUTER, "plen:index"): 1.52, (OUTER, "plen:abbe"): 60.0} | NO_GLASS),
        Case(LENS, 587.6, {"first_order"} | IMAGES | TRUTH, along=plen(A, camera__wavelength=587.6)),
        Case(
            LENS,
            587.6,
            {"first_order", "rays"} | IMAGES | TRUTH,
            given=TWO_PLANE,
            along=plen(A, camera__wavelength=587.6),
        ),
    ],
    "plen:radius": [Case(GLASS, 60.0, CAMERA), Case(GLASS, 60.0, CAMERA | RAYS, given=TWO_PLANE)],
    "plen:apertureShape": [Case(STOP, "polygonal", CAMERA, along=plen(STOP, blades=6))],
    "plen:innerSemiDiameter": [Case(STOP, 1.0, CAMERA, along=plen(STOP, apertureShape="annular"))],
    "plen:halfWidths": [Case(STOP, (3.0, 3.0), CAMERA, along=plen(STOP, apertureShape="rectangular"))],
    "plen:isStop": [Case(STOP, False, CAMERA, along=plen("A/Lens/S5", isStop=True))],
    "plen:abbe": [Case(GLASS, 47.11), Case(GLASS, 47.11, given=CATALOGUE)],
    "plen:decentre": [Case(GLASS, (0.1, 0.0), CAMERA), Case(GROUP, (0.1, 0.0), CAMERA)],
    "plen:name": [Case(LENS, "mine", {"first_order"})],
    "plen:nominalFocalLength": [Case(LENS, 101.0)],
    "plen:indexSource": [Case(LENS, "catalogue", CAMERA)],
    "plen:cylindrical": [Case(OUTER, True, CAMERA, given=PORTED | plen(OUTER, radius=500.0))],
    **_each(OUTER, CAMERA, UNEVEN, heights=[0.01] + [0.0] * 63, heightColumns=4, heightSpacing=61.0),
    **_each(GLASS, CAMERA, conic=-0.1, evenCoefficients=[1e-9], oddCoefficients=[1e-9]),
    **_each(STOP, CAMERA, focalLength=5000.0, semiDiameter=4.0),
    **_each(STOP, CAMERA, POLYGON, blades=7, apertureRotation=10.0),
    "plen:surfaces": [Case(GROUP, ["S9", "S10", "S11"], CAMERA, given=DECENTRED)],
    "plen:pivot": [Case(GROUP, 1.0, CAMERA, given=TILTED)],
}

PARTS = {
    # Attributes that several parts of a camera have.
    "plen:thickness": [
        Case(GLASS, 8.9, CAMERA),
        Case(ARRAY, 0.11, CAMERA, given=PLATES),
        Case(ARRAY, 0.11, CAMERA, given=FACES),
    ],
    "plen:index": [
        Case(GLASS, 1.6701, CAMERA),
        Case(GLASS, 1.6701, given=CATALOGUE),
        Case(ARRAY, 1.51, CAMERA, given=PLATES),
        Case(ARRAY, 1.51, CAMERA, given=FACES),
    ],
    "plen:glass": [
        Case(GLASS, "SCHOTT N-BK7"),
        Case(GLASS, "constant(1.6701)", CAMERA, given=CATALOGUE, along=plen(GLASS, abbe=None)),
        Case(ARRAY, "schott:N-BK7", CAMERA, given=FACES, along=plen(ARRAY, index=None)),
        Case("Clear", "constant(1.6)"),
        Case("Clear", "constant(1.6)", {"image"}, given=LIT),
    ],
    "plen:offset": [Case(ARRAY, (0.01, 0.0), CAMERA), Case(SENSOR, (0.01, 0.0), CAMERA)],
    "plen:tilt": [
        Case(GLASS, (0.1, 0.0), CAMERA),
        Case(GROUP, (0.1, 0.0), CAMERA),
        Case(ARRAY, (0.1, 0.0), CAMERA),
        Case(SENSOR, (1.0, 0.0), CAMERA),
    ],
}

MICROLENSES = {
    "plen:layout": [Case(ARRAY, "square", CAMERA, given=TABLED), Case(ARRAY, "hexagonal-columns", CAMERA)],
    # Refractive microlenses: the focal lengths are only compared with those of the faces.
    "plen:focalLengths": [
        Case(ARRAY, [1.9, 2.0, 2.4], CAMERA),
        Case(ARRAY, [1.9, 2.0, 2.4], given=FACES),
    ],
    "plen:model": [Case(ARRAY, "two-plane", CAMERA, along=PLATES), Case(ARRAY, "refractive", CAMERA, along=FACES)],
    "plen:aperture": [Case(ARRAY, "disc", CAMERA, along=DISCS)],
    **_each(ARRAY, CAMERA, pitch=0.2, crossPitch=0.22, rotation=1.0),
    **_each(ARRAY, CAMERA, TABLED, typeTable=[0, 2, 1], typePeriod=Gf.Vec2i(1, 3)),
    **_each(
        ARRAY,
        CAMERA,
        FACES,
        frontRadii=[1.0, 1.1, 1.3],
        rearRadii=[-9.0, -9.0, -10.0],
        frontConics=[-0.1] * 3,
        rearConics=[-0.1] * 3,
    ),
    "plen:discDiameter": [Case(ARRAY, 0.19, CAMERA, given=DISCS)],
}

PIXELS = {
    "plen:acceptance": [Case(SENSOR, "cosine", CAMERA, along=COSINE)],
    **_each(SENSOR, CAMERA, resolution=Gf.Vec2i(30, 24), pixelPitch=0.09),
    "plen:acceptancePower": [Case(SENSOR, 3.0, CAMERA, given=COSINE)],
    **_each(SENSOR, CAMERA, CONE, acceptanceHalfAngle=21.0, acceptanceRollOff=1.0),
}

CHANNELS = {
    **_each(RED, IN_COLOUR, COLOUR, wavelengths=[570.0, 620.0, 690.0], response=[0.1, 0.5, 0.3], nodes=3),
    **_each(RED, IN_COLOUR, NAMED, sensitivity="Sigma SDMerill (NPL)", component="blue"),
}

LEVEL = plen(A, image__exposure="level", image__whiteLevel=0.8, image__exposureTime=0.01)
LEVEL |= plen(SENSOR, response__fullWell=9e3, response__gain=0.4, response__bitDepth=12)
PHOTONS = LEVEL | plen(A, image__exposure="photons", image__whiteLevel=None, image__photonRate=1e6)
RADIANCE = LEVEL | plen(A, image__exposure="radiance", image__whiteLevel=None, image__radiance=2.0)
LOSSY = RADIANCE | plen(LENS, transmission="surfaces")
COATED = LOSSY | plen(GLASS, coatingWavelengths=[500.0, 600.0], coatingReflectance=[0.01, 0.02])
BY_ANGLE = COATED | plen(GLASS, coatingAngles=[0.0, 30.0], coatingReflectance=[0.01, 0.02, 0.03, 0.04])
FILMS = LOSSY | plen(GLASS, coatingFilmIndices=[1.38, 2.1], coatingFilmThicknesses=[99.0, 130.0])
ABSORBING = LOSSY | plen(GLASS, internalTransmittanceWavelengths=[500.0, 600.0], internalTransmittanceTable=[0.9, 0.97])
KNOWN = plen("A/Lens/S8", internalTransmittance=0.99)
"""The one glass of the lens whose absorption the catalogue does not have."""
HOT = LEVEL | plen(SENSOR, response__hotShare=0.01, response__hotCurrent=900.0)
WARM = LEVEL | plen(SENSOR, response__darkCurrent=10.0, response__temperature=30.0)
WARM |= plen(SENSOR, response__darkCurrentTemperature=20.0, response__doublingTemperature=7.0)


RAW_IMAGES = {
    "plen:image:exposure": [
        Case(
            A,
            "photons",
            RAW,
            given=LEVEL,
            along={k: PHOTONS[k] for k in PHOTONS if "photon" in k[1] or "white" in k[1]},
        ),
        Case(A, "level", PATTERN, along=LEVEL),
    ],
    "plen:image:exposureTime": [Case(A, 0.02, RAW, given=LEVEL), Case(A, 0.02, RAW, given=PHOTONS)],
    "plen:transmittanceSource": [
        Case(LENS, "catalogue", LOST, given=LOSSY | KNOWN),
        Case(PORT, "catalogue", LOST, given=LOSSY | PORTED),
    ],
    "plen:internalTransmittanceThickness": [
        Case(GLASS, 25.0, LOST, given=LOSSY | plen(GLASS, internalTransmittance=0.99)),
        Case("Clear", 20.0, {"image"}, given=LIT),
    ],
    "plen:response:filters": [Case(SENSOR, ["red", "green", "green", "blue"], given=LEVEL, refused=True)],
    # A parameter of the sensor: raw images alone are made anew, and what is fixed in them.
    **_each(SENSOR, RAW, LEVEL, response__quantumEfficiency=[0.6], response__fullWell=9500.0, response__gain=0.41),
    **_each(SENSOR, RAW, LEVEL, response__bitDepth=11, response__blackLevel=10.0, response__shotNoise=False),
    **_each(SENSOR, RAW, LEVEL, **{f"response__{name}": 1.0 for name in ("darkNoise", "rowNoise", "columnNoise")}),
    **_each(SENSOR, RAW, LEVEL, response__nonlinearity=[(0.5, 0.01)], response__crosstalk=[1.0]),
    **_each(SENSOR, RAW, LEVEL, response__darkCurrent=1.0),
    **_each(SENSOR, RAW, WARM, response__temperature=31.0, response__darkCurrentTemperature=21.0),
    **_each(SENSOR, RAW, WARM, response__doublingTemperature=8.0),
    **_each(SENSOR, PATTERN, LEVEL, **{f"response__{name}": 1.0 for name in ("dsnu", "dsnuRow", "dsnuColumn")}),
    **_each(SENSOR, PATTERN, LEVEL, **{f"response__{name}": 0.01 for name in ("prnu", "prnuRow", "prnuColumn")}),
    **_each(SENSOR, PATTERN, LEVEL, response__deadShare=0.01, response__specimen=1),
    **_each(SENSOR, PATTERN, HOT, response__hotShare=0.02, response__hotCurrent=800.0),
    "plen:image:whiteLevel": [Case(A, 0.9, RAW, given=LEVEL)],
    "plen:image:radiance": [Case(A, 3.0, RAW, given=RADIANCE)],
    "plen:transmission": [Case(LENS, "surfaces", LOST, given=RADIANCE)],
    "plen:internalTransmittance": [Case(GLASS, 0.99, LOST, given=LOSSY)],
    **_each(
        GLASS, LOST, ABSORBING, internalTransmittanceWavelengths=[500.0, 620.0], internalTransmittanceTable=[0.9, 0.95]
    ),
    "plen:coatingAngles": [Case(GLASS, [0.0, 40.0], LOST, given=BY_ANGLE)],
    **_each(GLASS, LOST, FILMS, coatingFilmIndices=[1.38, 2.0], coatingFilmThicknesses=[99.0, 120.0]),
    **_each(GLASS, LOST, COATED, coatingWavelengths=[500.0, 620.0], coatingReflectance=[0.01, 0.03]),
    "plen:image:photonRate": [Case(A, 2e6, RAW, given=PHOTONS)],
}

PRINTED = plen("One", ink__wavelengths=[500.0, 600.0], ink__reflectance=[0.1, 0.2])
PRINTED |= plen("One", paper__wavelengths=[500.0, 600.0], paper__reflectance=[0.8, 0.9])
TARGETS = {
    # A colour moves no point, but the saddle of a corner that is not sharp.
    "plen:white": [
        Case("One", 0.9, PAINTED),
        Case("One", 0.9, PAINTED, given=IMAGE),
        Case(MESH, 0.9, {"image"}),
        Case("One", 0.9, DRAWN, given=SADDLE),
    ],
    "plen:black": [Case("One", 0.1, PAINTED), Case("One", 0.1, DRAWN, given=SADDLE)],
    "plen:columns": [
        *(Case(at, 5, DRAWN) for at in ("One", CHARUCO, TAGS, CIRCLES, TRIANGLES, STARS, LINES)),
        Case("One", 5, DRAWN | POSITIONS, given=IMAGE),
        Case(ARRAY, 99, CAMERA, given=COUNTED),
    ],
    "plen:rows": [
        *(Case(at, 4, DRAWN) for at in ("One", CHARUCO, TAGS, TRIANGLES, STARS, LINES)),
        Case(CIRCLES, 5, DRAWN),
        Case(ARRAY, 99, CAMERA, given=COUNTED),
    ],
    "plen:width": [Case(EDGE, 41.0, DRAWN), Case(ARRAY, 20.0, CAMERA)],
    "plen:height": [Case(EDGE, 31.0, DRAWN), Case(ARRAY, 20.0, CAMERA)],
    "plen:squareSize": [Case("One", 1.3, DRAWN), Case(CHARUCO, 6.1, DRAWN)],
    "plen:dictionary": [Case(CHARUCO, "5x5_50", DRAWN), Case(TAGS, "apriltag_25h9", DRAWN)],
    "plen:firstTag": [Case(CHARUCO, 1, DRAWN), Case(TAGS, 1, DRAWN)],
    "plen:spacing": [Case(CIRCLES, 6.1, DRAWN), Case(STARS, 8.1, DRAWN), Case(LINES, 6.1, DRAWN)],
    "plen:diameter": [Case(CIRCLES, 2.9, DRAWN), Case(STARS, 6.9, DRAWN), Case(SIEMENS, 39.0, DRAWN)],
    "plen:spokes": [Case(STARS, 9, DRAWN), Case(SIEMENS, 7, DRAWN)],
    "xformOp:translate": [Case("Screen", (0.0, 0.0, -401.0), TARGET)],
    "plen:shape": [Case("One", "cylinder", DRAWN, along=ROLLED)],
    **_each("One", {"image"}, ink__patch="cyan", paper__patch="yellow"),
    **_each(
        "One",
        {"image"},
        PRINTED,
        ink__wavelengths=[500.0, 620.0],
        ink__reflectance=[0.1, 0.3],
        paper__wavelengths=[500.0, 620.0],
        paper__reflectance=[0.7, 0.9],
    ),
    **_each(CHARUCO, DRAWN, markerSize=4.4, markerCorners=True, legacyPattern=True),
    **_each(TAGS, DRAWN, tagSize=8.1, tagSpacing=0.2, borderBits=1),
    "plen:asymmetric": [Case(CIRCLES, True, DRAWN)],
    "plen:edgeLength": [Case(TRIANGLES, 5.9, DRAWN)],
    "plen:hubDiameter": [Case(SIEMENS, 1.0, DRAWN)],
    "plen:angle": [Case(EDGE, 6.0, DRAWN)],
    "plen:lineWidth": [Case(LINES, 0.9, DRAWN)],
    **_each(MESH, TARGET, mesh=[f"{MESH}/Other"], points=[(1.0, 2.0, 0.0)], normals=[(0.1, 0.0, 1.0)]),
    "plen:radiance": [Case("Screen", 0.5, {"image"})],
    "plen:tolerance": [Case("Screen", 1.0, set())],
    "plen:shape:deflection": [Case("One", (0.1, 0.3), DRAWN, given=WARPED)],
    **_each("One", DRAWN, MEASURED, shape__resolution=Gf.Vec2i(3, 2), shape__heights=[0.0, 0.1, 0.0, 0.2, 0.0, 0.0]),
    "plen:shape:radius": [Case("One", 21.0, DRAWN, given=ROLLED)],
    "plen:shape:edge": [Case("One", 11.0, DRAWN, given=CUBE)],
    **_each("One", DRAWN, STAIRS, shape__steps=3, shape__depth=1.1),
}

CAMERAS = {
    "plen:camera:microlenses": [
        Case(B, [], CAMERA - {"micro_images"}, along=plen(B, camera__microlensDistance=None)),
    ],
    "plen:camera:windows": [Case(A, [PORT], CAMERA), Case(A, ["Pane"], SEEN)],
    "plen:camera:focusGroups": [Case(A, ["Rear"], CAMERA, along=plen(A, camera__focusDistance=434.0))],
    "plen:camera:model": [Case(A, "pinhole", CAMERA), Case(B, "thinLens", CAMERA)],
    "plen:camera:weight": [Case(A, "area", CAMERA), Case(B, "area", CAMERA)],
    # Planes of J: no image depends on them, and no truth that is solved without position images.
    "plen:camera:circleOfConfusion": [
        Case(A, 90.0, PLANES),
        Case(A, 90.0, PLANES | RAYS | TRUTH, given=TWO_PLANE),
        # Within a tenth of the focus distance the depth of field moves no plane.
        Case(A, 2.0, {"first_order"}, given=TWO_PLANE),
        Case(A, 90.0, {"first_order"}, given=AUTHORED | TWO_PLANE),
    ],
    "plen:camera:near": [
        Case(A, 400.0, PLANES),
        Case(A, 400.0, PLANES | RAYS | TRUTH, given=TWO_PLANE),
        Case(B, 400.0, PLANES),
        Case(B, 400.0, PLANES | RAYS | TRUTH, given=plen(B, truth__method="two-plane")),
        Case(B, 400.0, PLANES | RAYS, given=plen(B, truth__rays=True)),
    ],
    "plen:camera:far": [
        Case(A, 500.0, PLANES),
        Case(A, 500.0, PLANES | RAYS | TRUTH, given=TWO_PLANE),
        Case(A, 500.0, PLANES | RAYS | POSITIONS - {"positions"}, given=IMAGE),
    ],
    "plen:image:labels": [
        Case(A, ["depth", "flow"], LABELS),
        Case(A, ["depth", "targets"], LABELS, given=plen(A, image__labels=["depth"])),
        Case(B, ["prim"], LABELS),
    ],
    "plen:shutter:opens": [Case(A, (1.0, 500.0), TIMED), Case(B, (1.0, 500.0), MOVED, given=FLIES)],
    "plen:image:noise": [
        Case(A, 0.1, IN_PASSES),
        Case(A, 0.05, STRIPS, given=plen(A, image__noise=0.1)),
        Case(B, 0.1, IN_PASSES),
    ],
    "plen:image:diffraction": [Case(A, True, IMAGES), Case(B, True, IMAGES)],
    "plen:image:fNumbers": [
        Case(A, [8.0], FURTHER),
        Case(B, [22.0], FURTHER),
        Case(B, [22.0, 16.0], FURTHER, given=plen(B, image__fNumbers=[22.0])),
    ],
    **_each(A, CAMERA, camera__lens=["B/Lens"], camera__sensor=["B/Sensor"], camera__sensorDistance=131.9),
    **_each(B, CAMERA, FOCUSED, camera__focusDistance=421.0, camera__focusType=2),
    **_each(B, CAMERA, camera__stopMatch="microlenses", camera__microlensDistance=1.71),
    "plen:camera:distortion": [Case(A, [-1.0, 0.0, 0.0, 0.0, 0.0], CAMERA, given=PINHOLE_MODEL)],
    "plen:camera:wavelength": [Case(A, 600.0, CAMERA, given=CATALOGUE)],
    "plen:image:samples": [Case(A, 128, IMAGES)],
    "plen:shutter:scanOrder": [Case(A, "bottomToTop", MOVED - {"frame_poses"}, given=SCANNED)],
    **_each(A, MOVED, SCANNED, shutter__lineOffset=(1.0, 1000.0), shutter__exposure=(1.0, 100.0)),
    "plen:shutter:instants": [Case(A, 4, {"image"}, given=FLIES | plen(A, shutter__exposure=(1.0, 100.0)))],
}

METHOD = {
    "plen:truth:method": [
        Case(A, "direct", TRUTH, given=TWO_PLANE),
        Case(A, "image", POSITIONS, given=BOARDS | TWO_PLANE),
        Case(A, "two-plane", TRUTH | RAYS),
        Case(A, "two-plane", TRUTH, given=DELIVERED),
    ],
    # One more product: the others do not need it.
    "plen:truth:rays": [Case(A, True, RAYS), Case(A, True, given=TWO_PLANE)],
    "plen:truth:extent": [Case(A, "full"), Case(A, "full", POSITIONS, given=IMAGE)],
    "plen:truth:search": [
        Case(A, "nearest"),
        Case(A, "nearest", TRUTH, given=TWO_PLANE),
    ],
    "plen:truth:filter": [Case(A, "none"), Case(A, "none", TRUTH, given=TWO_PLANE)],
    "plen:truth:lambdaD": [Case(A, 0.2), Case(A, 0.2, TRUTH, given=TWO_PLANE)],
    "plen:truth:lambdaAlpha": [Case(A, 20.0), Case(A, 20.0, TRUTH, given=TWO_PLANE)],
    "plen:truth:nearestThreshold": [Case(A, 0.1), Case(A, 0.1, TRUTH, given=NEAREST)],
    "plen:truth:supersampling": [
        Case(A, 2),
        Case(A, 2, RAYS, given=DELIVERED),
        Case(A, 2, TRUTH | RAYS, given=TWO_PLANE),
        Case(A, 2, POSITIONS | RAYS, given=IMAGE),
        Case(A, 2, TRUTH, given=plen(A, truth__footprint="pixel")),
    ],
    "plen:truth:samples": [
        Case(A, 128),
        Case(A, 128, RAYS, given=DELIVERED),
        Case(A, 128, TRUTH | RAYS, given=TWO_PLANE),
        Case(A, 128, POSITIONS | RAYS, given=IMAGE),
    ],
    "plen:truth:footprint": [
        Case(A, "pixel", TRUTH | {"first_order"}),
        Case(A, "pixel", TRUTH | RAYS | {"first_order"}, given=TWO_PLANE),
        Case(A, "pixel", POSITIONS | RAYS | {"first_order"}, given=IMAGE),
    ],
    "plen:truth:minHitFraction": [Case(A, 0.1, TRUTH), Case(A, 0.1, TRUTH, given=TWO_PLANE)],
    "plen:truth:accuracy": [Case(A, 0.002, TRUTH), Case(A, 0.002, TRUTH, given=TWO_PLANE)],
    "plen:truth:derivatives": [Case(A, ["Two"], {"derivatives"}, given=BOARDS | plen(A, truth__derivatives=["One"]))],
    "plen:truth:blurDerivatives": [
        Case(A, True, {"derivatives"}, given=BOARDS | plen(A, truth__derivatives=["One"])),
    ],
    "plen:truth:columns": [Case(A, ["chief"], TRUTH)],
}

HEATED = {
    (LENS, "plen:temperature"): 30.0,
    (LENS, "plen:mountExpansion"): 23.6,
    **{(f"A/Lens/{name}", f"plen:{what}"): 5.0 for name in ("S1", "S3", "S8") for what in ("indexSlope", "expansion")},
}
"""The catalogue has no constants of three of the glasses of the lens."""
TEMPERATURE = {
    "plen:indexSlope": [Case(GLASS, 2.0, CAMERA, given=HEATED), Case(GLASS, 2.0)],
    "plen:expansion": [
        *(Case(part, 8.0, CAMERA, given=HEATED) for part in (GLASS, SENSOR)),
        Case(ARRAY, 8.0, CAMERA, given={(f"B{at[1:]}", name): value for (at, name), value in HEATED.items()}),
        *(Case(part, 8.0) for part in (GLASS, ARRAY, SENSOR)),
    ],
    "plen:indexOffset": [
        Case(GLASS, 1e-4, CAMERA),
        Case(GLASS, 1e-4, CAMERA, given=CATALOGUE),
        Case(OUTER, 1e-4, CAMERA, given=PORTED),
    ],
    **_each(LENS, CAMERA, HEATED, temperature=31.0, prescriptionTemperature=21.0, mountExpansion=10.0),
}

TRUNCATED = plen("Tolerance", tolerance__distribution="truncated")
TOLERANCES = {  # they decide which cameras `pipeline ensemble` draws, and nothing of a build
    **_each(
        "Tolerance",
        set(),
        tolerance__of=["A/Lens/S1.plen:thickness"],
        tolerance__distribution="uniform",
        tolerance__spread=0.02,
        tolerance__together=True,
    ),
    "plen:tolerance:limit": [Case("Tolerance", 3.0, given=TRUNCATED)],
}

COATED = plen("One", coat__roughness=0.2)
LIGHTING = {
    # With lamps a mesh that nobody named is in the image, so it may hide points, too.
    "visibility": [Case("Sun", "inherited", {"image"} | TRUTH)],
    "inputs:intensity": [Case("Sun", 4.0), Case("Sun", 4.0, {"image"}, given=LIT)],
    "inputs:color": [Case("Sun", Gf.Vec3f(1.0, 0.5, 0.2), {"image"}, given=LIT)],
    "inputs:angle": [Case("Sun", 2.0, {"image"}, given=LIT)],
    "plen:coat:roughness": [Case("One", 0.3), Case("One", 0.3, {"image"}, given=LIT)],
    "plen:image:bounces": [Case(A, 1), Case(A, 1, {"image"}, given=LIT)],
    "plen:internalTransmittanceColor": [Case("Clear", Gf.Vec3d(0.9, 0.8, 0.7), {"image"}, given=LIT)],
    "plen:coat:ior": [Case("One", 1.4, {"image"}, given=LIT | COATED)],
}

CASES: dict[str, list[Case]] = {
    **LIGHTING,
    **DATASET,
    **MAIN_LENS,
    **PARTS,
    **MICROLENSES,
    **PIXELS,
    **CHANNELS,
    **RAW_IMAGES,
    **TARGETS,
    **CAMERAS,
    **METHOD,
    **TOLERANCES,
    **TEMPERATURE,
}
