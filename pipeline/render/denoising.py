"""Pictures without noise, by Open Image Denoise of Intel in the binding of the Mitsuba project."""

from importlib.util import find_spec

import numpy as np

from pipeline.errors import UsageError
from pipeline.records.shapes import Float32


def require_denoiser() -> None:
    """UsageError if the library is not installed."""
    if find_spec("mitsuba_oidn") is None:
        hint = 'pip install "plenoptic-pipeline[denoise]", or leave plen:image:denoised out'
        raise UsageError("mitsuba-oidn is not installed, and denoised previews need it", hint=hint)


def denoised(linear: Float32[np.ndarray, "h w c"]) -> np.ndarray:
    """An image of linear light without its noise, (h, w, c) float32, of one channel or three.

    On one thread of the processor: with more, last digits depend on their number.
    """
    require_denoiser()
    import mitsuba_oidn

    device = mitsuba_oidn.Device(mitsuba_oidn.DeviceType.CPU)
    device.num_threads = 1
    clear = mitsuba_oidn.denoise(np.ascontiguousarray(linear), hdr=True, device=device)
    return np.asarray(clear).reshape(linear.shape)
