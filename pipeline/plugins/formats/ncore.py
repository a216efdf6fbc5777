"""NCore of NVIDIA: the model of each camera as JSON, with the type and parameters of its sequence stores.

NCore keeps poses and images in stores of its own, which its data converters write.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.exports.material import CentralModel, ExportCamera, Material
from pipeline.files.jsonfile import Json, write_json
from pipeline.formats import Cameras, Centre, Format, Origin, Reads

FORMAT = Format(
    consumer="NCore of NVIDIA: from_dict of its camera model parameters",
    note="opencv-pinhole or opencv-fisheye, behind a bivariate-windshield if there are windows",
    source="proof: nvidia-ncore 19.8.3",
    cameras=Cameras.CONVENTIONAL,
    reads=frozenset({Reads.RAYS}),
    files=("<camera>.json",),
    origin=Origin.HALF,
    centre=Centre.CENTRAL,
    models=("fisheye", "rational"),
)

_BEYOND = 1.01
"""Largest projected angle over that of the rays of the image [1]: the rays of its corners have to pass."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Windshield:
    """Windows before a camera as polynomials of angles."""

    polynomials: dict[str, np.ndarray]  # (21,) each, by the names of NCore
    planes_mm: tuple[float, float]  # vision z of the planes on which residuals hold
    lens_rms_px: float  # residual of the lens without its windows
    inverse_max_px: float  # largest residual where the inverse polynomials, and then the others, lead
    infinity_max_px: float  # largest residual of points far away, for which nothing is fitted


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelBehindWindows(CentralModel):
    """The model of a lens, with the windshield before it, and the residual of both."""

    windshield: Windshield


def central_model(camera: ExportCamera, models: tuple[str, ...]) -> CentralModel:
    """The model of a lens, behind a windshield if there are windows before it."""
    from pipeline.exports.central import central_model as lens_model  # both load the tracer
    from pipeline.plugins.formats.windshield import windshield_model

    if "windows" in camera.built.record["lens"]:
        return windshield_model(camera, ("brown", *models))
    return lens_model(camera, models)


def write(material: Material, folder: Path) -> None:
    """Write a file per camera."""
    for camera in material.cameras:
        kind, own = _type_and_parameters(camera.image_model)
        windshield, remarks = _windshield(camera.image_model)
        write_json(
            folder / f"{camera.name}.json",
            {
                "about": [*material.remarks, *remarks],
                "camera_model_type": kind,
                "camera_model_parameters": {
                    **_common(camera),
                    "external_distortion_parameters": windshield,
                    **own,
                },
            },
        )


def _common(camera: ExportCamera) -> Json:
    return {
        "resolution": list(camera.size_px),
        "shutter_type": camera.shutter_type,
        "principal_point": camera.image_model.principal_point_px,
        "focal_length": camera.image_model.focal_px,
    }


def _windshield(model: CentralModel) -> tuple[Json | None, list[str]]:
    """The windows before a camera, and remarks about them."""
    if not isinstance(model, ModelBehindWindows):
        return None, []
    windshield = model.windshield
    near_mm, far_mm = windshield.planes_mm
    remark = (
        f"points beyond the windows, at vision z = {near_mm:g} and {far_mm:g} mm, are off by {model.rms_px:.3g} px "
        f"rms, {model.max_px:.3g} px at most; far away by {windshield.infinity_max_px:.3g} px at most"
    )
    kind = {"external_distortion_type": "bivariate-windshield", "reference_poly": "FORWARD"}
    return {**kind, **windshield.polynomials}, [remark]


def _type_and_parameters(model: CentralModel) -> tuple[str, Json]:
    """The type of a model, and the parameters that are its own."""
    if model.name == "fisheye":
        assert model.widest_deg is not None
        return "opencv-fisheye", {
            "radial_coeffs": model.coefficients,
            "max_angle": math.radians(model.widest_deg) * _BEYOND,
        }
    k1, k2, p1, p2, k3, *rational = model.coefficients.tolist()
    return "opencv-pinhole", {
        "radial_coeffs": [k1, k2, k3, *(rational or [0.0] * 3)],
        "tangential_coeffs": [p1, p2],
        "thin_prism_coeffs": [0.0] * 4,
    }
