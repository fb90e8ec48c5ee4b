"""Optical flow of the pressures on the flat map: the other way to see which way a touch moves.

The flow of two contact images, some time apart, is that of OpenCV (Farneback, "Two-Frame Motion
Estimation Based on Polynomial Expansion", SCIA 2003), its mean is weighted by the pressures, and
the flat map's own differential under the touch carries it back to the skin.
"""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.geometry.proximity import median_spacing
from skinmap.imports import import_optional
from skinmap.touch.contact_image import image_geometry
from skinmap.touch.prepared_skin import PreparedSkin

TORN = 2.0  # an edge that is so much longer on the map leads across a seam
FINE = 2.0  # pixels a spacing
LEVELS, WINDOW, TURNS = 3, 9, 3  # of Farneback's pyramid, in pixels, and its iterations
EXPANSION, SMOOTH = 5, 1.1  # neighbourhood of the polynomials, and its spread [pixels]


class FlatFlow:
    """The flow of the pressures of one part.

    Parameters
    ----------
    skin : PreparedSkin
        n taxels.

    Raises
    ------
    MissingLibraryError
        OpenCV is not installed.
    """

    def __init__(self, skin: PreparedSkin) -> None:
        self._cv2 = import_optional(
            "cv2", "optical flow needs OpenCV: pip install 'skinmap[images]'"
        )
        flat = skin.flat
        pitch = median_spacing(skin.skin.positions) / FINE
        self._image = image_geometry(flat, pitch=pitch)
        self._pitch = pitch
        faces, vertices, uv = flat.mesh.faces, flat.mesh.vertices, flat.uv
        edges = np.stack([vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2)], axis=2)
        flat_edges = np.stack([uv[faces[:, k]] - uv[faces[:, 0]] for k in (1, 2)], axis=2)
        longer = np.linalg.norm(flat_edges, axis=1) / np.linalg.norm(edges, axis=1)
        whole = (np.isfinite(longer) & (longer < TORN)).all(axis=1)  # not across a seam of the map
        # (m, 3, 2): metres on the skin for a metre on the map.
        self._differential = edges[whole] @ np.linalg.pinv(flat_edges[whole])
        self._middles = vertices[faces[whole]].mean(axis=1)

    def velocity(
        self, before: FloatArray, after: FloatArray, seconds: float, centre: FloatArray
    ) -> FloatArray:
        """Velocity (3,) [m/s] between pressures (n,) so many seconds apart, at a centre (3,)."""
        top = max(float(before.max(initial=0.0)), float(after.max(initial=0.0)))
        if top <= 0:
            return np.zeros(3)
        shape = self._image.mask.shape
        one, other = (
            np.asarray(255.0 / top * (self._image.matrix @ each)).reshape(shape).astype(np.uint8)
            for each in (before, after)
        )
        flow = self._cv2.calcOpticalFlowFarneback(
            one, other, None, 0.5, LEVELS, WINDOW, TURNS, EXPANSION, SMOOTH, 0
        )
        weight = one.astype(np.float64) + other
        right, down = np.einsum("ij,ijk->k", weight, flow) / weight.sum() * self._pitch / seconds
        away = self._middles - centre
        face = int(np.einsum("ij,ij->i", away, away).argmin())
        return np.asarray(self._differential[face] @ np.array([right, -down]))
