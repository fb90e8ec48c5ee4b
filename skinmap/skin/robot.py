"""A robot: a posable body and the parts of it that carry skin, loaded when asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from skinmap.arrays import FloatArray
from skinmap.errors import UnknownNameError
from skinmap.geometry.mesh import TriangleMesh
from skinmap.skin.skin import Skin, skin_from_table
from skinmap.skin.taxels import TaxelTable


class Body(Protocol):
    """Links with meshes and poses; `skinmap.io.urdf.UrdfBody` is one."""

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links."""

    @property
    def visible_links(self) -> tuple[str, ...]:
        """Names of the links that carry a visual mesh."""

    @property
    def joints(self) -> dict[str, tuple[float, float]]:
        """Limits [rad or m] of each joint."""

    def poses(self, angles: Mapping[str, float]) -> dict[str, FloatArray]:
        """T_root_link (4, 4) of every link for joint angles [rad]."""

    def mesh(self, link: str) -> TriangleMesh:
        """Visual mesh of one link in its frame [m]."""


@dataclass(frozen=True, slots=True)
class Part:
    """What the manifest says of one part."""

    name: str
    link: str
    read: Callable[[], TaxelTable]
    module: str | None = None


@dataclass(eq=False)
class Robot:
    """A body with skinned parts.

    Attributes
    ----------
    name : str
        As people call it.
    body : Body
        Links, meshes and poses.
    pose : dict
        Joint angles [rad] of a natural pose, for pictures.
    """

    name: str
    body: Body
    part_specs: Mapping[str, Part]
    pose: Mapping[str, float] = field(default_factory=dict)
    _skins: dict[str, Skin] = field(default_factory=dict, repr=False)
    _meshes: dict[str, TriangleMesh] = field(default_factory=dict, repr=False)

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the skinned parts, in the manifest's order."""
        return tuple(self.part_specs)

    def part(self, name: str) -> Part:
        """What the manifest says of a part.

        Raises
        ------
        UnknownNameError
            No such part (says which there are).
        """
        if name not in self.part_specs:
            raise UnknownNameError("part", name, self.part_specs)
        return self.part_specs[name]

    def skin(self, part: str) -> Skin:
        """The taxels of a part with repaired normals; reads its table and its link's mesh."""
        spec = self.part(part)
        if part not in self._skins:
            table = spec.read()
            self._skins[part] = skin_from_table(table, self.mesh(spec.link), part, spec.link)
        return self._skins[part]

    def mesh(self, link: str) -> TriangleMesh:
        """Visual mesh of a link in its frame [m], read once."""
        if link not in self._meshes:
            self._meshes[link] = self.body.mesh(link)
        return self._meshes[link]
