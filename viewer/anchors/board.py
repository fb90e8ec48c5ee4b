"""The flat board of the calibration view: all taxels, which are anchors, which to measure next."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv

from calibration.commands.anchor_session import AnchorSession
from calibration.commands.results import MM
from skinmap.arrays import FloatArray
from skinmap.geometry.proximity import median_spacing
from viewer.anchors.marks import (
    ANCHOR,
    CHOSEN,
    NEXT,
    UNKNOWN,
    Limits,
    Marks,
    Names,
    channels,
    paint,
    ranked,
)
from viewer.colours import FAINT, PANEL, rgb
from viewer.drawing.frame.polydata import make_lines
from viewer.drawing.words.text_lines import Line

LOW, HIGH, SIDE = 0.30, 0.90, 0.08  # where the board lies, in shares of the panel
DISC, RING = 0.42, 0.72  # radii in pitches
BARS = (0.1, 0.05, 0.02, 0.01, 0.005)  # lengths of the scale bar [m]
KEYS = (
    "click a taxel here, then its point on the link",
    "(or the point first); drag turns the link",
    "s  solve        u  take back      x  remove anchor",
    "w  save         W  save whatever the status",
    "r  look at the patch              q  close",
)


class BoardPanel:
    """The board in a plotter's active renderer.

    Parameters
    ----------
    plotter : pyvista.Plotter
    session : AnchorSession
    font_px : int
        Height of the letters [px].
    """

    def __init__(self, plotter: pv.Plotter, session: AnchorSession, font_px: int) -> None:
        self.session = session
        self.renderer = plotter.renderer
        self.renderer.SetBackground(*rgb(PANEL))
        self.renderer.parallel_projection = True
        layout = session.board.layout
        self.pitch = median_spacing(layout)
        self.places = np.column_stack([layout, np.zeros(len(layout))])
        self.up = np.tile([0.0, 0.0, 1.0], (len(layout), 1))
        self.taxels = Marks(plotter)
        self.following = Marks(plotter, NEXT)
        self.anchors = Marks(plotter, ANCHOR)
        self.chosen = Marks(plotter, CHOSEN)
        self.bar = Marks(plotter, FAINT)
        self.names = Names(self.renderer, font_px, ANCHOR)
        self.next_names = Names(self.renderer, font_px, NEXT)
        small = round(0.85 * font_px)
        Line(self.renderer, (SIDE, 0.975), font_px, bold=True).write("board, seen from outside")
        self.count = Line(self.renderer, (SIDE, 0.942), small, colour=FAINT)
        step = 1.45 * font_px / self.renderer.GetSize()[1]
        for row, text in enumerate(KEYS):
            Line(self.renderer, (SIDE, 0.20 - row * step), small, colour=FAINT).write(text)
        self._length = Line(self.renderer, (SIDE, 0.262), small, colour=FAINT)
        self._look()

    def show(self, limits: Limits | None) -> None:
        """Draw what the session has now, on the link's scale [mm]."""
        session, found = self.session, self.session.found
        if found is None or limits is None:
            grey = np.rint(255 * rgb(UNKNOWN)).astype(np.uint8)
            colours = np.tile(grey, (len(self.places), 1))
            following = np.zeros(0, np.int64)
        else:
            colours = paint(MM * found.predicted_sd, limits)
            following = found.next_taxels
        self.taxels.discs(self.places, self.up, DISC * self.pitch, colours)
        known = np.array([anchor.taxel for anchor in session.anchors], np.int64)
        radius = RING * self.pitch
        self.anchors.rings(self._lifted(known, 1), self.up[known], radius, 0.3)
        self.following.rings(self._lifted(following, 1), self.up[following], radius, 0.3)
        chosen = np.array([] if session.taxel is None else [session.taxel], np.int64)
        self.chosen.rings(self._lifted(chosen, 2), self.up[chosen], 1.25 * radius, 0.35)
        beside = np.array([0.5, 0.5, 0.0]) * self.pitch
        self.names.show(channels(session), self.places[known] + beside)
        self.next_names.show(ranked(session, following), self.places[following] + beside)
        self.count.write(f"{len(self.places)} taxels, {len(known)} anchors")

    def place(self, x: float, y: float) -> FloatArray:
        """The place (2,) on the board under a pixel [m]."""
        self.renderer.SetDisplayPoint(x, y, 0.0)
        self.renderer.DisplayToWorld()
        return np.array(self.renderer.GetWorldPoint())[:2]

    def _lifted(self, taxels: FloatArray | Any, layer: int) -> FloatArray:
        """Places of some taxels, in a layer above the discs [m]."""
        return self.places[taxels] + [0.0, 0.0, layer * 1e-4]

    def _look(self) -> None:
        """Fit the board between the caption and the keys, and draw a bar of a round length."""
        width, height = self.renderer.GetSize()
        low, high = self.places[:, :2].min(axis=0), self.places[:, :2].max(axis=0)
        wide, tall = high - low + 3.0 * self.pitch
        metres = max(wide / ((1 - 2 * SIDE) * width), tall / ((HIGH - LOW) * height))  # a pixel
        middle = 0.5 * (low + high)
        middle[1] -= ((HIGH + LOW) / 2 - 0.5) * height * metres
        camera: Any = self.renderer.GetActiveCamera()
        camera.SetFocalPoint(*middle, 0.0)
        camera.SetPosition(*middle, 1.0)
        camera.SetViewUp(0.0, 1.0, 0.0)
        camera.SetParallelScale(0.5 * height * metres)
        camera.SetClippingRange(0.5, 1.5)
        length = next((bar for bar in BARS if bar < 0.45 * width * metres), BARS[-1])
        left = middle[0] + (SIDE - 0.5) * width * metres
        y = middle[1] + (0.272 - 0.5) * height * metres
        ends = np.array([[left, y, 0.0], [left + length, y, 0.0]])
        self.bar.show(make_lines(ends, np.array([[0, 1]])))
        self._length.write(f"{length * 100:g} cm")
