"""Plain text that stands at a fixed place of the picture."""

from __future__ import annotations

from vtkmodules.vtkRenderingCore import (
    vtkRenderer,
    vtkTextActor,
)

from viewer.colours import BACKGROUND, INK, rgb

BACKED = 0.75  # how far the ground covers what is behind a text
SMALL, LEAST = 0.82, 10  # small letters, in heights of the others; smaller ones are not read [px]


def small_font(font_px: int) -> int:
    """Height of the letters of what explains, beside letters so high [px]."""
    return max(round(SMALL * font_px), min(LEAST, font_px))


class Line:
    """One line of text, placed in shares of the renderer's width and height.

    Parameters
    ----------
    renderer : vtkRenderer
        Where it appears.
    place : (float, float)
        Left end (or middle) and upper end, 0 to 1.
    font_px : int
        Height of the letters [px].
    """

    def __init__(
        self,
        renderer: vtkRenderer,
        place: tuple[float, float],
        font_px: int,
        *,
        bold: bool = False,
        colour: str = INK,
    ) -> None:
        self.renderer = renderer
        self.actor = vtkTextActor()
        style = self.actor.GetTextProperty()
        style.SetFontSize(font_px)
        style.SetBold(bold)
        style.SetColor(*rgb(colour))
        style.SetVerticalJustificationToTop()
        self.actor.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
        self.actor.SetPosition(*place)
        renderer.AddViewProp(self.actor)

    def write(self, text: str, colour: str | None = None) -> None:
        """Replace the text; an empty one hides the line."""
        self.actor.SetInput(text)
        self.actor.SetVisibility(bool(text))
        if colour is not None:
            self.actor.GetTextProperty().SetColor(*rgb(colour))

    @property
    def text(self) -> str:
        """What is written now."""
        return str(self.actor.GetInput() or "") if self.actor.GetVisibility() else ""

    def style(self, font_px: int, *, bold: bool = False) -> None:
        """Letters of another height [px]."""
        text = self.actor.GetTextProperty()
        text.SetFontSize(font_px)
        text.SetBold(bold)

    def fill(self, colour: str | None) -> None:
        """Put a box of a colour behind the text, or none."""
        text = self.actor.GetTextProperty()
        text.SetBackgroundOpacity(0.0 if colour is None else 1.0)
        if colour is not None:
            text.SetBackgroundColor(*rgb(colour))

    def back(self, colour: str = BACKGROUND, opacity: float = BACKED) -> None:
        """Let the ground shine through behind the text: it stays readable over the body."""
        text = self.actor.GetTextProperty()
        text.SetBackgroundColor(*rgb(colour))
        text.SetBackgroundOpacity(opacity)

    def move(self, x: float, y: float) -> None:
        """Place its left (or middle) upper end [px], y upwards."""
        width, height = self.renderer.GetSize()
        self.actor.SetPosition(x / width, y / height)

    def to_front(self) -> None:
        """Draw it after all else: VTK draws flat things in the order in which they came."""
        self.renderer.RemoveViewProp(self.actor)
        self.renderer.AddViewProp(self.actor)

    def width(self) -> float:
        """How wide it is written now [px]."""
        size = [0.0, 0.0]
        self.actor.GetSize(self.renderer, size)
        return size[0] if self.actor.GetVisibility() else 0.0

    def right(self) -> float:
        """Where it ends [px]."""
        start = self.actor.GetPosition()[0] * float(self.renderer.GetSize()[0])
        return start + self.width()
