"""Lenses written in the formats of other programs: independent twins of the importers, for round trips."""

import math

from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Prescription, Surface

D_UM = 0.5875618


def zemax(lens: Prescription, encoding: str = "utf-16", unit: str = "MM") -> bytes:
    """A Zemax file: curvatures, semi-diameters, model glasses; object and image surface around."""
    mm = {"MM": 1.0, "IN": 25.4}[unit]
    lines = ["VERS 140124 0 123457", "MODE SEQ", "NAME Round trip é", f"UNIT {unit} X W X CM MR CPMM"]
    lines += [
        f"ENPD {first_order(lens).entrance_pupil.diameter_mm / mm!r}",
        "GCAT SCHOTT MISC",
        f"WAVM 1 {D_UM} 1.0E+0",
        "FTYP 0 0 1 1 0 0 0",
    ]
    lines += ["SURF 0", "  TYPE STANDARD", "  CURV 0.0", "  DISZ INFINITY"]
    for i, s in enumerate(lens.surfaces, 1):
        powers = _powers(s)
        kind = "STANDARD" if not powers else "EVENASPH" if all(p % 2 == 0 for p in powers) else "ODDASPHE"
        lines += [f"SURF {i}", *(["  STOP"] if s.is_stop else []), f"  TYPE {kind}"]
        lines += [f"  CURV {s.curvature_per_mm * mm!r} 0 0 0 0", f"  DISZ {s.thickness_mm / mm!r}"]
        lines += [f"  CONI {s.conic!r}"] if s.conic else []
        step = 2 if kind == "EVENASPH" else 1
        lines += [f"  PARM {p // step} {a * mm ** (p - 1)!r}" for p, a in powers.items()]
        if s.index != 1:
            lines.append(f"  GLAS ___BLANK 1 0 {s.index!r} 5.0E+1 0 0 0 0 0 0")
        lines.append(f"  DIAM {s.semi_diameter_mm / mm!r} 1 0 0 1")
        if s.inner_semi_diameter_mm:
            lines.append(f"  OBSC 0 {s.inner_semi_diameter_mm / mm!r} 0")
        if s.half_widths_mm:
            lines.append(f"  SQAP {s.half_widths_mm[0] / mm!r} {s.half_widths_mm[1] / mm!r} 0")
    lines += [f"SURF {len(lens.surfaces) + 1}", "  TYPE STANDARD", "  CURV 0.0", "  DISZ 0", "  DIAM 4.3 0 0 0 1"]
    return ("\r\n".join(lines) + "\r\n").encode(encoding)


def codev(lens: Prescription, curvatures: bool = False) -> bytes:
    """A CODE V sequence: radii or curvatures, fictitious glasses, circular apertures."""
    lines = [f'RDM{" N" if curvatures else ""};LEN  "VERSION: 11.0"', "TITLE 'Round trip; it is'", "DIM M"]
    lines.append(f"EPD {first_order(lens).entrance_pupil.diameter_mm!r}")
    lines += ["WL 587.6 ! the d line", "REF 1", "YAN 0.0 &", "  10.0", "SO 0.0 0.1e14"]
    for s in lens.surfaces:
        shape = s.curvature_per_mm if curvatures else (0.0 if math.isinf(s.radius_mm) else s.radius_mm)
        digits = f"{s.index!r}"[2:].ljust(6, "0")
        glass = f" {digits}.500000" if s.index != 1 else ""
        lines += [f"S {shape!r} {s.thickness_mm!r}{glass}", *(["  STO"] if s.is_stop else [])]
        powers = _powers(s)
        lines += ["  ASP" if powers else "  CON", f"  K {s.conic!r}"] if powers or s.conic else []
        lines += [f"  {'ABCDEFGHJ'[p // 2 - 2]} {a!r}; AC 100" for p, a in powers.items()]
        lines.append(f"  CIR {s.semi_diameter_mm!r}; CCY 0")
        if s.inner_semi_diameter_mm:
            lines.append(f"  CIR OBS {s.inner_semi_diameter_mm!r}")
        if s.half_widths_mm:
            lines.append(f"  REX {s.half_widths_mm[0]!r}; REY {s.half_widths_mm[1]!r}; ARO {s.aperture_rotation_deg!r}")
    return ("\n".join([*lines, "SI 0.0 0.0", "GO"]) + "\n").encode()


def _powers(surface: Surface) -> dict[int, float]:
    """Coefficients of an asphere by their powers, without zeros."""
    even, odd = surface.even_coefficients, surface.odd_coefficients
    terms = {2 * i + 2: a for i, a in enumerate(even)} | {2 * i + 3: a for i, a in enumerate(odd)}
    return {power: a for power, a in sorted(terms.items()) if a}


def pbrt(lens: Prescription, spacing: str = "after") -> bytes:
    """A lens table of pbrt: full diameters, radius 0 and index 0 at the stop, spaces before or after."""
    lines = ["# Round trip", "# radius thickness n diameter"]
    before = 0.0
    for s in lens.surfaces:
        radius = 0 if math.isinf(s.radius_mm) else s.radius_mm
        thickness = before if spacing == "before" else s.thickness_mm
        index = 0 if s.is_stop else s.index
        lines.append(f"{radius!r}\t{thickness!r}\t{index!r}\t{2 * s.semi_diameter_mm!r}")
        before = s.thickness_mm
    return ("\n".join(lines) + "\n").encode()


def blender(lens: Prescription) -> bytes:
    """A lens table of the Blender add-on: empty radii for planes, 0 or nothing for the index of air."""
    lines = ["radius;thickness;material;index;v-no;sa"]
    for s in lens.surfaces:
        radius = "" if math.isinf(s.radius_mm) else repr(s.radius_mm)
        material = "air;;" if s.index == 1 else f"GLASS;{s.index!r};50.0"
        lines.append(f"{radius};{s.thickness_mm!r};{material};{s.semi_diameter_mm!r}  ")
    return ("\r\n".join([*lines, ";;;;;"]) + "\r\n").encode()


def optical_bench(lens: Prescription) -> bytes:
    """A text of the Optical Bench: tabs, whole diameters, AS for the radius of the stop."""
    lines = ["[descriptive data]", "title\tRound trip", "[variable distances]", "F-Number\t2", "[lens data]"]
    for i, s in enumerate(lens.surfaces, 1):
        radius = "AS" if s.is_stop else "Infinity" if math.isinf(s.radius_mm) else repr(s.radius_mm)
        glass = f"{s.index!r}\t{2 * s.semi_diameter_mm!r}\t50.0" if s.index != 1 else f"\t{2 * s.semi_diameter_mm!r}"
        lines.append(f"{i}\t{radius}\t{s.thickness_mm!r}\t{glass}")
    return ("\n".join(lines) + "\n").encode()
