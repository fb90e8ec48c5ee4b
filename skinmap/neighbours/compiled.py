"""The loop that matches neighbourhoods with prototypes, compiled by numba where it pays."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from skinmap.errors import MissingLibraryError

PAYS = 20_000_000  # combinations; below, the import of numba costs more than it saves
Kernel = Callable[..., Any]


def match_kernel(combinations: int, compiled: bool | None) -> Kernel | None:
    """The compiled loop, or None where plain numpy is to be used.

    Raises
    ------
    MissingLibraryError
        Asked for, but numba is not installed.
    """
    there = "numba" in sys.modules or (
        (compiled or combinations >= PAYS) and importlib.util.find_spec("numba") is not None
    )
    if compiled and not there:
        raise MissingLibraryError("compiled matching needs the package numba: pip install numba")
    return _compile() if there and compiled is not False else None


@cache
def _compile() -> Kernel:
    import numba

    try:
        return numba.njit(_match, cache=True, nogil=True)
    except RuntimeError:  # nowhere to keep the machine code
        return numba.njit(_match, nogil=True)


def _match(
    rows: Any, offsets: Any, held: Any, musts: Any, must: Any, alone: Any, raster: Any,
    places: Any, count: Any, needed: Any, required: Any, weight: Any, masks: Any,
    reach2: float, margin: float, cost: Any, stray: Any, turn: Any,
) -> None:  # fmt: skip
    """Fill cost, stray and turn (r, s); the same steps as `matching.pairing`, one by one."""
    width, depth = offsets.shape[1], places.shape[2]
    partner, gap = np.empty(depth, np.int64), np.empty(depth)
    place, near = np.empty(width, np.int64), np.empty(width)
    for line in range(len(rows)):
        r = rows[line]
        for s in range(places.shape[0]):
            if musts[r] > count[s] or held[r] < needed[s]:
                continue
            for t in range(places.shape[1]):
                fits = True
                for p in range(count[s]):
                    if required[s, p]:
                        hit = False
                        for w in range(raster.shape[1]):
                            if raster[r, w] & masks[s, t, p, w]:
                                hit = True
                        if not hit:
                            fits = False
                            break
                if not fits:
                    continue
                for j in range(held[r]):
                    near[j] = np.inf
                    place[j] = 0
                for p in range(count[s]):
                    gap[p] = np.inf
                    partner[p] = 0
                    for j in range(held[r]):
                        x = offsets[r, j, 0] - places[s, t, p, 0]
                        y = offsets[r, j, 1] - places[s, t, p, 1]
                        d = x * x + y * y
                        if d < gap[p]:
                            gap[p], partner[p] = d, j
                        if d < near[j]:
                            near[j], place[j] = d, p
                total, lone, number = 0.0, 0.0, 0
                for p in range(count[s]):
                    if gap[p] <= reach2 and place[partner[p]] == p:
                        total += gap[p]
                        number += 1
                    elif required[s, p]:
                        fits = False
                        break
                    else:
                        lone += weight[s, p]
                if not fits:
                    continue
                for j in range(held[r]):
                    p = place[j]
                    if not (near[j] <= reach2 and count[s] > 0 and partner[p] == j):
                        if must[r, j]:
                            fits = False
                            break
                        lone += alone[r, j]
                if not fits:
                    continue
                mean = total / max(number, 1)
                value = mean / reach2 + lone
                if value < cost[line, s] - margin:
                    cost[line, s], stray[line, s], turn[line, s] = value, mean, t
