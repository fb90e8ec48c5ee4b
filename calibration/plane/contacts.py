"""Presses of skin on flat surfaces: in which pose, and which taxels felt them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, check_whole, freeze
from skinmap.errors import InvalidArrayError


@dataclass(frozen=True, eq=False, slots=True)
class PlaneContacts:
    """Presses on one or more flat surfaces that do not move.

    Attributes
    ----------
    angles : (m, j) float
        Joint angles of the robot at each press [rad, m].
    active : mapping of str to (m, n) bool
        Of each patch, which taxels felt each press.
    surface : (m,) int
        Which surface was pressed, from 0; one by default.
    """

    angles: FloatArray
    active: Mapping[str, BoolArray]
    surface: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        angles = check_finite(self.angles, "angles", (None, None))
        m = len(angles)
        active = {}
        for name, given in self.active.items():
            felt = np.asarray(given)
            if felt.dtype != np.bool_ or felt.ndim != 2 or len(felt) != m:
                raise InvalidArrayError(
                    f"active taxels of {name!r} must be true or false of shape ({m}, n), "
                    f"got {felt.dtype} {felt.shape}"
                )
            active[name] = np.array(felt)
            active[name].flags.writeable = False
        surface = check_whole(self.surface, "surface")
        if len(surface) == 0 < m:
            surface = np.zeros(m, np.int64)
        if surface.shape != (m,) or surface.min(initial=0) < 0:
            raise InvalidArrayError(f"surface must be {m} whole numbers from 0")
        freeze(self, angles=angles, surface=surface)
        object.__setattr__(self, "active", active)

    def __len__(self) -> int:
        return len(self.angles)

    def subset(self, rows: BoolArray | IntArray) -> PlaneContacts:
        """Some of the presses."""
        active = {name: felt[rows] for name, felt in self.active.items()}
        return PlaneContacts(self.angles[rows], active, self.surface[rows])

    def joined(self, more: PlaneContacts) -> PlaneContacts:
        """These presses and more of the same patches."""
        return PlaneContacts(
            np.concatenate([self.angles, more.angles]),
            {name: np.concatenate([felt, more.active[name]]) for name, felt in self.active.items()},
            np.concatenate([self.surface, more.surface]),
        )


@dataclass(frozen=True, eq=False, slots=True)
class Plane:
    """A flat surface in the frame of the robot's base.

    Attributes
    ----------
    point : (3,) float
        Any point of it [m].
    normal : (3,) float
        Unit, towards the side that the robot is on.
    """

    point: FloatArray
    normal: FloatArray

    def __post_init__(self) -> None:
        point = check_finite(self.point, "point of the plane", (3,))
        normal = check_finite(self.normal, "normal of the plane", (3,))
        length = float(np.linalg.norm(normal))
        if length < 1e-9:
            raise InvalidArrayError("the normal of the plane has no length")
        freeze(self, point=point, normal=normal / length)

    def height(self, points: FloatArray) -> FloatArray:
        """Signed distances (...,) of points (..., 3) above the surface [m]."""
        return np.asarray((points - self.point) @ self.normal)
