"""Compare OpenCV's corner detectors with the exact positions J, chief and saddle, and draw docs/detectors.png.

    python docs/detectors.py [FOLDER]      FOLDER: where to build, else build/detectors

Two datasets are built. The first is example 01 as it stands, with the columns chief and saddle. The second looks at one
board at 8 mm image height through the same double Gauss, its stop opened to semi-diameters of 4, 8 and 17.1 mm (f/2),
pixels of 5 µm: coma sets J, chief and saddle apart. Detectors work on image.exr, which is linear; image.png has the sRGB
curve, and that moves the saddle of a blurred corner. Their images are sampled, with noise of 1 / sqrt(rays per pixel)
at an edge, and 8 bits where the detector wants them.
"""

import sys
from pathlib import Path

import cv2
import numpy as np

import pipeline
from pipeline.files.exr import read_exr
from pipeline.files.tables import read_table

ROOT = Path(__file__).resolve().parents[1]
STOPS_MM = (4.0, 8.0, 17.1)
BLUR_CLASSES_PX2 = ((0.0, 0.1), (0.1, 1.0), (1.0, np.inf))
HEAD = """#usda 1.0
(
    defaultPrim = "{name}"
    endTimeCode = {frames}
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
{layers})
"""
COLUMNS = 'uniform token[] plen:truth:columns = ["chief", "saddle"]'
EXAMPLE = """
over "Conventional"
{{
    over "Rig"
    {{
        over "Camera"
        {{
            {columns}
        }}
    }}
}}
"""
COMA = """
def PlenDataset "Coma"
{{
    rel plen:cameras = [{paths}]
    rel plen:targets = </Coma/Board>
{cameras}
    def PlenCheckerboard "Board"
    {{
        uniform int plen:columns = 5
        uniform int plen:rows = 4
        uniform double plen:squareSize = 1
        double3 xformOp:translate = (27, 0, -434.4)
        float xformOp:rotateY = 10
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]
    }}
}}
"""
CAMERA = """
    def "Stop{number}" (
        prepend references = @{stages}/rigs/conventional_100mm.usda@
    )
    {{
        over "Camera"
        {{
            uniform int plen:image:samples = 256
            uniform token plen:truth:method = "direct"
            {columns}
        }}

        over "Lens"
        {{
            over "Stop"
            {{
                uniform double plen:semiDiameter = {stop}
            }}
        }}

        over "Sensor"
        {{
            uniform double2 plen:offset = (-8, 0)
            uniform double plen:pixelPitch = 0.005
            uniform int2 plen:resolution = (480, 360)
        }}
    }}
"""
INK = {"J": (0, 130, 220), "chief": (220, 40, 150), "saddle": (230, 120, 0), "detector": (0, 150, 60)}


def build(folder: Path) -> tuple[list[Path], list[Path]]:
    """Frame folders of example 01, and of the board behind three stops."""
    folder.mkdir(parents=True, exist_ok=True)
    layer = f"    subLayers = [@{ROOT}/examples/01_conventional/dataset.usda@]\n"
    example = HEAD.format(name="Conventional", frames=6, layers=layer) + EXAMPLE.format(columns=COLUMNS)
    cameras = "".join(
        CAMERA.format(number=n, stages=ROOT / "stages", columns=COLUMNS, stop=stop) for n, stop in enumerate(STOPS_MM)
    )
    paths = ", ".join(f"</Coma/Stop{n}/Camera>" for n in range(len(STOPS_MM)))
    coma = HEAD.format(name="Coma", frames=1, layers="") + COMA.format(paths=paths, cameras=cameras)
    for name, text in (("example_01", example), ("coma", coma)):
        (folder / f"{name}.usda").write_text(text, encoding="utf-8")
        pipeline.build(folder / f"{name}.usda", out=folder / name, allow_roots=(ROOT,))
    frames = sorted((folder / "example_01/frames").glob("*/*"))
    return frames, sorted((folder / "coma/frames/0001").iterdir())


def positions(frame: Path) -> dict[str, np.ndarray]:
    """J, chief and saddle of a frame, (n, 2) each, and the sum of the blur's variances, (n,) [px^2]."""
    table = read_table(frame / "correspondences.csv")
    names = {"J": "", "chief": "chief_", "saddle": "saddle_"}
    found = {key: np.stack([table.numbers(f"{name}{axis}_px") for axis in "xy"], axis=1) for key, name in names.items()}
    return {**found, "blur": table.numbers("blur_xx_px2") + table.numbers("blur_yy_px2")}


def image_of(frame: Path) -> np.ndarray:
    """Relative irradiance, (h, w) float32."""
    (part,) = read_exr(frame / "image.exr").values()
    (channel,) = part.channels.values()
    return np.ascontiguousarray(channel, np.float32)


def detected(image: np.ndarray, near: np.ndarray, size: tuple[int, int]) -> dict[str, np.ndarray]:
    """What each detector finds, in the order of `near`: the nearest corner that it reports; NaN for none."""
    grey = np.clip(np.rint(255 * image), 0, 255).astype(np.uint8)
    flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
    ok, corners = cv2.findChessboardCornersSB(grey, size, flags=flags)
    sector = np.full(near.shape, np.nan)
    if ok:
        corners = corners.reshape(-1, 2)
        sector = corners[np.argmin(np.linalg.norm(near[:, None] - corners, axis=2), axis=1)].astype(float)
    begin = np.where(np.isnan(sector), near, sector).astype(np.float32).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-4)
    found = {"findChessboardCornersSB": sector}
    for half in (3, 8):
        refined = cv2.cornerSubPix(image, begin.copy(), (half, half), (-1, -1), stop)
        found[f"cornerSubPix {2 * half + 1}"] = refined.reshape(-1, 2).astype(float)
    return found


def figures(apart: np.ndarray) -> str:
    """Mean of both axes, and rms per axis and of the length."""
    mean, per_axis = apart.mean(axis=0), np.sqrt((apart**2).mean(axis=0))
    return f"mean {mean[0]:+.3f} {mean[1]:+.3f}  rms {per_axis[0]:.3f} {per_axis[1]:.3f}, {np.hypot(*per_axis):.3f}"


def compare(cases: list[tuple[dict[str, np.ndarray], dict[str, np.ndarray]]], classes: tuple) -> None:
    """Print detectors against positions, by blur."""
    exact = {key: np.concatenate([case[0][key] for case in cases]) for key in cases[0][0]}
    for low, high in classes:
        here = (exact["blur"] >= low) & (exact["blur"] < high)
        if not here.any():
            continue
        print(f"  blur_xx + blur_yy from {low:g} to {high:g} px^2, {here.sum()} corners")
        for key in ("chief", "saddle"):
            print(f"    {key + ' - J':36} {figures((exact[key] - exact['J'])[here])}")
        for name in cases[0][1]:
            found = np.concatenate([case[1][name] for case in cases])
            seen = here & np.isfinite(found).all(axis=1)
            for key in ("J", "chief", "saddle") if seen.any() else ():
                print(f"    {name + ' - ' + key:36} {figures((found - exact[key])[seen])}")


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build/detectors"
    frames, stops = build(folder.resolve())
    example = [(positions(frame), detected(image_of(frame), positions(frame)["J"], (7, 4))) for frame in frames]
    print("example 01 [px]: mean x and y, rms x and y, rms of the length")
    compare(example, (*BLUR_CLASSES_PX2, (0.0, 1.0)))
    coma = [(positions(frame), detected(image_of(frame), positions(frame)["saddle"], (5, 4))) for frame in stops]
    for stop, case in zip(STOPS_MM, coma, strict=True):
        print(f"stop of {stop} mm, 8 mm off the axis")
        compare([case], ((0.0, np.inf),))


if __name__ == "__main__":
    main()
