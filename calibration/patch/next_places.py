"""Which taxel to measure next: the one whose place tells most about all the others."""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray, IntArray


def best_next(joint: FloatArray, sigma: float, count: int) -> IntArray:
    """Taxels (count,) to measure, best first, each given the ones before.

    Measuring the place of taxel t with a standard deviation of sigma [m] a coordinate takes
    tr(J[:, t] (J[t, t] + sigma^2 I)^-1 J[t, :]) off the summed variance of all taxels.

    Parameters
    ----------
    joint : (n, 3, n, 3) float
        Joint covariance J of all positions [m2].
    """
    n = len(joint)
    rest = np.array(joint.reshape(3 * n, 3 * n))
    chosen: list[int] = []
    for _ in range(min(count, n)):
        columns = rest.reshape(3 * n, n, 3)
        gram = np.einsum("itk,itl->tkl", columns, columns)
        own = rest.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n), :] + sigma**2 * np.eye(3)
        gain = np.einsum("tkk->t", np.linalg.solve(own, gram))
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        column = columns[:, best]
        rest = rest - column @ np.linalg.solve(own[best], column.T)
    return np.array(chosen, np.int64)
