"""One thing that the skin can show: values with colours, limits and a unit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import SkinMismatchError
from skinmap.live.moment import Moment
from viewer.colours import UNKNOWN, rgb, steps

Values = Callable[[str, Moment | None], FloatArray]


@dataclass(frozen=True, eq=False, slots=True)
class Layer:
    """One thing that the skin can show.

    Attributes
    ----------
    name : str
        One of `viewer.layers.LAYERS`.
    title, unit : str
        What stands at the colour bar; categories have no unit.
    limits : (float, float)
        Values of the table's first and last colour: fixed, so that pictures compare.
    table : (k, 4) uint8
        Colours from low to high, or of each category.
    categories : tuple of str
        Names of the values 0, 1, ... where these have no order; empty otherwise.
    live : bool
        Whether values change from moment to moment.
    missing : str
        Why there are no values, for where all are NaN.
    source : callable
        (part, moment) to (n,) values.
    """

    name: str
    title: str
    unit: str
    limits: tuple[float, float]
    table: NDArray[np.uint8]
    categories: tuple[str, ...]
    live: bool
    missing: str
    source: Values

    def values(self, part: str, moment: Moment | None) -> FloatArray:
        """(n,) what the taxels of a part show; NaN where nothing is known.

        Raises
        ------
        UnknownNameError, SkinMismatchError
            A part that is not there, or a moment of another skin.
        """
        return self.source(part, moment)

    def rows(self, values: FloatArray) -> IntArray:
        """(n,) row of the table for each value (n,); -1 where nothing is known."""
        low, high = self.limits
        k = len(self.table)
        known = np.isfinite(values)
        share = (np.where(known, values, low) - low) / (high - low)
        return np.where(known, np.clip(np.floor(share * k), 0, k - 1), -1).astype(np.int64)

    def colours(self, values: FloatArray) -> NDArray[np.uint8]:
        """(n, 3) red, green and blue for values (n,), 0 to 255."""
        unknown = np.rint(rgb(UNKNOWN) * 255).astype(np.uint8)
        return np.vstack([self.table[:, :3], unknown])[self.rows(values)]


def categories(
    name: str,
    title: str,
    names: tuple[str, ...],
    colours: tuple[str, ...],
    source: Values,
    *,
    live: bool = False,
) -> Layer:
    """A layer of names without an order, each in its colour."""
    limits = (-0.5, len(names) - 0.5)
    return Layer(name, title, "", limits, steps(colours), names, live, "nothing known", source)


def check_values(values: ArrayLike, n: int, part: str) -> FloatArray:
    """Values (n,) as float64; infinite ones become NaN, as they say nothing.

    Raises
    ------
    SkinMismatchError
        Another number of values than the skin has taxels, or words.
    """
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise SkinMismatchError(f"values of {part!r} are no numbers") from error
    if array.shape != (n,):
        raise SkinMismatchError(f"pressures of shape {array.shape} for the {n} taxels of {part!r}")
    return array if np.isfinite(array).all() else np.where(np.isfinite(array), array, np.nan)
