"""Touches one by one: after each, the patch as far as it is known and where to touch next."""

from __future__ import annotations

import numpy as np

from calibration.patch.consistency import FEWEST
from calibration.patch.evidence import check_layout
from calibration.patch.patch_calibration import PatchCalibration
from calibration.patch.touch import Touch, locate_by_touch
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError


class TouchSession:
    """A board that is located while it is touched.

    Parameters
    ----------
    layout : (n, 2) float
        [m].
    vertices, faces : (v, 3) float [m], (f, 3) int
    anchors : tuple of (k,) and (k, 3), optional
        Taxels whose place is known, and where they are [m].
    modules, channels : (n,) int, optional
        Rigid module of each taxel, and what it is called in messages.
    mirror : bool
        Whether the layout shows the board from its other side.
    seed : int

    Attributes
    ----------
    touches : list of Touch
        Those kept so far.
    found : PatchCalibration or None
        None before there are three touches that can be solved.
    problem : str
        Why the touches so far do not give a patch.
    """

    def __init__(
        self,
        layout: FloatArray,
        vertices: FloatArray,
        faces: IntArray,
        *,
        anchors: tuple[IntArray, FloatArray] | None = None,
        modules: IntArray | None = None,
        channels: IntArray | None = None,
        mirror: bool = False,
        seed: int = 0,
    ) -> None:
        self.layout, self.link = check_layout(layout), (vertices, faces)
        self.anchors, self.seed = anchors, seed
        self.modules, self.channels, self.mirror = modules, channels, mirror
        self.touches: list[Touch] = []
        self.found: PatchCalibration | None = None
        self.problem = ""

    def add(self, touch: Touch) -> IntArray:
        """Keep a touch, solve, and say which taxels (k,) to touch next, the best first.

        All touches so far give the same bits as `locate_by_touch` with the same seed. Before
        there is a patch, the taxel furthest from what was touched tells most.
        """
        self.touches.append(touch)
        if len(self.touches) >= FEWEST:
            try:
                self.found = locate_by_touch(
                    self.layout, *self.link, self.touches, anchors=self.anchors,
                    modules=self.modules, channels=self.channels, mirror=self.mirror,
                    rng=np.random.default_rng(self.seed),
                )  # fmt: skip
                self.problem = ""
            except InvalidArrayError as error:
                self.found, self.problem = None, str(error)
        if self.found is not None:
            return self.found.next_taxels
        felt = np.concatenate([touch.channels for touch in self.touches])
        known = felt[(felt >= 0) & (felt < len(self.layout))]
        if len(known) == 0:
            return np.zeros(0, np.int64)
        gap = np.linalg.norm(self.layout[:, None] - self.layout[known], axis=2).min(axis=1)
        return np.array([np.argmax(gap)], np.int64)
