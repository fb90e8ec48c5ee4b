"""Pictures drawn from what changed: the body, which rests while the camera does, is kept.

Most of a frame's time goes into links that look as they did in the frame before. Colour and depth
of what rests are copied to a second framebuffer once and copied back before each frame, so that
the picture is the same to the bit as one drawn anew, at a hundredth of the cost.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any

from vtkmodules.util.vtkConstants import VTK_UNSIGNED_CHAR
from vtkmodules.vtkCommonCore import vtkTimeStamp
from vtkmodules.vtkRenderingCore import vtkProp, vtkRenderer
from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLFramebufferObject

IDLE = 8  # pictures in which an actor keeps its new colours before they are kept too


COLOUR_AND_DEPTH = 0x4000 | 0x0100  # GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT
SOFTWARE = ("llvmpipe", "softpipe", "swr", "swiftshader", "software")  # in renderers' names
NEAREST = 0x2600  # GL_NEAREST
SCISSOR_TEST = 0x0C11  # GL_SCISSOR_TEST


class Coloured:
    """An opaque actor that changes its colours more often than its place.

    Painted again where it stands it covers its older picture to the last pixel, since VTK draws
    what is as near as what is there already. So its older picture may be kept with the rest.

    Attributes
    ----------
    kept : bool
        Whether the kept picture shows its colours of now.
    idle : int
        Pictures since they changed.
    """

    def __init__(self, actor: Any) -> None:
        self.actor = actor
        self.kept, self.idle = False, 0
        # Bound once: PyVista checks the spelling of each attribute asked of its actors.
        self._visible, self._stamps = actor.GetVisibility, Stamps(actor)
        self._matrix = actor.GetUserMatrix

    def look(self, mark: int) -> tuple[Hashable, bool]:
        """Its shape, None while hidden, and whether anything of it changed since a time."""
        if not self._visible():
            self.kept = False
            return None, False
        matrix, changed = self._matrix(), self._stamps.newest() > mark
        points = self._stamps.points()
        if changed:
            self.kept, self.idle = False, 0
        # VTK counts its time stamps up for all objects: others have others, be they older.
        return (points and points.GetMTime(), matrix and matrix.GetMTime()), changed


class Resting:
    """One renderer: which of its actors rest, and whether its kept picture is still right.

    Parameters
    ----------
    renderer : vtkRenderer
    candidates : sequence of vtkActor
        Those of one colour rest as long as camera and pose do; of the others those whose colours
        did not change for a while.
    detail : callable, optional
        Told before what rests is drawn: True for a quick picture (it moves), False for a good one.

    Attributes
    ----------
    resting, live : list of vtkProp
        What was visible at the last survey.
    coloured : list of Coloured
        The same of those that change their colours.
    moved, changed : bool
        Whether what rests, and what is live, looks different from the last frame.
    going : bool
        Whether what rests moved before the last frame too.
    quick : bool
        Whether the last picture is a quick one.
    whole : bool
        Whether the last picture was drawn in one go and nothing is kept of it.
    waited : bool
        Whether it was left out of the last picture, since another renderer moves.
    """

    def __init__(
        self,
        renderer: vtkRenderer,
        candidates: Sequence[Any] = (),
        detail: Callable[[bool], None] | None = None,
    ) -> None:
        self.renderer: Any = renderer
        self.detail = detail
        self.resting: list[vtkProp] = []
        self.live: list[vtkProp] = []
        self.coloured: list[Coloured] = []
        self.moved, self.changed, self.going = True, True, False
        self.quick, self.whole, self.waited = False, False, False
        plain = [actor for actor in candidates if is_plain(actor)]
        self._plain = [(actor, actor.GetVisibility, Stamps(actor).newest) for actor in plain]
        self._coloured = [Coloured(actor) for actor in candidates if not is_plain(actor)]
        self._numbers = {id(actor) for actor in candidates}
        self._others: tuple[int, list[Any]] = (-1, [])
        self._mark = 0  # VTK's time at the last `settle`
        self._kept: Hashable = None
        self._shown: int | None = None
        self._shapes: tuple[Hashable, ...] = ()

    @property
    def empty(self) -> bool:
        """Whether nothing was drawn yet that is still right."""
        return self._kept is None

    @property
    def stale(self) -> list[Coloured]:
        """Those whose kept picture is another than theirs of now."""
        return [one for one in self.coloured if not one.kept]

    @property
    def idle(self) -> list[Coloured]:
        """Those of them whose new colours may be kept."""
        return [one for one in self.stale if one.idle >= IDLE]

    def survey(self) -> tuple[bool, bool]:
        """Find what rests and what is live; whether each has other stamps than at `settle`.

        VTK's own time stamps tell, which it counts up for all objects together: what is newer than
        the end of the last frame has changed since. Hiding and showing, too, gives new ones.
        """
        mark = self._mark
        shown = [(actor, newest()) for actor, visible, newest in self._plain if visible()]
        self.resting = [actor for actor, _ in shown]
        self.coloured, shapes, turned = [], [], False
        moved = any(time > mark for _, time in shown)
        for one in self._coloured:
            shape, changed = one.look(mark)
            if shape is not None:
                self.coloured.append(one)
            shapes.append(shape)
            turned |= changed
        self._shapes = tuple(shapes)
        self.live = [prop for prop in self._rest_of_props() if prop.GetVisibility()]
        return moved, turned or any(_look(prop) > mark for prop in self.live)

    def compare(self) -> None:
        """Say what differs from the last frame."""
        moved, changed = self.survey()
        self.moved = moved or self._place() != self._kept
        self.changed = changed or len(self.live) != self._shown

    def settle(self) -> None:
        """What is kept and shown is of now."""
        for one in self.coloured:
            one.idle += 1
        now = vtkTimeStamp()
        now.Modified()
        self._kept, self._shown, self._mark = self._place(), len(self.live), now.GetMTime()

    def forget(self) -> None:
        """Draw all of it next time."""
        self._kept = self._shown = None

    def _rest_of_props(self) -> list[Any]:
        """Props of the renderer that are no candidates."""
        props = self.renderer.GetViewProps()
        time = props.GetMTime()
        if time != self._others[0]:
            self._others = time, [prop for prop in props if id(prop) not in self._numbers]
        return self._others[1]

    def _place(self) -> Hashable:
        renderer, camera = self.renderer, self.renderer.GetActiveCamera()
        return (
            len(self.resting),
            self._shapes,
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


def is_plain(actor: Any) -> bool:
    """Whether an actor has one colour: it changes with camera and pose only, and may rest."""
    return not actor.GetMapper().GetScalarVisibility()


class Stamps:
    """What tells whether an actor looks as before: the time stamps of all that it is made of.

    VTK's own `GetRedrawMTime` asks the same, but brings the actor's pipeline up to date for it:
    of all actors of a robot, in each picture, that costs more than a part of the skin does.
    Methods are bound once: PyVista checks the spelling of each attribute asked of its objects.
    """

    def __init__(self, actor: Any) -> None:
        self._own, self._get_mapper = actor.GetMTime, actor.GetMapper
        self._mapper: Any = None
        self._connected = -1

    def newest(self) -> int:
        """The newest stamp of actor, mapper and mesh."""
        mapper = self._get_mapper()
        if mapper is not self._mapper:
            self._mapper, self._mapper_time, self._connected = mapper, mapper.GetMTime, -1
        time = self._mapper_time()
        if time != self._connected:  # its mesh is only another one where the mapper has changed
            self._connected, data = time, mapper.GetInput()
            self._data_time, self.points = data.GetMTime, data.GetPoints
        return int(max(self._own(), time, self._data_time()))


def _look(prop: Any) -> int:
    """When the look of a prop changed last, with all it depends on."""
    time = int(prop.GetRedrawMTime())
    if prop.IsA("vtkTextActor"):
        return max(time, prop.GetTextProperty().GetMTime())
    if prop.IsA("vtkActor2D"):
        data = prop.GetMapper().GetInput()
        return max(time, data.GetMTime() if data is not None else 0)
    return time


class RenderCache:
    """Draws a window; see the module.

    Parameters
    ----------
    window : vtkOpenGLRenderWindow
        Without multisampling while drawn through here.
    renderers : Resting
        All renderers of the window that show something.
    cached : bool, optional
        Whether to keep what rests; where software draws by default. A graphics card draws all of a
        robot in less time than what is kept takes to copy.
    """

    def __init__(self, window: Any, *renderers: Resting, cached: bool | None = None) -> None:
        self.window, self.cached = window, cached
        self.renderers = renderers
        self._buffer: Any = None
        self._blank: Any = None  # what is there before anything is drawn
        self._backgrounds: tuple[Any, ...] = ()
        self._size: tuple[int, int] = (0, 0)
        self.held = False  # whether the last picture was drawn, but is not on the screen yet

    def draw(self, *, good: bool = False, hold: bool = False) -> bool:
        """Bring the picture up to date; False where nothing had to be drawn.

        Parameters
        ----------
        good : bool
            Full detail also while the camera moves: for movies, which nobody waits for.
        hold : bool
            Keep it off the screen until `present`.
        """
        drawn = self._draw(good, hold)
        self.held |= drawn and hold
        if drawn and hold:
            self.window.WaitForCompletion()  # threads still draw: only now it is known when
        if not hold:
            self.present()
        return drawn

    def present(self) -> None:
        """Put a picture on the screen that was held back."""
        if self.held:
            self.held = False
            self.window.Frame()

    def _draw(self, good: bool, hold: bool) -> bool:
        if self.cached is None:
            self.window.Render()  # before there is a context, nobody knows what draws
            self.cached = is_software(self.window)
        if not self.cached:
            return self._draw_plainly(hold)
        self._fit_buffer()
        moved = [one for one in self.renderers if self._prepare(one, good)]
        changed = [one for one in self.renderers if one.changed and one not in moved]
        if not good and any(one.whole for one in moved):
            changed = self._in_turns(changed)
        if not moved and not changed:
            return False
        kept = [one for one in moved if not one.whole]
        if kept:
            self._draw_resting(kept)
        for one in changed:
            self._copy(self._buffer, self.window.GetRenderFramebuffer(), one)
        self._absorb([one for one in changed if one.idle])
        self._draw_live([*kept, *changed], [one for one in moved if one.whole], unseen=hold)
        for one in (*moved, *changed):
            one.settle()
        return True

    def _draw_plainly(self, hold: bool) -> bool:
        """Draw everything where anything changed."""
        for one in self.renderers:
            one.compare()
        if not any(one.moved or one.changed for one in self.renderers):
            return False
        for one in self.renderers:
            self._detail(one, quick=False)
        self._render(list(self.renderers), [], unseen=hold)
        for one in self.renderers:
            one.survey()
            one.settle()
        return True

    def draw_all(self) -> None:
        """Draw everything anew, in full detail, for stills; what is kept is forgotten."""
        for one in self.renderers:
            self._detail(one, quick=False)
        self.window.Render()
        self.held = False
        self._backgrounds = ()  # smoothed, the window had a framebuffer that nothing is copied to
        self.forget()

    def forget(self) -> None:
        """Draw everything next time."""
        for one in self.renderers:
            one.forget()

    def _in_turns(self, changed: list[Resting]) -> list[Resting]:
        """Of what changed beside a renderer that moves, every other picture: it stays changed."""
        chosen = [one for one in changed if one.waited or one.empty]
        for one in changed:
            one.waited = not one.waited
        return chosen

    def _prepare(self, one: Resting, good: bool) -> bool:
        """Choose the detail; whether what rests must be drawn."""
        one.compare()
        going_on = one.moved and not one.empty
        quick = going_on and not good
        # Come to rest after a picture of which nothing is kept: now there is time for a good one.
        stale = one.moved or one.whole
        # What moves on is drawn at once: what would be kept of it would never be used.
        one.whole = quick or (going_on and one.going)
        one.going = one.moved
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
        hidden = [prop for one in moved for prop in one.live]
        self._erase(moved)
        self._render(moved, hidden, unseen=True, over=moved)
        self._keep(moved)
        for one in moved:
            for coloured in one.coloured:
                coloured.kept = True

    def _absorb(self, idle: list[Resting]) -> None:
        """Keep new colours that have not changed for a while; their renderers show what is kept."""
        if not idle:
            return
        hidden: list[vtkProp] = []
        for one in idle:
            chosen = one.idle
            hidden += [*one.resting, *one.live, *(x.actor for x in one.coloured if x not in chosen)]
        self._render(idle, hidden, unseen=True, over=idle)
        self._keep(idle)
        for one in idle:
            for coloured in one.idle:
                coloured.kept = True

    def _draw_live(self, over: list[Resting], whole: list[Resting], *, unseen: bool) -> None:
        """Draw what is live over what rests, and all of those of which nothing is kept."""
        hidden: list[vtkProp] = []
        for one in over:
            hidden += [*one.resting, *(x.actor for x in one.coloured if x.kept)]
        self._erase(whole)
        self._render([*over, *whole], hidden, unseen=unseen, over=[*over, *whole])

    def _erase(self, wanted: list[Resting]) -> None:
        """Empty the rectangles of renderers: in software, VTK's own way takes ten times as long.

        It clears a part of the window, which llvmpipe does pixel by pixel.
        """
        for one in wanted:
            self._copy(self._blank, self.window.GetRenderFramebuffer(), one)

    def _make_blank(self) -> None:
        """Keep what each renderer shows when nothing is in it."""
        every = (prop for one in self.renderers for prop in one.renderer.GetViewProps())
        hidden = [prop for prop in every if prop.GetVisibility()]
        self._render(list(self.renderers), hidden, unseen=True)
        for one in self.renderers:
            self._copy(self.window.GetRenderFramebuffer(), self._blank, one)
        self._backgrounds = self._looks()

    def _looks(self) -> tuple[Any, ...]:
        """The renderers' backgrounds and places."""
        return tuple(
            (r.GetBackground(), r.GetBackground2(), r.GetGradientBackground(), r.GetViewport())
            for r in (one.renderer for one in self.renderers)
        )

    def _render(
        self,
        wanted: list[Resting],
        hidden: list[vtkProp],
        *,
        unseen: bool = False,
        over: Sequence[Resting] = (),
    ) -> None:
        """Draw some renderers without some of their props.

        Unseen, it stays off the screen; `over` are those that draw over what is there.
        """
        window = self.window
        mode, swap = window.GetFrameBlitMode(), window.GetSwapBuffers()
        for one in self.renderers:
            one.renderer.SetDraw(one in wanted)
            one.renderer.SetErase(one not in over)
        for prop in hidden:
            prop.VisibilityOff()
        if unseen:
            window.SetFrameBlitModeToNoBlit()
            window.SwapBuffersOff()
        try:
            window.Render()
        finally:
            window.SetFrameBlitMode(mode)
            window.SetSwapBuffers(swap)
            for prop in hidden:
                prop.VisibilityOn()
            for one in self.renderers:
                one.renderer.SetDraw(True)
                one.renderer.SetErase(True)

    def _keep(self, shown: list[Resting]) -> None:
        """Keep what these renderers show."""
        for one in shown:
            self._copy(self.window.GetRenderFramebuffer(), self._buffer, one)

    def _fit_buffer(self) -> None:
        """Make the second framebuffer, or make it anew after the window changed its size."""
        window = self.window
        size = tuple(window.GetSize())
        if self._buffer is None or size != self._size:
            if self._buffer is None:
                window.Render()  # makes the context and the window's own framebuffer
                self._buffer, self._blank = self._new_buffer(), self._new_buffer()
            window.MakeCurrent()
            for buffer in (self._buffer, self._blank):
                buffer.PopulateFramebuffer(
                    *size, True, 1, VTK_UNSIGNED_CHAR, True,
                    window.GetRenderBufferTargetDepthSize(), 0, bool(window.GetStencilCapable()),
                )  # fmt: skip
            self._size, self._backgrounds = size, ()
            self.forget()
        if self._backgrounds != self._looks():
            self._make_blank()
            self.forget()

    def _new_buffer(self) -> Any:
        buffer = vtkOpenGLFramebufferObject()
        buffer.SetContext(self.window)
        return buffer

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
        for buffer in (self._buffer, self._blank):
            if buffer is not None:
                buffer.ReleaseGraphicsResources(self.window)
        self._buffer = self._blank = None


def is_software(window: Any) -> bool:
    """Whether a window is drawn by the processor, as Mesa's llvmpipe does."""
    told = str(window.ReportCapabilities()).lower()
    found = next((line for line in told.splitlines() if "opengl renderer string" in line), "")
    return any(name in found for name in SOFTWARE)
