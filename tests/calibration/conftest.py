"""A board on a cylinder: the one wrap whose answer is known in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

RADIUS = 45e-3
PITCH = 6.5e-3


@dataclass
class Bent:
    """A board bent round a cylinder, and the cylinder."""

    layout: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray
    places: np.ndarray
    normals: np.ndarray
    corners: np.ndarray

    def anchors(self, sigma: float, rng: np.random.Generator, taxels=None):
        """Anchor taxels and noisy points."""
        taxels = self.corners if taxels is None else np.asarray(taxels)
        points = self.places[taxels] + rng.normal(0, sigma, (len(taxels), 3))
        return taxels, points


def bend(layout: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Places and normals of a board rolled round the z axis, seen from outside."""
    angle = layout[:, 0] / radius
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
    return radius * normals + np.column_stack([np.zeros((len(angle), 2)), layout[:, 1]]), normals


@pytest.fixture(scope="session")
def bent() -> Bent:
    import trimesh

    row, column = np.divmod(np.arange(8 * 9), 8)
    layout = PITCH * np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(3) / 2])
    layout -= layout.mean(axis=0)
    # The surface that a patch is laid on stands 0.3 mm off the mesh; so do the taxels.
    places, normals = bend(layout, RADIUS)
    mesh = trimesh.creation.cylinder(radius=RADIUS - 0.3e-3, height=0.14, sections=96)
    corners = np.array([0, 7, 64, 71, 35, 39])
    return Bent(
        layout,
        np.asarray(mesh.vertices, float),
        np.asarray(mesh.faces, np.int64),
        places,
        normals,
        corners,
    )
