"""Pictures drawn from what changed: the body, which rests while the camera does, is kept.

Most of a frame's time goes into links that look as they did in the frame before. Colour and depth
of what rests are copied to a second framebuffer once and copied back before each frame, so that
the picture is the same to the bit as one drawn anew, at a hundredth of the cost.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any

from vtkmodules.util.vtkConstants import VTK_UNSIGNED_CHAR
from vtkmodules.vtkRenderingCore import vtkProp, vtkRenderer
from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLFramebufferObject

COLOUR_AND_DEPTH = 0x4000 | 0x0100  # GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT
NEAREST = 0x2600  # GL_NEAREST
SCISSOR_TEST = 0x0C11  # GL_SCISSOR_TEST


class Resting:
    """One renderer: which of its actors rest, and whether its kept picture is still right.

    Parameters
    ----------
    renderer : vtkRenderer
    candidates : sequence of vtkActor
        What may rest: those of one colour do, as long as camera and pose do.
    detail : callable, optional
        Told before what rests is drawn: True for a quick picture (it moves), False for a good one.

    Attributes
    ----------
    resting, live : list of vtkProp
        What was visible at the last survey.
    moved, changed : bool
        Whether what rests, and what is live, looks different from the last frame.
    quick : bool
        Whether the kept picture is a quick one.
    """

    def __init__(
        self,
        renderer: vtkRenderer,
        candidates: Sequence[Any] = (),
        detail: Callable[[bool], None] | None = None,
    ) -> None:
        self.renderer: Any = renderer
        self.detail = detail
        self.resting: list[Any] = []
        self.live: list[Any] = []
        self.moved, self.changed, self.quick = True, True, False
        self._candidates = tuple(candidates)
        self._numbers = {id(actor) for actor in self._candidates}
        self._plain: dict[int, tuple[int, bool]] = {}
        self._kept: Hashable = None
        self._shown: Hashable = None

    @property
    def empty(self) -> bool:
        """Whether nothing is kept."""
        return self._kept is None

    def survey(self) -> tuple[Hashable, Hashable]:
        """Find what rests and what is live; the looks of both, equal for equal pictures.

        VTK's own time stamps tell: hiding and showing an actor advances them too, so they are
        taken anew at the end of each frame.
        """
        self.resting, self.live, times = [], [], []
        for actor in self._candidates:
            if actor.GetVisibility():
                time = actor.GetRedrawMTime()
                if self._rests(actor, time):
                    self.resting.append(actor)
                    times.append(time)
                else:
                    self.live.append(actor)
        props = self.renderer.GetViewProps()
        others = (props.GetItemAsObject(k) for k in range(props.GetNumberOfItems()))
        self.live += [p for p in others if p.GetVisibility() and id(p) not in self._numbers]
        return (self._place(), tuple(times)), tuple(_look(prop) for prop in self.live)

    def compare(self) -> None:
        """Say what differs from the last frame."""
        place, content = self.survey()
        self.moved = place != self._kept
        self.changed = content != self._shown

    def settle(self) -> None:
        """What is kept and shown is of now."""
        self._kept, self._shown = self.survey()

    def forget(self) -> None:
        """Draw all of it next time."""
        self._kept = self._shown = None

    def _place(self) -> Hashable:
        renderer, camera = self.renderer, self.renderer.GetActiveCamera()
        return (
            camera.GetPosition(),
            camera.GetFocalPoint(),
            camera.GetViewUp(),
            camera.GetViewAngle(),
            camera.GetParallelScale(),
            camera.GetClippingRange(),
            renderer.GetViewport(),
            tuple(renderer.GetSize()),
            renderer.GetBackground(),
        )

    def _rests(self, actor: Any, time: int) -> bool:
        known = self._plain.get(id(actor))
        if known is None or known[0] != time:
            known = time, is_plain(actor)
            self._plain[id(actor)] = known
        return known[1]


class RenderCache:
    """Draws a window; see the module.

    Parameters
    ----------
    window : vtkOpenGLRenderWindow
        Without multisampling while drawn through here.
    renderers : Resting
        All renderers of the window that show something.
    """

    def __init__(self, window: Any, *renderers: Resting) -> None:
        self.window = window
        self.renderers = renderers
        self._buffer: Any = None
        self._size: tuple[int, int] = (0, 0)

    def draw(self, *, good: bool = False) -> bool:
        """Bring the picture up to date; False where nothing had to be drawn.

        Parameters
        ----------
        good : bool
            Full detail also while the camera moves: for movies, which nobody waits for.
        """
        self._fit_buffer()
        moved = [one for one in self.renderers if self._prepare(one, good)]
        changed = [one for one in self.renderers if one.changed and one not in moved]
        if not moved and not changed:
            return False
        if moved:
            self._draw_resting(moved)
        self._draw_live(moved, changed)
        for one in (*moved, *changed):
            one.settle()
        return True

    def draw_all(self) -> None:
        """Draw everything anew, in full detail, for stills; what is kept is forgotten."""
        for one in self.renderers:
            self._detail(one, quick=False)
        self.window.Render()
        self.forget()

    def forget(self) -> None:
        """Draw everything next time."""
        for one in self.renderers:
            one.forget()

    def _prepare(self, one: Resting, good: bool) -> bool:
        """Choose the detail; whether what rests must be drawn."""
        one.compare()
        quick = one.moved and not one.empty and not good
        # Come to rest after a quick picture: now there is time for a good one.
        stale = one.moved or (one.quick and not quick)
        if stale and one.detail is not None and quick != one.quick:
            self._detail(one, quick=quick)
            one.survey()
        return stale

    def _detail(self, one: Resting, *, quick: bool) -> None:
        if one.detail is not None and quick != one.quick:
            one.detail(quick)
            one.quick = quick

    def _draw_resting(self, moved: list[Resting]) -> None:
        """Draw what rests of these renderers, unseen, and keep it."""
        window = self.window
        hidden = []
        for one in self.renderers:
            one.renderer.SetDraw(one in moved)
            if one in moved:
                hidden += _hide(one.live)
        mode = window.GetFrameBlitMode()
        swap = window.GetSwapBuffers()
        window.SetFrameBlitModeToNoBlit()
        window.SwapBuffersOff()
        try:
            window.Render()
        finally:
            window.SetFrameBlitMode(mode)
            window.SetSwapBuffers(swap)
            _unhide(hidden)
            for one in self.renderers:
                one.renderer.SetDraw(True)
        for one in moved:
            self._copy(window.GetRenderFramebuffer(), self._buffer, one)

    def _draw_live(self, moved: list[Resting], changed: list[Resting]) -> None:
        """Draw what is live over what rests."""
        for one in changed:
            self._copy(self._buffer, self.window.GetRenderFramebuffer(), one)
        hidden = []
        for one in self.renderers:
            wanted = one in moved or one in changed
            one.renderer.SetDraw(wanted)
            one.renderer.SetErase(False)
            if wanted:
                hidden += _hide(one.resting)
        try:
            self.window.Render()
        finally:
            _unhide(hidden)
            for one in self.renderers:
                one.renderer.SetErase(True)
                one.renderer.SetDraw(True)

    def _fit_buffer(self) -> None:
        """Make the second framebuffer, or make it anew after the window changed its size."""
        window = self.window
        size = tuple(window.GetSize())
        if self._buffer is not None and size == self._size:
            return
        if self._buffer is None:
            window.Render()  # makes the context and the window's own framebuffer
            self._buffer = vtkOpenGLFramebufferObject()
            self._buffer.SetContext(window)
        window.MakeCurrent()
        self._buffer.PopulateFramebuffer(
            *size, True, 1, VTK_UNSIGNED_CHAR, True, window.GetRenderBufferTargetDepthSize(), 0,
            bool(window.GetStencilCapable()),
        )  # fmt: skip
        self._size = size
        self.forget()

    def _copy(self, source: Any, target: Any, one: Resting) -> None:
        """Copy colour and depth of a renderer's rectangle."""
        width, height = self._size
        left, bottom, right, top = one.renderer.GetViewport()
        rectangle = (
            round(left * width), round(right * width), round(bottom * height), round(top * height),
        )  # fmt: skip
        self.window.MakeCurrent()
        source.SaveCurrentBindingsAndBuffers()
        source.Bind(source.GetReadMode())
        source.ActivateReadBuffer(0)
        target.Bind(target.GetDrawMode())
        target.ActivateDrawBuffer(0)
        state = self.window.GetState()
        state.vtkglDisable(SCISSOR_TEST)  # still set to the renderer that was drawn last
        vtkOpenGLFramebufferObject.Blit(rectangle, rectangle, COLOUR_AND_DEPTH, NEAREST)
        state.vtkglEnable(SCISSOR_TEST)
        source.RestorePreviousBindingsAndBuffers()

    def close(self) -> None:
        """Give the second framebuffer back; before the window closes."""
        if self._buffer is not None:
            self._buffer.ReleaseGraphicsResources(self.window)
            self._buffer = None


def is_plain(actor: Any) -> bool:
    """Whether an actor has one colour: it changes with camera and pose only, and may rest."""
    mapper = actor.GetMapper()
    data = mapper.GetInput()
    if data is None or not mapper.GetScalarVisibility():
        return True
    return data.GetPointData().GetScalars() is None and data.GetCellData().GetScalars() is None


def _hide(props: list[vtkProp]) -> list[vtkProp]:
    """Hide props and return them."""
    for prop in props:
        prop.VisibilityOff()
    return props


def _unhide(props: list[vtkProp]) -> None:
    for prop in props:
        prop.VisibilityOn()


def _look(prop: Any) -> Hashable:
    """When the look of a prop changed last, with all it depends on."""
    time = prop.GetRedrawMTime()
    if prop.IsA("vtkTextActor"):
        return time, prop.GetTextProperty().GetMTime()
    if prop.IsA("vtkActor2D"):
        data = prop.GetMapper().GetInput()
        return time, data.GetMTime() if data is not None else 0
    return time
