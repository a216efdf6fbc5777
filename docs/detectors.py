"""Compare OpenCV's corner detectors with the exact positions J, chief and saddle, and draw docs/detectors.png.

    python docs/detectors.py [FOLDER]      FOLDER: where to build, else build/detectors

Two datasets are built. The first is example 01 as it stands, with the columns chief and saddle. The second looks at one
board 8 mm off the axis through the same double Gauss, its stop opened to semi-diameters of 4, 8 and 17.1 mm (f/2), with
pixels of 5 µm: coma sets J, chief and saddle apart. Detectors work on image.exr, which is linear, in 8 bits where they
want them: image.png has the sRGB curve, and that moves the saddle of a blurred corner. The images are made of random
rays, 64 per pixel in example 01 and 256 in the other. What the detectors make of drawings without any lens, blurred
evenly, is printed first.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
from detector_stages import STOPS_MM, write_stages

import pipeline
from pipeline.files.exr import read_exr
from pipeline.files.png import write_png
from pipeline.files.tables import read_table
from pipeline.targets.patterns.checkerboard import Checkerboard

ROOT = Path(__file__).resolve().parents[1]
CLASSES_PX2 = ((0.0, 0.1), (0.1, 1.0), (1.0, np.inf), (0.0, 1.0))
EVERYTHING = ((0.0, np.inf),)
INK = {
    "J": (0, 130, 220),
    "chief": (220, 40, 150),
    "saddle": (230, 120, 0),
    "SB": (0, 150, 60),
    "SubPix 7": (90, 90, 90),
}
Positions = dict[str, np.ndarray]


def build(folder: Path) -> tuple[list[Path], list[Path]]:
    """Frame folders of example 01, and of the board behind three stops."""
    for stage in write_stages(folder, ROOT):
        pipeline.build(stage, folder / stage.stem, allow_roots=(ROOT,))
    frames = sorted((folder / "example_01/frames").glob("*/*"))
    return frames, sorted((folder / "coma/frames/0001").glob("Stop*"))


def positions(frame: Path) -> Positions:
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


def drawn(square_px: float, blur_px: float, turn_deg: float) -> tuple[np.ndarray, Positions]:
    """A checkerboard as a picture without a lens, and its corners: 8 x 8 points per pixel, blurred evenly."""
    board, size, fine = Checkerboard(columns=6, rows=5, square_mm=square_px), round(10 * square_px), 8
    place = (np.arange(size * fine) + 0.5) / fine - 0.5 - (size - 1) / 2
    x, y = np.meshgrid(place, -place)
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    white = board.drawing.whiteness((c * x + s * y).ravel(), (c * y - s * x).ravel()).reshape(x.shape)
    white = cv2.GaussianBlur(np.nan_to_num(white, nan=1.0), (0, 0), blur_px * fine)
    corners = board.marks().xy_mm @ [[c, -s], [s, c]] * [1, 1] + (size - 1) / 2
    return white.reshape(size, fine, size, fine).mean(axis=(1, 3)).astype(np.float32), {"truth": corners}


def detected(image: np.ndarray, near: np.ndarray, size: tuple[int, int]) -> Positions:
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
    found = {"SB": sector}
    for half in (3, 8):
        refined = cv2.cornerSubPix(image, begin.copy(), (half, half), (-1, -1), stop)
        found[f"SubPix {2 * half + 1}"] = refined.reshape(-1, 2).astype(float)
    return found


def figures(apart: np.ndarray) -> str:
    """Mean of both axes, rms per axis and of the length, of the rows that are known."""
    known = apart[np.isfinite(apart).all(axis=1)]
    mean, rms = known.mean(axis=0), np.sqrt((known**2).mean(axis=0))
    pairs = f"mean {mean[0]:+.3f} {mean[1]:+.3f}  rms {rms[0]:.3f} {rms[1]:.3f}"
    return f"{len(known):4}  {pairs}  length {np.hypot(*rms):.3f}"


def compare(cases: list[tuple[Positions, Positions]], classes: tuple[tuple[float, float], ...]) -> None:
    """Print detectors against positions, by blur."""
    exact = {key: np.concatenate([case[0][key] for case in cases]) for key in cases[0][0]}
    found = {key: np.concatenate([case[1][key] for case in cases]) for key in cases[0][1]}
    for low, high in classes:
        here = (exact["blur"] >= low) & (exact["blur"] < high)
        print(f"  blur_xx + blur_yy from {low:g} to {high:g} px^2")
        for key in ("chief", "saddle"):
            print(f"    {key + ' - J':18} {figures((exact[key] - exact['J'])[here])}")
        for name, values in found.items():
            for key in ("J", "chief", "saddle"):
                if np.isfinite(values[here]).any():
                    print(f"    {name + ' - ' + key:18} {figures((values - exact[key])[here])}")


def close_up(image: np.ndarray, marks: Positions, half: int, zoom: int) -> np.ndarray:
    """The pixels around a corner, enlarged, with a cross at every position."""
    left, top = (int(v) for v in np.round(marks["saddle"]) - half)
    part = np.clip(255 * image[top : top + 2 * half + 1, left : left + 2 * half + 1], 0, 255).astype(np.uint8)
    # Black and white are softened, so that the crosses stand out.
    picture = cv2.cvtColor(64 + part // 2, cv2.COLOR_GRAY2RGB).repeat(zoom, axis=0).repeat(zoom, axis=1)
    for name, mark in marks.items():
        x, y = ((mark - (left, top) + 0.5) * zoom - 0.5) * 16
        for arm in ((12 * 16, 0), (0, 12 * 16)):
            ends = [(round(x + s * arm[0]), round(y + s * arm[1])) for s in (-1, 1)]
            cv2.line(picture, *ends, INK[name], 2, cv2.LINE_AA, 4)
    return picture


def residuals(case: list[tuple[Positions, Positions]], detector: str, key: str, reach: float, size: int) -> np.ndarray:
    """A detector minus a position, one dot per corner with a blur below 1 px^2, in a square of `reach` px each way."""
    picture = np.full((size, size, 3), 255, np.uint8)
    for step in np.arange(-reach, 1.01 * reach, 0.05):
        at = round((step / reach + 1) / 2 * (size - 1))
        shade = 120 if abs(step) < 1e-9 else 225
        picture[at], picture[:, at] = shade, shade
    for exact, found in case:
        for apart in (found[detector] - exact[key])[exact["blur"] < 1]:
            place = [round(16 * (v / reach + 1) / 2 * (size - 1)) for v in apart]
            cv2.circle(picture, place, 3 * 16, INK[key], -1, cv2.LINE_AA, 4)
    return picture


def framed(picture: np.ndarray, title: str) -> np.ndarray:
    """A picture with a title above it and a white border."""
    picture = cv2.copyMakeBorder(picture, 30, 10, 10, 10, cv2.BORDER_CONSTANT, value=(255, 255, 255))
    return cv2.putText(picture, title, (10, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.46, (0, 0, 0), 1, cv2.LINE_AA)


def draw(path: Path, example: list, coma: list, images: list[np.ndarray]) -> None:
    """Three corners with all positions above, residuals of two detectors below."""
    size, above = 333, []
    for stop, image, (exact, found), half in zip(STOPS_MM, images, coma, (4, 4, 18), strict=True):
        marks = {name: exact[name][7] for name in ("J", "chief", "saddle")}
        marks |= {
            name: found[name][7] for name in ("SB", "SubPix 7") if np.hypot(*(found[name] - exact["J"])[7]) < half
        }
        zoom = size // (2 * half + 1)
        grown = cv2.resize(close_up(image, marks, half, zoom), (size, size), interpolation=cv2.INTER_NEAREST)
        above.append(framed(grown, f"stop {stop:g} mm, {2 * half + 1} px wide"))
    below = [
        framed(residuals(example, "SB", key, 0.25, size), f"example 01: SB - {key}, +-0.25 px")
        for key in ("J", "chief", "saddle")
    ]
    legend = np.full((34, 3 * (size + 20), 3), 255, np.uint8)
    for i, (name, ink) in enumerate(INK.items()):
        cv2.putText(legend, f"+ {name}", (20 + 200 * i, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.55, ink, 2, cv2.LINE_AA)
    write_png(path, np.concatenate([legend, np.concatenate(above, axis=1), np.concatenate(below, axis=1)]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "build/detectors", help="where to build")
    folder = parser.parse_args().folder.resolve()
    print("number, then [px]: mean x and y, rms x and y, rms of the length")
    for square, blur in ((24.0, 0.3), (44.0, 0.3), (44.0, 1.0)):
        print(f"drawings, squares of {square:g} px, blur of {blur:g} px")
        boards = [drawn(square, blur, turn) for turn in (-17.0, -9.3, -4.1, 3.7, 8.2, 14.9)]
        apart = [(detected(image, exact["truth"], (6, 5)), exact["truth"]) for image, exact in boards]
        for name in apart[0][0]:
            print(f"    {name + ' - truth':18} {figures(np.concatenate([found[name] - at for found, at in apart]))}")
    frames, stops = build(folder)
    example = [
        (exact, detected(image_of(frame), exact["J"], (7, 4))) for frame in frames for exact in [positions(frame)]
    ]
    print("example 01")
    compare(example, CLASSES_PX2)
    images = [image_of(frame) for frame in stops]
    coma = [(e, detected(image, e["saddle"], (5, 4))) for image, e in zip(images, map(positions, stops), strict=True)]
    for stop, case in zip(STOPS_MM, coma, strict=True):
        print(f"stop of {stop:g} mm, 8 mm off the axis")
        compare([case], EVERYTHING)
    draw(Path(__file__).with_suffix(".png"), example, coma, images)


if __name__ == "__main__":
    main()
