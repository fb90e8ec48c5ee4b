"""What of one renderer rests between two pictures, what changed its colours, and what is live."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any

from vtkmodules.vtkCommonCore import vtkTimeStamp
from vtkmodules.vtkRenderingCore import vtkProp, vtkRenderer

IDLE = 8  # pictures in which an actor keeps its new colours before they are kept too


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
            every = [props.GetItemAsObject(k) for k in range(props.GetNumberOfItems())]
            self._others = time, [prop for prop in every if id(prop) not in self._numbers]
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
