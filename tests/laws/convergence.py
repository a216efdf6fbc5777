"""Orders of convergence, observed."""

import numpy as np


def orders(errors: list[float]) -> np.ndarray:
    """Observed orders of convergence of errors whose step halves each time."""
    return np.log2(np.abs(errors[:-1]) / np.abs(errors[1:]))
