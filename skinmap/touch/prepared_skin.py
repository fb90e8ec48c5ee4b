"""Everything that touches on one part's skin are measured with, computed when first asked for."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from skinmap.arrays import IntArray
from skinmap.errors import SkinMismatchError
from skinmap.flat.flat_map import DEFAULT, FlatMap, flatten
from skinmap.neighbours.offsets import (
    LATTICE,
    Neighbourhoods,
    flat_map_directions,
    geodesic_neighbourhoods,
    neighbourhoods,
)
from skinmap.neighbours.structures import usual_radius
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin, fingerprint
from skinmap.surface.surface_mesh import SurfaceMesh, build_surface
from skinmap.touch.contacts.skin_geometry import SkinGeometry, measure_skin
from skinmap.touch.images.contact_image import ContactImageGeometry, taxel_grid
from skinmap.touch.recording import Recording


class PreparedSkin:
    """A skin with its surface mesh, flat map, distances and neighbourhoods, each made once.

    Parameters
    ----------
    skin : Skin
    method : str
        Flattening method.
    radius : float, optional
        Of the neighbourhoods [m].
    """

    def __init__(self, skin: Skin, *, method: str = DEFAULT, radius: float | None = None) -> None:
        self.skin, self.method = skin, method
        self.radius = radius or usual_radius([skin.positions])
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
        return self.skin, self.method, self.radius, self._given

    @cached_property
    def fingerprint(self) -> str:
        """How the skin is recognised again."""
        return fingerprint(self.skin)

    @cached_property
    def mesh(self) -> SurfaceMesh:
        """Delaunay surface mesh."""
        return build_surface(self.skin)

    @cached_property
    def flat(self) -> FlatMap:
        """Flat map of all patches."""
        return flatten(self.mesh, method=self.method)

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
        kind = (self.radius if radius is None else radius, distance, symmetry)
        if kind not in self._hoods:
            directions = flat_map_directions(self.flat, symmetry=symmetry)
            self._hoods[kind] = (
                geodesic_neighbourhoods(self.mesh, directions, radius=kind[0])
                if distance == "geodesic"
                else neighbourhoods(
                    self.skin.positions, self.skin.normals, directions, radius=kind[0]
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
