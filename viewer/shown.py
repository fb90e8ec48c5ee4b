"""What a scene shows now, for whoever looks: nothing here changes it."""

from __future__ import annotations

from collections.abc import Mapping

import pyvista as pv

from skinmap.arrays import IntArray
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.moment import Moment
from viewer.drawing.frame.camera import View
from viewer.drawing.frame.canvas import Canvas, Content
from viewer.drawing.frame.framing import Framing
from viewer.drawing.panel.flat_panel import FlatPanel
from viewer.layer import Layer


class Shown:
    """The readable side of a `viewer.scene.Scene`.

    Attributes
    ----------
    canvas : Canvas
        All that is drawn.
    content : Content
        All that is shown by it.
    """

    canvas: Canvas
    content: Content
    _angles: Mapping[str, float]

    @property
    def angles(self) -> Mapping[str, float]:
        """Joint angles shown now [rad]; joints not named stand in the robot's natural pose."""
        return dict(self._angles)

    @property
    def plotter(self) -> pv.Plotter:
        """The window or picture that is drawn in."""
        return self.canvas.plotter

    @property
    def panel(self) -> FlatPanel | None:
        """The panel beside the body, where there are flat maps."""
        return self.canvas.panel

    @property
    def framing(self) -> Framing:
        """The camera's behaviour."""
        return self.canvas.framing

    @property
    def font_px(self) -> int:
        """Height of the letters [px]."""
        return self.canvas.font_px

    @property
    def front(self) -> View:
        """From where most of the skin is seen."""
        return self.framing.front

    @property
    def touches(self) -> tuple[NamedTouch, ...]:
        """The touches shown now."""
        return self.content.touches

    @property
    def layer(self) -> Layer:
        """What the skin shows."""
        return self.content.layer

    @property
    def style(self) -> str:
        """How the skin shows it: "surface" or "discs"."""
        return self.content.style

    @property
    def moment(self) -> Moment:
        """The moment shown now."""
        return self.content.moment

    @property
    def selection(self) -> Mapping[str, IntArray]:
        """Selected taxels (k,) by part; parts without any are left out."""
        return dict(self.content.selection)
