"""The skins of all parts as one: what a sample of the whole robot is worked on with at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.topology import number_by_appearance
from skinmap.touch.contacts.skin_geometry import padded_neighbours
from skinmap.touch.prepared_skin import PreparedSkin


class JoinedSkin:
    """Taxels of several parts in one numbering: part after part, each by its dense rows.

    Parameters
    ----------
    skins : mapping of str to PreparedSkin
        By part; N taxels in all.

    Attributes
    ----------
    slices : dict of str to slice
        Where each part's taxels stand.
    positions, normals : (N, 3) float
        Each in the frame of its part's link [m].
    areas : (N,) float
        Skin that each taxel speaks for [m2].
    part_of : (N,) int
        Part of each taxel, in the order of `skins`.
    patch_of : (N,) int
        Connected sheet of each taxel, over all parts; a number of its own for an unplaced one.
    neighbours : (N, d) int
        Taxels joined with each by the surface mesh, padded with N.
    around : (N, f) int
        Triangles at each taxel or at one of its neighbours, the last one repeated.
    """

    def __init__(self, skins: Mapping[str, PreparedSkin]) -> None:
        self.skins = dict(skins)
        self.parts = tuple(self.skins)
        counts = [len(skin) for skin in self.skins.values()]
        *self.starts, self.count = np.cumsum([0, *counts]).tolist()
        self.slices = {
            part: slice(start, start + count)
            for part, start, count in zip(self.parts, self.starts, counts, strict=True)
        }
        self.part_of: IntArray = np.repeat(np.arange(len(counts)), counts)
        every = list(self.skins.values())
        self.positions: FloatArray = np.concatenate([skin.skin.positions for skin in every])
        self.normals: FloatArray = np.concatenate([skin.skin.normals for skin in every])
        self.areas: FloatArray = np.concatenate([skin.geometry.areas for skin in every])
        self.neighbours = padded_neighbours(self._links(), self.count)
        self.around = self._triangles_around()
        self.patch_of = self._patches()

    def __len__(self) -> int:
        return self.count

    def split(self, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
        """Values (N, ...) by part; views."""
        return {part: values[rows] for part, rows in self.slices.items()}

    @cached_property
    def beside(self) -> IntArray:
        """(N, e) taxels beside each, across gaps between patches too, padded with N."""
        return padded_neighbours(self._renumbered(lambda one: one.geometry.bridged), self.count)

    @cached_property
    def faces(self) -> IntArray:
        """(m, 3) triangles of all meshes; a taxel in none of them is one of no size."""
        faces = self._renumbered(lambda one: one.mesh.faces)
        alone = np.ones(self.count, bool)
        alone[faces.ravel()] = False
        alone[np.flatnonzero(self._representative != np.arange(self.count))] = False
        points = np.flatnonzero(alone)
        return np.concatenate([faces, np.column_stack([points] * 3)])

    def _triangles_around(self) -> IntArray:
        """(N, f), see the attribute `around`."""
        at: list[set[int]] = [set() for _ in range(self.count)]
        for face, corners in enumerate(self.faces.tolist()):
            for corner in corners:
                at[corner].add(face)
        near = [set(at[k]) for k in self._representative.tolist()]
        for a, b in self._links().tolist():
            near[a] |= at[b]
        width = max(map(len, near))
        return np.array([sorted(s) + [max(s)] * (width - len(s)) for s in near], np.int64)

    @cached_property
    def _representative(self) -> IntArray:
        return self._renumbered(lambda one: one.mesh.representative)

    def _renumbered(self, of: Callable[[PreparedSkin], IntArray]) -> IntArray:
        """What each part says by its rows, in the numbering of all of them."""
        every = zip(self.skins.values(), self.starts, strict=True)
        return np.concatenate([of(skin) + start for skin, start in every])

    def _links(self) -> IntArray:
        """Pairs of taxels that the meshes join, in both directions, by their first."""
        return self._renumbered(lambda one: one.geometry.links)

    def _patches(self) -> IntArray:
        """Number the sheets of all parts one after the other; unplaced taxels are sheets alone."""
        own = []
        before = 0
        for skin in self.skins.values():
            patch = np.array(skin.patches)
            lost = patch < 0
            patch[lost] = patch.max(initial=-1) + 1 + np.arange(lost.sum())
            own.append(number_by_appearance(patch) + before)
            before = int(own[-1].max()) + 1
        return np.concatenate(own)
