"""A body that is one mesh file: a forearm cover, a ball, a board on a plate."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.errors import MissingFileError, UnknownNameError
from skinmap.geometry.mesh import TriangleMesh
from skinmap.io.robots.urdf import read_mesh
from skinmap.io.text import is_file
from skinmap.skin.joints import Joint

LINK = "body"


class MeshBody:
    """One link called "body", without joints.

    Parameters
    ----------
    path : Path
        A mesh file that trimesh reads (STL, OBJ, PLY, DAE, GLB, ...).
    scale : float
        Metres a unit of the file.

    Raises
    ------
    MissingFileError
        No such file; whether it is a mesh shows when it is asked for.
    """

    def __init__(self, path: Path, *, scale: float = 1.0) -> None:
        if not is_file(path):
            raise MissingFileError(path, "a mesh file")
        self.path, self.scale = path, scale

    @property
    def links(self) -> tuple[str, ...]:
        """The one link."""
        return (LINK,)

    @property
    def visible_links(self) -> tuple[str, ...]:
        """The one link."""
        return (LINK,)

    @property
    def joints(self) -> dict[str, tuple[float, float]]:
        """No joints."""
        return {}

    @property
    def sliding_joints(self) -> frozenset[str]:
        """None: there are no joints."""
        return frozenset()

    @property
    def tree(self) -> dict[str, Joint]:
        """No joint above the one link."""
        return {}

    def poses(self, angles: Mapping[str, float]) -> dict[str, FloatArray]:
        """The identity (4, 4) for the one link.

        Raises
        ------
        UnknownNameError
            Any joint: there are none.
        """
        for name in angles:
            raise UnknownNameError("joint", name, ())
        return {LINK: np.eye(4)}

    def mesh(self, link: str) -> TriangleMesh:
        """The mesh [m].

        Raises
        ------
        UnknownNameError, DataFormatError
            Another link, or a file that is no mesh.
        """
        if link != LINK:
            raise UnknownNameError("link", link, self.links)
        vertices, faces = read_mesh(self.path)
        return TriangleMesh(vertices * self.scale, faces)
