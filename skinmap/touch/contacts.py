"""Contacts: connected active taxels of the surface mesh, and the pooling of an event."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from skinmap.arrays import BoolArray, FloatArray, IntArray, freeze
from skinmap.errors import SkinMismatchError
from skinmap.geometry.distances import bridged_graph, edge_graph, path_distances
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.topology import edges
from skinmap.surface.surface_mesh import SurfaceMesh

ACTIVE = 12.0  # counts of 255: ten times the noise at rest
POOL_SHARE = 0.5  # samples with at least this share of an event's largest load speak for it


@dataclass(frozen=True, eq=False)
class SkinGeometry:
    """What contacts on a skin are measured with: adjacency, areas and distances along it.

    Attributes
    ----------
    mesh : SurfaceMesh
    adjacency : (n, n) sparse
        Mesh edges, with their lengths [m].
    areas : (n,) float
        Skin area of each taxel [m2].
    distances : (n, n) float
        Shortest paths along the skin, straight across the gaps between patches [m].
    """

    mesh: SurfaceMesh
    adjacency: csr_array
    areas: FloatArray
    distances: FloatArray

    def __post_init__(self) -> None:
        freeze(self, areas=self.areas, distances=self.distances)

    def __len__(self) -> int:
        return len(self.areas)


def measure_skin(mesh: SurfaceMesh) -> SkinGeometry:
    """Adjacency, areas and distances of a surface mesh with n taxels, made once per skin."""
    points = mesh.vertices
    # Two rings of neighbours: paths over one ring alone are up to 15 % too long on hexagons.
    graph = bridged_graph(points, 18, 2.5 * median_spacing(points))
    pairs = edges(mesh.faces)
    merged = np.flatnonzero(mesh.representative != np.arange(len(points)))
    pairs = np.concatenate([pairs, np.column_stack([merged, mesh.representative[merged]])])
    adjacency = edge_graph(points, pairs)
    return SkinGeometry(mesh, adjacency, mesh.taxel_areas, path_distances(graph))


def pressed(samples: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The samples (j, n) of an event (k, n) that carry at least half of its largest load.

    Landing and leaving say little of a touch; no sample is left where nothing is active.
    """
    load = np.where(samples > ACTIVE, samples, 0).sum(axis=1, dtype=np.float64)
    if len(load) == 0 or load.max() == 0:
        return samples[:0]
    return samples[load >= POOL_SHARE * load.max()]


def pool_event(samples: NDArray[np.uint8]) -> FloatArray:
    """One pressure (n,) per taxel for the samples (k, n) of an event: the mean while pressed."""
    held = pressed(samples)
    return held.mean(axis=0) if len(held) else np.zeros(samples.shape[1])


def find_contacts(geometry: SkinGeometry, pressures: FloatArray) -> tuple[BoolArray, IntArray]:
    """Active taxels (n,) and the contact (n,) of each, numbered by load; -1 where not active.

    Raises
    ------
    SkinMismatchError
        Pressures of another length than the skin.
    """
    if pressures.shape != (len(geometry),):
        raise SkinMismatchError(
            f"{pressures.size} pressures for the {len(geometry)} taxels of "
            f"{geometry.mesh.skin.part!r}"
        )
    active = pressures > ACTIVE
    label = np.full(len(pressures), -1)
    index = np.flatnonzero(active)
    if len(index):
        count, piece = connected_components(geometry.adjacency[index][:, index], directed=False)
        load = np.bincount(piece, pressures[index], minlength=count)
        rank = np.empty(count, np.int64)
        rank[np.argsort(-load, kind="stable")] = np.arange(count)
        label[index] = rank[piece]
    return active, label
