"""Reader and checks of microlens arrays."""

from collections.abc import Iterator, Set

from pxr import Sdf, Usd

from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.tracing.microlens_tables import element_tables
from pipeline.errors import PipelineError
from pipeline.optics.glass import row
from pipeline.optics.glass.medium import GlassError, OutOfRange
from pipeline.optics.printed import D_LINE_NM
from pipeline.scene.usd.problems import Problem, of_reader, problem, warning
from pipeline.scene.usd.values import UnreadableValue, fields_of, need, read

_ANY_DISTANCE_MM = 1.0
"""Distance from the sensor of an array without a camera [mm]: no check of an array alone depends on it."""
_NOMINAL = 0.01
"""Relative deviation of a focal length from that of the faces above which there is a warning."""
_NEAREST = 0.1
"""Least distance of the microlenses from the sensor over their pitch: in air no lens is faster than f/0.5."""


def read_microlenses(prim: Usd.Prim, distance_mm: float, wavelength_nm: float) -> MicrolensArray:
    """The record of a PlenMicrolensArray at a distance from the sensor, at the wavelength of a camera."""
    model = need(prim, "plen:model")
    offset_x_mm, offset_y_mm = need(prim, "plen:offset")
    tilt_x_deg, tilt_y_deg = need(prim, "plen:tilt")
    return MicrolensArray(
        distance_mm=distance_mm,
        focal_lengths_mm=() if model == "refractive" else need(prim, "plen:focalLengths"),
        index=None if model == "thin" else microlens_index(prim, wavelength_nm),
        offset_x_mm=offset_x_mm,
        offset_y_mm=offset_y_mm,
        tilt_x_deg=tilt_x_deg,
        tilt_y_deg=tilt_y_deg,
        **fields_of(prim, MicrolensArray),
    )


def microlens_index(prim: Usd.Prim, wavelength_nm: float) -> float:
    """Index of the microlenses at a wavelength, of their glass or as printed; GlassError if the glass has none."""
    glass = need(prim, "plen:glass")
    if not glass:
        return float(need(prim, "plen:index"))
    return row.medium(glass=glass, index=None, abbe=None, wavelength_nm=wavelength_nm).index(wavelength_nm)


def attribute_per_type(array: Usd.Prim) -> str:
    """The attribute of a PlenMicrolensArray with an entry for each type of its microlenses."""
    return "plen:frontRadii" if read(array, "plen:model") == "refractive" else "plen:focalLengths"


def check_microlenses(array: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of a PlenMicrolensArray as a whole; `wrong` holds the prims with wrong values."""
    parts = [*_check_extent(array), *_check_types(array), *_check_index(array)]
    yield from parts
    if parts or array.GetPath() in wrong:
        return
    try:
        record = read_microlenses(array, _ANY_DISTANCE_MM, D_LINE_NM)
        element_tables(record)
    except GlassError as error:
        yield problem(array.GetAttribute("plen:glass"), error.code, error.message, hint=error.hint)
    except UnreadableValue as error:
        yield of_reader(array, error)
    except PipelineError as error:
        yield problem(array, "microlens-array", error.message, hint=error.hint)
    else:
        if record.model == "refractive":
            yield from _check_nominal(array, record.focal_lengths_mm)


def check_near_microlenses(camera: Usd.Prim, array: Usd.Prim) -> Iterator[Problem]:
    """A problem if the microlenses are so near to the sensor that light would have to leave them sideways."""
    distance_mm, pitch_mm = read(camera, "plen:camera:microlensDistance"), read(array, "plen:pitch")
    if distance_mm is not None and pitch_mm is not None and distance_mm < _NEAREST * pitch_mm:
        message = f"microlenses of pitch {pitch_mm:g} mm are only {distance_mm:g} mm before the sensor"
        hint = f"at least {_NEAREST:g} of the pitch; is one of both in other units than mm?"
        yield problem(camera.GetAttribute("plen:camera:microlensDistance"), "near-microlenses", message, hint=hint)


def check_microlens_glass(camera: Usd.Prim, array: Usd.Prim) -> Iterator[Problem]:
    """Problems of a camera's wavelength and the glass of its microlenses; `check_microlenses` reports all others."""
    wavelength_nm = read(camera, "plen:camera:wavelength")
    if read(array, "plen:model") != "refractive" or not read(array, "plen:glass") or wavelength_nm is None:
        return
    try:
        microlens_index(array, wavelength_nm)
    except OutOfRange as error:
        hint = "choose a wavelength at which the glass of the microlenses is known"
        yield problem(camera.GetAttribute("plen:camera:wavelength"), error.code, error.message, hint=hint)
    except GlassError as error:
        yield problem(array.GetAttribute("plen:glass"), error.code, error.message, hint=error.hint)


def _check_extent(array: Usd.Prim) -> Iterator[Problem]:
    """A problem of an array whose size is not stated, or twice."""
    names = ("width", "height", "columns", "rows")
    width, height, columns, rows = (array.GetAttribute(f"plen:{name}").HasAuthoredValue() for name in names)
    if (width or height) and (columns or rows):
        message = '"plen:width" and "plen:height" state the size of the array, and so do "plen:columns" and "plen:rows"'
        at = array.GetAttribute("plen:columns" if columns else "plen:rows")
        yield problem(at, "array-extent", message, hint="keep one pair of them")
    elif not (width and height) and not (columns and rows):
        message = f'{array.GetTypeName()} needs "plen:width" and "plen:height", or "plen:columns" and "plen:rows"'
        yield problem(array, "array-extent", message, hint="width and height count mm, columns and rows microlenses")


def _check_types(array: Usd.Prim) -> Iterator[Problem]:
    """Problems of the arrangement of microlens types: no rule for it, or a table that does not fit."""
    table = array.GetAttribute("plen:typeTable")
    period = read(array, "plen:typePeriod")
    if bool(read(array, "plen:typeTable")) != bool(period):
        return  # one without the other is reported elsewhere
    name = attribute_per_type(array)
    is_square = read(array, "plen:layout") == "square"
    count = len(read(array, name) or ())
    if not count:
        return  # reported as missing
    if not period:
        if count != 1 and (count != 3 or is_square):
            layout = "square" if is_square else "hexagonal"
            message = f"{count} microlens types on a {layout} lattice, and no rule which lens has which"
            rules = "1 type" if is_square else "1 type, and 3"
            hint = f"there are rules for {rules}; else write plen:typeTable and plen:typePeriod"
            if count == 2:
                both = ("[0, 1, 1, 0]", "(2, 2)") if is_square else ("[0, 1]", "(1, 2)")
                pattern = "a checkerboard" if is_square else "rows in turn"
                hint += f", for {pattern} plen:typeTable = {both[0]} and plen:typePeriod = {both[1]}"
            yield problem(array.GetAttribute(name), "microlens-types", message, hint=hint)
        return
    along, across = period
    values = read(array, "plen:typeTable")
    if len(values) != along * across:
        message = f'"plen:typeTable" has {len(values)} entries for a period of {along} x {across}'
        yield problem(table, "microlens-types", message, hint=f"write {along * across}, those of l = 0 first")
    elif differing := set(values) ^ set(range(count)):
        beyond = [kind for kind in differing if not 0 <= kind < count]
        fault = f"names type {min(beyond)}" if beyond else f"leaves out type {min(differing)}"
        yield problem(table, "microlens-types", f'"plen:typeTable" {fault} of {count} types, counted from 0')


def _check_index(array: Usd.Prim) -> Iterator[Problem]:
    """Problems of refractive microlenses without an index, or with two."""
    if read(array, "plen:model") != "refractive":
        return
    has_index = read(array, "plen:index") is not None
    has_glass = bool(read(array, "plen:glass"))
    if not (has_index or has_glass):
        message = 'microlenses of the model "refractive" need "plen:index" or "plen:glass"'
        yield problem(array, "missing-value", message, hint="they have no fallback: write one of them")
    if has_index and has_glass:
        message = '"plen:index" and "plen:glass" both give the index of the microlenses'
        yield problem(array.GetAttribute("plen:index"), "two-indices", message, hint="keep one of them")


def _check_nominal(array: Usd.Prim, derived: tuple[float, ...]) -> Iterator[Problem]:
    """Problems of stated focal lengths that are not those derived from the faces."""
    attribute = array.GetAttribute("plen:focalLengths")
    stated = read(array, "plen:focalLengths") or ()
    if stated and len(stated) != len(derived):
        message = f'"plen:focalLengths" has {len(stated)} entries, and the faces make {len(derived)} types'
        yield problem(attribute, "microlens-types", message)
        return
    for kind, (nominal, focal) in enumerate(zip(stated, derived, strict=False)):
        if abs(focal / nominal - 1) > _NOMINAL:
            message = (
                f"microlens type {kind} has a nominal focal length of {nominal:g} mm, but its faces give {focal:.6g} mm"
            )
            hint = "the faces are traced; is a radius, the index or the thickness mistyped?"
            yield warning(attribute, "focal-length", message, hint=hint)
