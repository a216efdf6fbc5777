"""The verb `pipeline design plenoptic`."""

from typing import Annotated, Literal

import typer

from pipeline.app.verbs.authoring import FocalLength, LensOfRig, NewFile, SensorOfRig, lens_of_rig
from pipeline.app.verbs.terminal import WRITE, Json, Verb, new_family, note, say, say_json, valued

verbs = new_family()
designs = new_family(help="Design cameras from their requirements, and judge them by real rays.")
verbs.add_typer(designs, name="design", rich_help_panel=WRITE)


@designs.command("plenoptic", cls=Verb)
def plenoptic(
    out: NewFile,
    sensor: SensorOfRig,
    lens: LensOfRig = None,
    focal_length: FocalLength = None,
    near: Annotated[float | None, valued("MM", "Near end of the depth of field, from the stop.", min=0)] = None,
    far: Annotated[float | None, valued("MM", "Far end of the depth of field; inf.", min=0)] = None,
    magnification: Annotated[
        float | None, valued("M", "Instead of a range: of the main lens, in its middle.", min=1e-6, max=1e6)
    ] = None,
    types: Annotated[int | None, valued("N", "Focal lengths of the microlenses, 1 or 3; else 3.")] = None,
    unfocused: Annotated[
        bool, typer.Option("--unfocused", help="Microlenses at their focal length, of one type: plenoptic 1.0.")
    ] = False,
    micro_image: Annotated[float, valued("PX", "Diameter of micro-images.", min=2)] = 20.0,
    layout: Annotated[
        Literal["hexagonal", "hexagonal-columns", "square"], valued("LAYOUT", "Of the microlenses.")
    ] = "hexagonal",
    f_number: Annotated[
        float | None, valued("N", "Of the main lens; else what matches the microlenses.", min=1e-3, max=1e4)
    ] = None,
    virtual_depth: Annotated[float | None, valued("V", "The least one; else 2.", min=1)] = None,
    blur: Annotated[float, valued("PX", "Largest blur that counts as sharp.", min=0.01)] = 1.0,
    as_json: Json = False,
) -> None:
    """Write a plenoptic rig for a depth of field or a magnification, and print its judgement by real rays.

    The page has the depth of field of each type, lateral and depth resolution, micro-images over the field, distances
    of refocusing and viewpoints of views. Formulas design, rays judge.
    """
    from pipeline.plugins.design.formulas import PlenopticWish
    from pipeline.plugins.design.new_plenoptic import new_plenoptic
    from pipeline.plugins.design.page import page, plain

    wish = PlenopticWish(
        near_mm=near,
        far_mm=far,
        magnification=magnification,
        types=types or (1 if unfocused else 3),
        unfocused=unfocused,
        image_px=micro_image,
        layout=layout,
        f_number=f_number,
        virtual_depth=virtual_depth,
        blur_px=blur,
    )
    rig = new_plenoptic(out, lens_of_rig(lens, focal_length), sensor, wish)
    note(*rig.loaded.problems)
    design = rig.design, rig.judgement, rig.loaded.cameras[0].wavelength_nm
    if as_json:
        say_json(plain(*design))
    else:
        say(*page(*design))
    note(f"wrote {out}")
