"""What of one renderer rests between two pictures, what changed its colours, and what is live."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any

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
        self._time: Hashable = None
        # Bound once: PyVista checks the spelling of each attribute asked of its actors.
        self._visible, self._stamps = actor.GetVisibility, Stamps(actor)
        self._times, self._matrix = self._stamps.times, actor.GetUserMatrix

    def look(self) -> tuple[Hashable, bool]:
        """Its shape, None while hidden, and whether anything of it changed since `settle`."""
        if not self._visible():
            self.kept = False
            return None, False
        matrix, changed = self._matrix(), self._times() != self._time
        points = self._stamps.points()
        # VTK counts its time stamps up for all objects: others have others.
        shape = points and points.GetMTime(), matrix and matrix.GetMTime()
        if changed:
            self.kept, self.idle = False, 0
        return shape, changed

    def settle(self) -> None:
        """It is shown as it is now."""
        self._time = self._times()
        self.idle += 1


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
        self._plain = [(actor, actor.GetVisibility, Stamps(actor).times) for actor in plain]
        self._coloured = [Coloured(actor) for actor in candidates if not is_plain(actor)]
        self._numbers = {id(actor) for actor in candidates}
        self._others: tuple[int, list[Any]] = (-1, [])
        self._kept: Hashable = None
        self._shown: Hashable = None

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

    def survey(self) -> tuple[Hashable, Hashable]:
        """Find what rests and what is live; the looks of both, equal for equal pictures.

        VTK's own time stamps tell: hiding and showing an actor advances them too, so they are
        taken anew at the end of each frame.
        """
        shown = [(actor, time()) for actor, visible, time in self._plain if visible()]
        self.resting = [actor for actor, _ in shown]
        self.coloured, shapes, turned = [], [], False
        for one in self._coloured:
            shape, changed = one.look()
            if shape is not None:
                self.coloured.append(one)
            shapes.append(shape)
            turned |= changed
        self.live = [prop for prop in self._rest_of_props() if prop.GetVisibility()]
        place = (self._place(), tuple(time for _, time in shown), tuple(shapes))
        return place, (turned, tuple(_look(prop) for prop in self.live))

    def compare(self) -> None:
        """Say what differs from the last frame."""
        place, content = self.survey()
        self.moved = place != self._kept
        self.changed = content != self._shown

    def settle(self) -> None:
        """What is kept and shown is of now."""
        for one in self.coloured:
            one.settle()
        self._kept, self._shown = self.survey()

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

    def times(self) -> Hashable:
        """The stamps of actor, mapper and mesh."""
        mapper = self._get_mapper()
        if mapper is not self._mapper:
            self._mapper, self._mapper_time, self._connected = mapper, mapper.GetMTime, -1
        time = self._mapper_time()
        if time != self._connected:  # its mesh is only another one where the mapper has changed
            self._connected, data = time, mapper.GetInput()
            self._data_time, self.points = data.GetMTime, data.GetPoints
        return self._own(), time, self._data_time()


def _look(prop: Any) -> Hashable:
    """When the look of a prop changed last, with all it depends on."""
    time = prop.GetRedrawMTime()
    if prop.IsA("vtkTextActor"):
        return time, prop.GetTextProperty().GetMTime()
    if prop.IsA("vtkActor2D"):
        data = prop.GetMapper().GetInput()
        return time, data.GetMTime() if data is not None else 0
    return time
