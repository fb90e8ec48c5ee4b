"""Everything that touches on one part's skin are measured with, computed when first asked for.

The skins that a classifier was trained on, and how another skin differs from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from skinmap.arrays import FloatArray, Frozen, IntArray
from skinmap.errors import SkinMismatchError
from skinmap.flat.flat_map import FlatMap, flatten
from skinmap.geometry.proximity import median_spacing
from skinmap.neighbours.offsets import (
    LATTICE,
    Neighbourhoods,
    flat_map_directions,
    geodesic_neighbourhoods,
    neighbourhoods,
)
from skinmap.neighbours.structures import usual_radius
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin, fingerprint, layout_fingerprint
from skinmap.surface.surface_mesh import SurfaceMesh, build_surface
from skinmap.touch.contacts.skin_geometry import SkinGeometry, measure_skin
from skinmap.touch.images.contact_image import ContactImageGeometry, taxel_grid
from skinmap.touch.recording import Recording

MM = 1e3


class PreparedSkin:
    """A skin with its surface mesh, flat map, distances and neighbourhoods, each made once.

    Parameters
    ----------
    skin : Skin
    """

    def __init__(self, skin: Skin) -> None:
        self.skin = skin
        self._given: tuple[object, ...] = ()
        self._hoods: dict[tuple[float, str, int], Neighbourhoods] = {}

    @classmethod
    def of(cls, mesh: SurfaceMesh, flat: FlatMap | None = None) -> PreparedSkin:
        """A prepared skin whose surface mesh, and flat map if given, exist already."""
        made = cls(mesh.skin)
        made._given = (mesh, flat)
        made.__dict__["mesh"] = mesh  # where cached_property would keep it
        if flat is not None:
            made.__dict__["flat"] = flat
        return made

    def __len__(self) -> int:
        return len(self.skin)

    def content(self) -> tuple[object, ...]:
        """What decides about everything here, whatever of it was computed already."""
        return self.skin, self._given

    @cached_property
    def fingerprint(self) -> str:
        """How the skin is recognised again."""
        return fingerprint(self.skin)

    @cached_property
    def pitch(self) -> float:
        """Median distance of a taxel to the nearest other [m]."""
        return self.skin.spacing

    @cached_property
    def mesh(self) -> SurfaceMesh:
        """Delaunay surface mesh."""
        return build_surface(self.skin)

    @cached_property
    def flat(self) -> FlatMap:
        """Flat map of all patches."""
        return flatten(self.mesh)

    @cached_property
    def geometry(self) -> SkinGeometry:
        """Adjacency, areas and distances along the skin."""
        return measure_skin(self.mesh)

    @cached_property
    def image_geometry(self) -> ContactImageGeometry:
        """Contact images on a grid as wide as the taxels lie apart, no taxel without a pixel."""
        return taxel_grid(self.flat)

    @cached_property
    def hoods(self) -> Neighbourhoods:
        """Neighbour offsets in frames that follow the lattice of each chart."""
        return self.neighbourhoods()

    def neighbourhoods(
        self,
        *,
        radius: float | None = None,
        distance: str = "euclidean",
        symmetry: int = LATTICE,
    ) -> Neighbourhoods:
        """Neighbour offsets of a kind, made once.

        Parameters
        ----------
        radius : float, optional
            [m]; the skin's own by default.
        distance : {"euclidean", "geodesic"}
            Straight, or along the skin.
        symmetry : int
            Of the lattice that the frames follow: 6 for triangular ones, 4 for square ones.
        """
        radius = usual_radius([self.skin.positions]) if radius is None else radius
        kind = (radius, distance, symmetry)
        if kind not in self._hoods:
            directions = flat_map_directions(self.flat, symmetry=symmetry)
            self._hoods[kind] = (
                geodesic_neighbourhoods(self.mesh, directions, radius=radius)
                if distance == "geodesic"
                else neighbourhoods(
                    self.skin.positions, self.skin.normals, directions, radius=radius
                )
            )
        return self._hoods[kind]

    @cached_property
    def patches(self) -> IntArray:
        """(n,) patch of each taxel."""
        return np.asarray(self.mesh.taxel_patches)


def prepare_skins(robot: Robot, recordings: Sequence[Recording]) -> dict[str, PreparedSkin]:
    """The skins of recorded parts; taxels and channels must agree.

    Raises
    ------
    UnknownNameError
        A recorded part that the robot lacks.
    SkinMismatchError
        A recording of another number of taxels.
    """
    skins = {}
    for one in recordings:
        skin = PreparedSkin(robot.skin(one.part))
        if one.pressures.shape[1] != len(skin):
            raise SkinMismatchError(
                f"the recording of {one.part!r} has {one.pressures.shape[1]} taxels, "
                f"the skin of {robot.name} has {len(skin)}"
            )
        skins[one.part] = skin
    return skins


@dataclass(frozen=True, eq=False, slots=True)
class TrainedSkin(Frozen):
    """What a model remembers of a skin.

    Attributes
    ----------
    part : str
    positions : (n, 3) float
        [m].
    """

    part: str
    positions: FloatArray

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the part's name and the positions in micrometres."""
        return layout_fingerprint(self.part, self.positions)


@dataclass(frozen=True, slots=True)
class SkinDifference:
    """How a skin differs from what a model was trained on.

    Attributes
    ----------
    message : str
        One line; empty for the same skin.
    may_go_on : bool
        Whether the model can name touches there.
    """

    message: str
    may_go_on: bool


def compare_skin(trained: Sequence[TrainedSkin], skin: Skin, *, one_skin: bool) -> SkinDifference:
    """What is different about a skin.

    Parameters
    ----------
    trained : sequence of TrainedSkin
        What a model was trained on.
    skin : Skin
        What it is asked about.
    one_skin : bool
        Whether the model reads taxels by their number, so that they must stay where they were:
        within half a pitch. Other models carry over.
    """
    now = fingerprint(skin)
    if any(one.fingerprint == now for one in trained):
        return SkinDifference("", True)
    same_part = [one for one in trained if one.part == skin.part]
    if not same_part:
        parts = ", ".join(one.part for one in trained) or "no part"
        return SkinDifference(f"{skin.part!r} was not trained on ({parts} were)", not one_skin)
    before = same_part[0].positions
    if len(before) != len(skin):
        return SkinDifference(
            f"{skin.part!r} has {len(skin)} taxels, the model learnt it with {len(before)}",
            not one_skin,
        )
    moved = np.linalg.norm(skin.positions - before, axis=1)
    most, half = float(moved.max(initial=0.0)), 0.5 * median_spacing(before)
    if most <= half:
        return SkinDifference(f"taxels of {skin.part!r} moved by up to {most * MM:.3g} mm", True)
    return SkinDifference(
        f"{skin.part!r} has another layout: taxels moved by up to {most * MM:.3g} mm, "
        f"more than half the pitch ({half * MM:.3g} mm)",
        not one_skin,
    )
