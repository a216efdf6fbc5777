"""Images in passes, until they have as little noise as asked for.

The first pass takes some samples of each replica, and every further one as many as all before it together. So the
samples of a pass continue the Sobol sequence of those before, and after each pass they are evenly spread again.
Replicas are scrambled independently of each other: how far their images differ says how much noise their mean has,
which a single evenly spread sequence cannot tell.
"""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.records.shapes import Float64

_REPLICA_STEP = 0x85EBCA77
"""Distance of the seeds of two replicas [1]: a prime of xxHash, so large that small seeds of wavelengths never meet."""
_SEED_BITS = 0xFFFFFFFF
"""Bits of a seed that count [1]."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Samples of one replica that one pass takes."""

    first: int  # samples of the first pass through a microlens, a power of two
    number: int = 0  # the pass, from 0
    replica: int = 0

    @property
    def samples(self) -> int:
        """Samples of this pass: the first ones, or as many as of all passes before."""
        return self.first << max(0, self.number - 1)

    @property
    def end(self) -> int:
        """Samples of all passes up to this one."""
        return self.first << self.number

    def seed(self, of_camera: int) -> int:
        """The seed of the replica's random numbers; of the first replica it is the camera's own."""
        return (of_camera + self.replica * _REPLICA_STEP) & _SEED_BITS


def batch_of(samples: int | Batch) -> Batch:
    """A number of samples as the only batch."""
    return samples if isinstance(samples, Batch) else Batch(samples)


def joined(before: Float64[np.ndarray, "..."] | None, now: Float64[np.ndarray, "..."]) -> np.ndarray:
    """Means over all samples so far, from those over all passes before and over this one, which has as many."""
    return now if before is None else 0.5 * (before + now)


def standard_error(replicas: Float64[np.ndarray, "replicas ..."]) -> np.ndarray:
    """Standard error of the mean of independent images, (...), pixel by pixel; its square has no bias."""
    return np.std(replicas, axis=0, ddof=1) / math.sqrt(len(replicas))  # type: ignore[no-any-return]


def noise_of(error: Float64[np.ndarray, "..."]) -> float:
    """Root mean square of the standard errors of all pixels that have any; 0 if none has."""
    some = error[error > 0]
    return float(np.sqrt(np.mean(some**2))) if len(some) else 0.0
