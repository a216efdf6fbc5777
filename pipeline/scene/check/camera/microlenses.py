"""A microlens array whose attributes do not fit each other, or that cannot exist."""

from collections.abc import Iterator

from pxr import Usd

from pipeline.camera.tracing.microlens_tables import element_tables
from pipeline.errors import PipelineError
from pipeline.optics.glass.errors import GlassError, OutOfRange
from pipeline.scene.read.microlenses import FACES, microlens_index, read_microlenses
from pipeline.scene.usd.problems import Problem
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.values import UnreadableValue, read

_D_LINE_NM = 587.56
_ANY_DISTANCE_MM = 1.0
_NOMINAL = 0.01
"""Largest relative deviation of a focal length from that of the faces without a warning."""

_NEAREST = 0.1
"""Least distance of the microlenses from the sensor over their pitch: in air no lens is faster than f/0.5."""

_NEEDS = {
    "thin": ("plen:focalLengths",),
    "two-plane": ("plen:focalLengths", "plen:index", "plen:thickness"),
    "refractive": ("plen:frontRadii", "plen:rearRadii", "plen:thickness"),
}
_FOR = {
    "plen:index": ("two-plane", "refractive"),
    "plen:thickness": ("two-plane", "refractive"),
    "plen:glass": ("refractive",),
    **dict.fromkeys(FACES.values(), ("refractive",)),
}


def check_microlenses(array: Usd.Prim) -> Iterator[Problem]:
    """Problems of a PlenMicrolensArray as a whole."""
    parts = [*_check_extent(array), *_check_types(array), *_check_model(array), *_check_disc(array)]
    yield from parts
    if parts:
        return
    try:
        record = read_microlenses(array, _ANY_DISTANCE_MM, _D_LINE_NM)
        element_tables(record)
    except GlassError as error:
        yield problem(array.GetAttribute("plen:glass"), error.code, error.what, hint=error.hint)
    except UnreadableValue:
        return  # reported as a missing value or a wrong type
    except PipelineError as error:
        yield problem(array, "microlens-array", error.what, hint=error.hint)
    else:
        if record.model == "refractive":
            yield from _check_nominal(array, record.focal_lengths_mm)


def check_near_microlenses(camera: Usd.Prim, array: Usd.Prim) -> Iterator[Problem]:
    """Microlenses so near to the sensor that light would have to leave them sideways."""
    distance_mm, pitch_mm = read(camera, "plen:camera:microlensDistance"), read(array, "plen:pitch")
    if distance_mm is not None and pitch_mm is not None and distance_mm < _NEAREST * pitch_mm:
        message = f"microlenses of pitch {pitch_mm:g} mm stand only {distance_mm:g} mm before the sensor"
        hint = f"at least {_NEAREST:g} of the pitch; is one of both in other units than mm?"
        yield problem(camera.GetAttribute("plen:camera:microlensDistance"), "near-microlenses", message, hint=hint)


def check_microlens_glass(camera: Usd.Prim, array: Usd.Prim) -> Iterator[Problem]:
    """The light of a camera against what is known of the glass of its microlenses; `check_microlenses` names others."""
    wavelength_nm = read(camera, "plen:camera:wavelength")
    if read(array, "plen:model") != "refractive" or not read(array, "plen:glass") or wavelength_nm is None:
        return
    try:
        microlens_index(array, wavelength_nm)
    except OutOfRange as error:
        hint = "choose a wavelength at which the glass of the microlenses is known"
        yield problem(camera.GetAttribute("plen:camera:wavelength"), error.code, error.what, hint=hint)
    except GlassError:
        return


def _check_extent(array: Usd.Prim) -> Iterator[Problem]:
    has = {
        name: array.GetAttribute(f"plen:{name}").HasAuthoredValue() for name in ("width", "height", "columns", "rows")
    }
    extent, count = has["width"] or has["height"], has["columns"] or has["rows"]
    if extent and count:
        message = '"plen:width" and "plen:height" say how large the array is, and so do "plen:columns" and "plen:rows"'
        name = "columns" if has["columns"] else "rows"
        yield problem(array.GetAttribute(f"plen:{name}"), "array-extent", message, hint="keep one pair of them")
    elif not (has["width"] and has["height"]) and not (has["columns"] and has["rows"]):
        message = f'{array.GetTypeName()} needs "plen:width" and "plen:height", or "plen:columns" and "plen:rows"'
        yield problem(array, "array-extent", message, hint="width and height count mm, columns and rows microlenses")


def _check_types(array: Usd.Prim) -> Iterator[Problem]:
    table, period = array.GetAttribute("plen:typeTable"), array.GetAttribute("plen:typePeriod")
    if bool(read(array, "plen:typeTable")) != period.HasAuthoredValue():
        message = '"plen:typeTable" and "plen:typePeriod" go together'
        yield problem(period if period.HasAuthoredValue() else table, "microlens-types", message)
        return
    refractive = read(array, "plen:model") == "refractive"
    name = "plen:frontRadii" if refractive else "plen:focalLengths"
    count, square = len(read(array, name) or ()), read(array, "plen:layout") == "square"
    if not count:
        return  # reported as missing
    if not period.HasAuthoredValue():
        if count != 1 and (count != 3 or square):
            where = "square" if square else "hexagonal"
            message = f"{count} microlens types on a {where} lattice, and no rule which lens has which"
            known = "1 type" if square else "1 type, and 3"
            hint = f"there are rules for {known}; else write plen:typeTable and plen:typePeriod"
            if count == 2:
                table, period = ("[0, 1, 1, 0]", "(2, 2)") if square else ("[0, 1]", "(1, 2)")
                how = "a checkerboard" if square else "rows in turn"
                hint += f", for {how} plen:typeTable = {table} and plen:typePeriod = {period}"
            yield problem(array.GetAttribute(name), "microlens-types", message, hint=hint)
        return
    (along, across), values = read(array, "plen:typePeriod") or (0, 0), read(array, "plen:typeTable")
    if len(values) != along * across:
        message = f'"plen:typeTable" has {len(values)} entries for a period of {along} x {across}'
        yield problem(table, "microlens-types", message, hint=f"write {along * across}, those of l = 0 first")
    elif set(values) != set(range(count)):
        missing = sorted(set(range(count)) - set(values))
        beyond = sorted(set(values) - set(range(count)))
        what = f"names type {beyond[0]}" if beyond else f"leaves out type {missing[0]}"
        yield problem(table, "microlens-types", f'"plen:typeTable" {what} of {count} types, counted from 0')


def _check_model(array: Usd.Prim) -> Iterator[Problem]:
    model = read(array, "plen:model")
    if model not in _NEEDS:
        return  # reported as a bad token
    needs = [name for name in _NEEDS[model] if not read(array, name)]
    has_index, has_glass = read(array, "plen:index") is not None, bool(read(array, "plen:glass"))
    for name in needs:
        message = f'microlenses of the model "{model}" need "{name}"'
        yield problem(array, "missing-value", message, hint="it has no fallback: write it")
    if model == "refractive" and not (has_index or has_glass):
        message = 'microlenses of the model "refractive" need "plen:index" or "plen:glass"'
        yield problem(array, "missing-value", message, hint="they have no fallback: write one of them")
    if model == "refractive" and has_index and has_glass:
        message = '"plen:index" and "plen:glass" both give the index of the microlenses'
        yield problem(array.GetAttribute("plen:index"), "two-indices", message, hint="keep one of them")
    for name, models in _FOR.items():
        attribute = array.GetAttribute(name)
        if attribute.HasAuthoredValue() and model not in models:
            message = f'"{name}" means nothing to microlenses of the model "{model}"'
            yield problem(attribute, "unused-value", message, hint=f"it belongs to: {', '.join(models)}")


def _check_disc(array: Usd.Prim) -> Iterator[Problem]:
    attribute = array.GetAttribute("plen:discDiameter")
    is_disc = read(array, "plen:aperture") == "disc"
    if is_disc and not attribute.HasAuthoredValue():
        message = 'the aperture "disc" needs "plen:discDiameter"'
        yield problem(array, "missing-value", message, hint="it has no fallback: write it")
    elif attribute.HasAuthoredValue() and not is_disc:
        message = '"plen:discDiameter" means nothing without plen:aperture = "disc"'
        yield problem(attribute, "unused-value", message)


def _check_nominal(array: Usd.Prim, derived: tuple[float, ...]) -> Iterator[Problem]:
    attribute, stated = array.GetAttribute("plen:focalLengths"), read(array, "plen:focalLengths") or ()
    if stated and len(stated) != len(derived):
        message = f'"plen:focalLengths" has {len(stated)} entries, and the faces make {len(derived)} types'
        yield problem(attribute, "microlens-types", message)
        return
    for kind, (nominal, focal) in enumerate(zip(stated, derived, strict=False)):
        if abs(focal / nominal - 1) > _NOMINAL:
            message = f"microlens type {kind} goes by {nominal:g} mm, but its faces make {focal:.6g} mm"
            hint = "the faces are traced; is a radius, the index or the thickness mistyped?"
            yield problem(attribute, "focal-length", message, hint=hint, severity="warning")
