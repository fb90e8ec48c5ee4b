"""As-rigid-as-possible maps: rotations per triangle and one linear solve, in turns.

Liu, Zhang, Xu, Gotsman and Gortler, "A Local/Global Approach to Mesh Parameterization",
Symposium on Geometry Processing 2008.
"""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.flat.disc import Disc

ITERATIONS = 5  # from a conformal start: more change the energy's excess by less than 1 %


def rigid_map(disc: Disc, *, iterations: int = ITERATIONS) -> FloatArray:
    """(n, 2) as rigid as possible from the conformal start; that start where it flips."""
    uv = as_rigid_as_possible(disc, disc.conformal, iterations=iterations)
    return uv if disc.is_injective(uv) else disc.conformal


def as_rigid_as_possible(disc: Disc, start: FloatArray, *, iterations: int) -> FloatArray:
    """Flat coordinates (n, 2) after some rounds from a start (n, 2), all with one factor."""
    uv = start
    weights = np.repeat(disc.areas, 2)[:, None]
    for _ in range(iterations):
        turned = closest_rotations((disc.gradient @ uv).reshape(-1, 2, 2)).reshape(-1, 2)
        uv = disc.solve_free(disc.divergence @ (weights * turned))
    return uv


def closest_rotations(maps: FloatArray) -> FloatArray:
    """(m, 2, 2) rotation next to each plane map: its conformal part at unit size."""
    cosine = maps[:, 0, 0] + maps[:, 1, 1]
    sine = maps[:, 0, 1] - maps[:, 1, 0]
    size = np.hypot(cosine, sine)
    size[size == 0.0] = 1.0
    cosine, sine = cosine / size, sine / size
    return np.stack([cosine, sine, -sine, cosine], axis=1).reshape(-1, 2, 2)
