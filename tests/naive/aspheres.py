"""A lens of strong aspheres, as phones have them."""

from pipeline.optics.prescription import Prescription, Surface

PHONE = Prescription(
    surfaces=(
        Surface(
            radius_mm=30.0,
            conic=-0.8,
            even_coefficients=(0.0, 2e-6, -3e-9, 1e-12),
            thickness_mm=8.0,
            index=1.6,
            semi_diameter_mm=14.0,
        ),
        Surface(radius_mm=-80.0, conic=-2.5, thickness_mm=3.0, semi_diameter_mm=14.0),
        Surface(semi_diameter_mm=9.0, is_stop=True, thickness_mm=8.0),
        # A plate that turns from hollow to bulging: the slope changes sign at half its aperture.
        Surface(
            even_coefficients=(-4e-3, 4e-5, 0.0, 2e-10, 0.0, -1e-14),
            odd_coefficients=(1e-4,),
            thickness_mm=3.0,
            index=1.7,
            semi_diameter_mm=10.0,
        ),
        Surface(radius_mm=-200.0, even_coefficients=(0.0, 1e-5), semi_diameter_mm=10.0),
    )
)
