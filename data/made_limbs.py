"""Limbs and boards of the robots that are made here: elliptic cones, and how boards lie on them.

A tapering limb is the frustum of an elliptic cone, whose surface can be laid flat without any
strain: the triangular tiling is rolled up on it, and each board then lies flat in the tangent
plane at its centre. Elsewhere boards are hinged at their shared edges. Boards on a convex body
laid either way never cut each other. Only the two `generate.py` beside this file use it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError
from skinmap.geometry.rigid import plane_turns
from skinmap.geometry.triangles import TriangleMesh, unit

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
SAMPLES = 16384  # chords of a closed directrix: its length is right to 1e-8


@dataclass(frozen=True, eq=False, slots=True)
class EllipticCone:
    """The frustum of a cone over an ellipse, from z = 0 to z = length, smaller at the far end.

    Attributes
    ----------
    a, b : float
        Semi-axes along x and y at z = 0 [m].
    length : float
        [m].
    taper : float
        Size of the section at z = length against that at z = 0, above 0 and below 1.
    """

    a: float
    b: float
    length: float
    taper: float

    def __post_init__(self) -> None:
        if min(self.a, self.b, self.length) <= 0 or not 0 < self.taper < 1:
            raise InvalidArrayError(
                "an elliptic cone needs positive lengths and a taper between 0 and 1, got "
                f"a {self.a}, b {self.b}, length {self.length}, taper {self.taper}"
            )

    @property
    def apex(self) -> float:
        """Height of the apex above z = 0 [m]."""
        return self.length / (1.0 - self.taper)

    def rulings(self, angle: FloatArray) -> FloatArray:
        """(n, 3) unit directions from the apex down to the points of the ellipse at angle (n,)."""
        return unit(
            np.column_stack(
                [self.a * np.cos(angle), self.b * np.sin(angle), np.full(len(angle), -self.apex)]
            )
        )

    def unrolled(
        self, uv: FloatArray, *, angle: float, height: float
    ) -> tuple[FloatArray, FloatArray]:
        """Places on the surface of points in its plane development, and the frames there.

        A cone unrolls isometrically: a ruling's length stays, and the length of the curve that
        the rulings draw on the unit sphere becomes the angle between them.

        Parameters
        ----------
        uv : (n, 2) array of float
            From the origin: u counter-clockwise round the axis, v towards the apex [m].
        angle, height : float
            Where the origin lies: parameter of the ellipse [rad], and z [m].

        Returns
        -------
        positions : (n, 3) array of float
            [m].
        frames : (n, 3, 3) array of float
            Columns: directions of u and v on the surface, outward normal.
        """
        start, _, _ = self._ruling(np.zeros(1), angle)
        reach = (height - self.apex) / start[0, 2]
        u, down = uv[:, 0], reach - uv[:, 1]
        radius = np.hypot(u, down)
        outward, around, normal = self._ruling(np.arctan2(u, down), angle)
        positions = radius[:, None] * outward + [0.0, 0.0, self.apex]
        c, s = (down / radius)[:, None], (u / radius)[:, None]
        frames = np.stack([c * around + s * outward, s * around - c * outward, normal], axis=2)
        return positions, frames

    def _ruling(self, turn: FloatArray, angle: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Ruling, direction round the axis and normal, a developed angle (n,) after `angle`."""
        grid = angle + np.linspace(-np.pi, np.pi, SAMPLES + 1)
        chord = np.linalg.norm(np.diff(self.rulings(grid), axis=0), axis=1)
        developed = np.concatenate([[0.0], np.cumsum(chord)])
        theta = np.interp(turn + developed[SAMPLES // 2], developed, grid)
        outward = self.rulings(theta)
        along = np.column_stack(
            [-self.a * np.sin(theta), self.b * np.cos(theta), np.zeros(len(theta))]
        )
        normal = unit(np.cross(outward, along))  # outward runs down: down x around is outside
        return outward, np.cross(normal, outward), normal

    def mesh(self, *, around: int = 64, along: int = 12, cap: float = 0.5) -> TriangleMesh:
        """Closed mesh with domes on both ends, `cap` times the smaller semi-axis high.

        `around` and `along` count the vertices of a ring and the rings of the tube.
        """
        dome = np.linspace(0.0, np.pi / 2.0, along // 2 + 1)[:-1]
        z = np.linspace(0.0, self.length, along)
        thin = cap * min(self.a, self.b)
        heights = np.concatenate(
            [-thin * np.cos(dome[1:]), z, self.length + self.taper * thin * np.cos(dome[:0:-1])]
        )
        sizes = np.concatenate(
            [np.sin(dome[1:]), 1.0 - z / self.apex, self.taper * np.sin(dome[:0:-1])]
        )
        return revolved(
            np.array([self.a, self.b]),
            heights,
            sizes,
            around,
            (-thin, self.length + self.taper * thin),
        )


def ellipsoid(axes: FloatArray, *, around: int = 64, rings: int = 31) -> TriangleMesh:
    """Closed mesh of an ellipsoid with semi-axes (3,) [m] about the origin."""
    polar = np.linspace(0.0, np.pi, rings + 2)[1:-1]
    heights = -axes[2] * np.cos(polar)
    return revolved(axes[:2], heights, np.sin(polar), around, (-axes[2], axes[2]))


def revolved(
    axes: FloatArray,
    heights: FloatArray,
    sizes: FloatArray,
    around: int,
    poles: tuple[float, float],
) -> TriangleMesh:
    """Closed mesh of elliptic rings from bottom to top, each `sizes` times the semi-axes (2,)."""
    theta = np.arange(around) * (2.0 * np.pi / around)
    circle = np.column_stack([axes[0] * np.cos(theta), axes[1] * np.sin(theta)])
    rings = np.concatenate(
        [
            np.column_stack([size * circle, np.full(around, z)])
            for z, size in zip(heights, sizes, strict=True)
        ]
    )
    vertices = np.concatenate([rings, [[0.0, 0.0, poles[0]], [0.0, 0.0, poles[1]]]])
    first = np.arange(around)
    second = (first + 1) % around
    start = np.arange(len(heights) - 1)[:, None] * around
    low, right = (start + first).ravel(), (start + second).ravel()
    sides = np.concatenate(
        [
            np.column_stack([low, right, right + around]),
            np.column_stack([low, right + around, low + around]),
        ]
    )
    last, bottom = (len(heights) - 1) * around, len(vertices) - 2
    ends = np.concatenate(
        [
            np.column_stack([second, first, np.full(around, bottom)]),
            np.column_stack([last + first, last + second, np.full(around, bottom + 1)]),
        ]
    )
    return TriangleMesh(vertices, np.concatenate([sides, ends]))


def lay_on_cone(
    cone: EllipticCone,
    centres: FloatArray,
    angles: FloatArray,
    *,
    angle: float,
    height: float,
) -> FloatArray:
    """T_link_module (m, 4, 4) of flat boards tangent to an elliptic cone.

    Parameters
    ----------
    cone : EllipticCone
    centres, angles : (m, 2) array of float, (m,) array of float
        Of the boards in the plane development [m, rad].
    angle, height : float
        Where the origin of the plane lies on the cone [rad, m].
    """
    positions, frames = cone.unrolled(centres, angle=angle, height=height)
    poses = np.tile(np.eye(4), (len(centres), 1, 1))
    poses[:, :3, :3] = frames @ _turns(angles)
    poses[:, :3, 3] = positions
    return poses


def hinge(
    T_link_module: FloatArray, edge: int, side: float, height: Callable[[FloatArray], float]
) -> FloatArray:
    """T_link_module (4, 4) of a board that shares an edge with another and dips to the body.

    Parameters
    ----------
    T_link_module : (4, 4) array of float
        Of the other board.
    edge : int
        Which of its edges: 0 below, 1 to the right, 2 to the left.
    side : float
        [m].
    height : callable
        Positive outside the body, negative inside, for a point (3,).
    """
    apothem = side / (2.0 * np.sqrt(3.0))
    T_module_edge = np.eye(4)
    T_module_edge[:3, :3] = _turns(np.array([edge * 2.0 * np.pi / 3.0]))[0]
    T_module_edge[:3, 3] = T_module_edge[:3, :3] @ [0.0, -apothem, 0.0]
    T_edge_next = np.eye(4)
    T_edge_next[:3, :3] = HALF_TURN
    T_edge_next[:3, 3] = [0.0, -apothem, 0.0]

    def folded(angle: float) -> FloatArray:
        bend = np.eye(4)
        bend[1:3, 1:3] = plane_turns(angle)
        return np.asarray(T_link_module @ T_module_edge @ bend @ T_edge_next)

    best = brentq(lambda angle: height(folded(angle)[:3, 3]), 0.0, np.pi / 2.0, xtol=1e-14)
    return folded(float(best))


def _turns(angles: FloatArray) -> FloatArray:
    """(m, 3, 3) rotations about z by angles (m,) [rad]."""
    turns = np.zeros((len(angles), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0] = np.sin(angles)
    turns[:, 0, 1] = -turns[:, 1, 0]
    turns[:, 2, 2] = 1.0
    return turns
