"""Small scenes in which every attribute of the schemas means something: 12 x 8 pixels, one frame, few rays."""

from dataclasses import dataclass, field
from typing import Any

from places import DATA
from pxr import Gf, Sdf, Sdr, Usd, UsdGeom, UsdShade
from stage_text import plen

BASE = (DATA / "hostile.usda").read_text(encoding="utf-8")
_SHADERS = ("Paint/Surface", "Paint/Picture", "Paint/Turn", "Paint/Reader")


@dataclass(frozen=True)
class Scene:
    """A scene and the attributes that it is there for: edits of BASE by prim below /Scene and attribute.

    `kind` and `lamp` are the types of "Board" and "Lamp". Of `whole` prims every property is tried, of other prims than
    ours USD's own; `responds` gives "Sensor" its PlenSensorResponseAPI, and `is_glass` makes "Paint" glass.
    """

    edits: dict[tuple[str, str], Any] = field(default_factory=dict)
    kind: str = "PlenCheckerboard"
    whole: tuple[str, ...] = ()
    responds: bool = False
    is_glass: bool = False
    lamp: str = "RectLight"

    def stage(self) -> Usd.Stage:
        layer = Sdf.Layer.CreateAnonymous(".usda")
        layer.ImportFromString(BASE)
        board = layer.GetPrimAtPath("/Scene/Board")
        if self.kind != board.typeName:
            board.typeName = self.kind
            for name in [prop.name for prop in board.properties if prop.name.startswith("plen:")]:
                del board.properties[name]
        if self.kind == "PlenMeshTarget":
            Sdf.CopySpec(layer, "/Scene/Screen", layer, "/Scene/Board/Mesh")
            layer.GetPrimAtPath("/Scene/Board/Mesh").ClearInfo("apiSchemas")
            _unpaint(layer.GetPrimAtPath("/Scene/Board/Mesh"))
        layer.GetPrimAtPath("/Scene/Lamp").typeName = self.lamp
        if self.lamp != "RectLight":
            for name in ("height", "width"):
                del layer.GetPrimAtPath("/Scene/Lamp").properties[f"inputs:{name}"]
        self._leave_out_what_nobody_asks_for(layer)
        stage = Usd.Stage.Open(layer)
        if self.responds:
            stage.GetPrimAtPath("/Scene/Sensor").ApplyAPI("PlenSensorResponseAPI")
        if self.is_glass:
            stage.GetPrimAtPath("/Scene/Paint").ApplyAPI("PlenGlassAPI")
        for (at, name), value in self.edits.items():
            put(stage, at, name, value)
        return stage

    def _leave_out_what_nobody_asks_for(self, layer: Sdf.Layer) -> None:
        """Checks of thousands of stages take minutes: most have no microlenses, channel, lamp or occluder."""
        root = layer.GetPrimAtPath("/Scene")
        if not any(at == "Sensor/Red" for at, _ in self.edits):
            del layer.GetPrimAtPath("/Scene/Sensor").nameChildren["Red"]
        if ("Camera", "plen:camera:microlenses") not in self.edits:
            del root.nameChildren["Array"]
        if "Tolerance" not in self.whole:
            del root.nameChildren["Tolerance"]
        for name in {"Lamp", "Crowd"}.difference(self.whole):
            del root.nameChildren[name]
        is_painted = any(at.startswith("Paint") for at in self.whole)
        if not is_painted:
            del root.nameChildren["Paint"]
            _unpaint(layer.GetPrimAtPath("/Scene/Screen"))
        if not is_painted and "Screen" not in self.whole:
            del root.nameChildren["Screen"]
            del root.properties["plen:occluders"]

    def tried(self) -> list[tuple[str, str]]:
        """Pairs of a prim and one of its properties that this scene is there for."""
        stage, found = self.stage(), dict.fromkeys(self.edits)
        for at in self.whole:
            prim = path_of(stage, at)
            names, is_ours = prim.GetPrimDefinition().GetPropertyNames(), prim.GetTypeName().startswith("Plen")
            if at == "Lamp" and self.lamp != "RectLight":  # what all lamps have is tried on one
                names = set(names) - set(
                    Usd.SchemaRegistry().FindConcretePrimDefinition("RectLight").GetPropertyNames()
                )
            names = [*sorted(names), *(f"inputs:{name}" for name in inputs_of(prim))]
            found |= dict.fromkeys((at, name) for name in names if name.startswith("plen:") or not is_ours)
        return list(found)


def _unpaint(mesh: Sdf.PrimSpec) -> None:
    for name in ("material:binding", "primvars:st"):
        del mesh.properties[name]


def path_of(stage: Usd.Stage, at: str) -> Usd.Prim:
    """A prim by its path below /Scene."""
    return stage.GetPrimAtPath(f"/Scene/{at}".rstrip("/"))


def inputs_of(prim: Usd.Prim) -> dict[str, Sdr.ShaderProperty]:
    """Inputs of a shader by the definition of USD; none of any other prim."""
    shader = prim.IsA(UsdShade.Shader) and Sdr.Registry().GetShaderNodeByIdentifier(UsdShade.Shader(prim).GetShaderId())
    return {name: shader.GetShaderInput(name) for name in shader.GetShaderInputNames()} if shader else {}


def put(stage: Usd.Stage, at: str, name: str, value: Any) -> None:
    """Author one property; None blocks it, a list of Sdf.Path is for relationships."""
    prim = path_of(stage, at)
    if relationship := prim.GetRelationship(name):
        relationship.SetTargets(value)
    elif value is None:
        prim.GetAttribute(name).Block()
    else:
        prim.GetAttribute(name).Set(value)


_SINGLET = plen("Lens", indexSource="catalogue") | plen("Lens/Front", glass="schott:N-BK7")
_THREE = plen("Array", focalLengths=[1.2, 1.25, 1.3])
_PLENOPTIC = plen("Sensor", pixelPitch=0.05) | plen(
    "Camera",
    camera__microlenses=[Sdf.Path("/Scene/Array")],
    camera__microlensDistance=1.5,
    camera__sensorDistance=62.4,
)
_MARKED = plen("Board", points=[(5.0, 1.0, -300.0)], normals=[(0.0, 0.0, 1.0)], mesh=[Sdf.Path("/Scene/Board/Mesh")])
_FACES = plen("Array", model="refractive", index=1.5, thickness=0.1, frontRadii=[0.7], rearRadii=[-5.0])
_RAW = plen("Camera", image__exposure="level", image__whiteLevel=0.8, image__exposureTime=0.01) | plen(
    "Sensor",
    response__fullWell=9000.0,
    response__gain=0.4,
    response__bitDepth=12,
    response__blackLevel=60.0,
    **{f"response__{name}Noise": 2.0 for name in ("dark", "row", "column")},
    **{f"response__{name}": 1.0 for name in ("dsnu", "dsnuRow", "dsnuColumn")},
    **{f"response__{name}": 0.01 for name in ("prnu", "prnuRow", "prnuColumn", "hotShare", "deadShare")},
    response__darkCurrent=10.0,
    response__hotCurrent=900.0,
    response__specimen=1,
    response__temperature=30.0,
    response__darkCurrentTemperature=20.0,
    response__doublingTemperature=7.0,
    response__filters=["mono"],
    response__quantumEfficiency=[0.6],
    response__shotNoise=True,
    response__nonlinearity=[(0.5, 0.01), (1.0, -0.01)],
    response__crosstalk=[0.0, 0.1, 0.0, 0.1, 0.6, 0.1, 0.0, 0.1, 0.0],
)
_PHOTONS = plen("Camera", image__exposure="photons", image__photonRate=1e6, image__exposureTime=0.01) | plen(
    "Sensor", response__fullWell=9000.0, response__gain=0.4, response__bitDepth=12
)
_RADIANCE = (
    plen("Camera", image__exposure="radiance", image__radiance=2.0, image__exposureTime=0.01)
    | plen("Sensor", response__fullWell=9000.0, response__gain=0.4, response__bitDepth=12)
    | plen("Lens", transmission="surfaces")
)
_TABLES = plen("Lens/Front", coatingWavelengths=[500.0, 600.0], coatingAngles=[0.0, 40.0]) | plen(
    "Lens/Front",
    coatingReflectance=[0.01, 0.02, 0.02, 0.03],
    internalTransmittanceWavelengths=[500.0, 600.0],
    internalTransmittanceTable=[0.97, 0.98],
)
_FILMS = plen("Lens", transmittanceSource="catalogue") | plen(
    "Lens/Front",
    coatingFilmIndices=[1.38, 2.1],
    coatingFilmThicknesses=[100.0, 120.0],
    internalTransmittance=0.99,
    internalTransmittanceThickness=25.0,
)

SCENES: dict[str, Scene] = {
    "glass": Scene(plen("Paint", glass="schott:N-BK7"), whole=("Paint",), is_glass=True),
    "conventional": Scene(
        whole=("", "Camera", "Lens", "Lens/Front", "Lens/Stop", "Lens/Group", "Sensor", "Board", "Screen")
    ),
    "plenoptic": Scene(_PLENOPTIC, whole=("Array",)),
    "tolerances": Scene(plen("Tolerance", tolerance__distribution="truncated"), whole=("Tolerance",)),
    "focus": Scene(
        plen("Camera", camera__focusDistance=500.0, camera__focusGroups=["Group"])
        | plen("Lens/Group", pivot=1.0, decentre=(0.1, 0.0), tilt=(0.1, 0.0))
    ),
    "focused": Scene(plen("Camera", camera__sensorDistance=None, camera__focusDistance=500.0)),
    "matched": Scene(
        _PLENOPTIC
        | plen("Camera", camera__sensorDistance=None, camera__focusDistance=500.0)
        | plen("Camera", camera__stopMatch="microlenses", camera__focusType=0)
    ),
    "model": Scene(plen("Camera", camera__model="thinLens", camera__distortion=[0.1, 0.0, 0.01, 0.0, 0.0])),
    "planes": Scene(plen("Camera", camera__near=400.0, camera__far=600.0, truth__columns=["chief", "saddle"])),
    "two-plane method": Scene(plen("Camera", truth__method="two-plane", truth__search="nearest")),
    "direct method": Scene(plen("Camera", truth__method="direct", truth__accuracy=0.01)),
    "image method": Scene(plen("Camera", truth__method="image", truth__extent="full", truth__footprint="pixel")),
    "exports": Scene(
        plen("", exports=["npz", "opencv"], exports__position="exact", exports__noise=0.1, exports__outliers=0.1)
        | plen("", exports__outlierReach=9.0, exports__missed=0.1, exports__noiseSeed=2)
    ),
    "exports behind microlenses": Scene(
        _PLENOPTIC | plen("", exports=["libpleno"]) | plen("Board", columns=3, rows=2, squareSize=4.0, markerSize=3.0),
        "PlenCharuco",
    ),
    "white images": Scene(_PLENOPTIC | plen("Camera", image__fNumbers=[16.0], image__diffraction=True)),
    "catalogue": Scene(_SINGLET | plen("Lens/Front", abbe=64.17)),
    "ideal": Scene(plen("Lens/Stop", focalLength=5000.0)),
    "asphere": Scene(plen("Lens/Front", conic=-0.1, evenCoefficients=[0.0, 1e-6], oddCoefficients=[1e-6])),
    "annular": Scene(plen("Lens/Stop", apertureShape="annular", innerSemiDiameter=1.0)),
    "rectangular": Scene(plen("Lens/Stop", apertureShape="rectangular", halfWidths=(2.0, 2.0), apertureRotation=5.0)),
    "polygonal": Scene(plen("Lens/Stop", apertureShape="polygonal", blades=5)),
    "cosine": Scene(plen("Sensor", acceptance="cosine", acceptancePower=2.0)),
    "cone": Scene(plen("Sensor", acceptance="cone", acceptanceHalfAngle=20.0, acceptanceRollOff=2.0)),
    "channel": Scene(
        _SINGLET | plen("Sensor/Red", wavelengths=[580.0, 620.0, 660.0], response=[0.1, 0.5, 0.2], nodes=2)
    ),
    "known camera": Scene(_SINGLET | plen("Sensor/Red", sensitivity="Nikon 5100 (NPL)", component="green", nodes=1)),
    "raw images": Scene(_RAW, responds=True),
    "shutter": Scene(plen("Camera", shutter__exposure=Gf.Vec2d(1, 100), truth__method="direct")),
    "lit": Scene(
        plen("Board", coat__roughness=0.2, coat__ior=1.4)
        | plen("Board", ink__wavelengths=[500.0, 600.0], ink__reflectance=[0.1, 0.2])
        | plen("Board", paper__wavelengths=[500.0, 600.0], paper__reflectance=[0.8, 0.9])
        | plen("Camera", image__bounces=1),
        whole=("Lamp", "Screen"),
    ),
    "painted": Scene(
        {("Screen", "material:binding"): [Sdf.Path("/Scene/Paint")]}
        | {("Screen", "primvars:st"): [(0, 0), (1, 0), (0, 1)]},
        whole=("Lamp", "Paint", *_SHADERS),
        lamp="DistantLight",
    ),
    "painted without lamps": Scene(plen("Board", white=0.9), whole=_SHADERS[1:2]),
    "sky": Scene({("Lamp", "inputs:texture:file"): Sdf.AssetPath("./picture.png")}, whole=("Lamp",), lamp="DomeLight"),
    **{f"{kind} lamp": Scene(whole=("Lamp",), lamp=f"{kind}Light") for kind in ("Disk", "Sphere", "Cylinder")},
    "other sky": Scene(whole=("Lamp",), lamp="DomeLight_1"),
    "patches": Scene(plen("Board", ink__patch="cyan", paper__patch="white 9.5 (.05 D)")),
    "instances": Scene({("", "plen:occluders"): [Sdf.Path("/Scene/Crowd")]}, whole=("Crowd",)),
    "photons": Scene(_PHOTONS, responds=True),
    "radiance": Scene(_RADIANCE | _TABLES, responds=True),
    "films": Scene(_RADIANCE | _FILMS, responds=True),
    "counted": Scene(_PLENOPTIC | plen("Array", width=None, height=None, columns=3, rows=3)),
    "three types": Scene(_PLENOPTIC | _THREE | plen("Array", typeTable=[0, 1, 2], typePeriod=Gf.Vec2i(3, 1))),
    "plates": Scene(_PLENOPTIC | plen("Array", model="two-plane", index=1.5, thickness=0.1)),
    "faces": Scene(_PLENOPTIC | _FACES | plen("Array", frontConics=[-0.1], rearConics=[-0.1])),
    "glass of faces": Scene(_PLENOPTIC | _FACES | plen("Array", index=None, glass="schott:N-BK7")),
    "discs": Scene(_PLENOPTIC | plen("Array", aperture="disc", discDiameter=0.15)),
    "warped": Scene(plen("Board", shape="warped", shape__deflection=(0.2, 0.1))),
    "height map": Scene(
        plen("Board", shape="heightMap", shape__resolution=Gf.Vec2i(2, 2), shape__heights=[0.0, 0.1, 0.0, 0.1])
    ),
    "cylinder": Scene(plen("Board", shape="cylinder", shape__radius=30.0)),
    "cube": Scene(plen("Board", shape="cube", shape__edge=30.0)),
    "stairs": Scene(plen("Board", shape="stairs", shape__steps=2, shape__depth=2.0)),
    "charuco": Scene(plen("Board", columns=3, rows=2, squareSize=4.0, markerSize=3.0), "PlenCharuco", ("Board",)),
    "tags": Scene(plen("Board", columns=2, rows=2, tagSize=5.0), "PlenAprilGrid", ("Board",)),
    "circles": Scene(plen("Board", columns=3, rows=3, spacing=4.0, diameter=2.0), "PlenCircleGrid", ("Board",)),
    "triangles": Scene(plen("Board", columns=3, rows=2, edgeLength=4.0), "PlenDeltille", ("Board",)),
    "stars": Scene(plen("Board", columns=3, rows=2, spacing=5.0, diameter=4.0), "PlenStars", ("Board",)),
    "siemens": Scene(plen("Board", spokes=6, diameter=15.0), "PlenSiemensStar", ("Board",)),
    "edge": Scene(plen("Board", width=20.0, height=15.0), "PlenSlantedEdge", ("Board",)),
    "mesh": Scene(_MARKED, "PlenMeshTarget", ("Board", "Board/Mesh")),
    "lines": Scene(plen("Board", columns=2, rows=2, spacing=5.0, lineWidth=1.0), "PlenLines", ("Board",)),
}

_FEW = (UsdGeom.XformOp.TypeTranslate, UsdGeom.XformOp.TypeOrient, UsdGeom.XformOp.TypeTransform)


def xform_ops(every: bool) -> dict[str, str]:
    """Name -> type of the operations that move a prim, in doubles; every one, and some also shorter, or a few."""
    stage = Usd.Stage.CreateInMemory()
    moved = UsdGeom.Xform.Define(stage, "/Moved")
    kinds = UsdGeom.XformOp.Type.allValues[1:] if every else _FEW
    ops = [moved.AddXformOp(kind, UsdGeom.XformOp.PrecisionDouble) for kind in kinds]
    for precision in (UsdGeom.XformOp.PrecisionFloat, UsdGeom.XformOp.PrecisionHalf) if every else ():
        ops += [moved.AddXformOp(kind, precision, precision.name) for kind in _FEW[:2]]
    return {str(op.GetOpName()): str(op.GetAttr().GetTypeName()) for op in ops}


def metadata() -> dict[str, Any]:
    """What may be said of a whole stage, as usda writes it, and a usual value."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    keys = layer.pseudoRoot.GetMetaDataInfoKeys()
    found = {{"documentation": "doc"}.get(key, key): layer.pseudoRoot.GetInfo(key) for key in sorted(keys)}
    return found | {"subLayers": []}
