"""The skin as Foxglove draws it: triangles with a colour a taxel, touches with their names."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.io.ros2.robot_topics import taxel_columns
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.sources.source import StreamInfo
from skinmap.skin.robot import Robot
from skinmap.surface.surface_mesh import build_surface

LIFT = 0.002  # taxels lie 0.5 to 1 mm inside the body's mesh [m]
LEVELS = 256
AT_ONCE = 800  # taxels coloured with one sample: more would delay the next one (5 us each)
TOUCH_SIZE, WORD_SIZE, WORD_LIFT = 0.015, 0.03, 0.03  # [m]
# From untouched to hardest pressed: grey, yellow, red.
RAMP = np.array([[0.55, 0.57, 0.60], [0.98, 0.80, 0.25], [0.86, 0.15, 0.12]])


class SkinScene:
    """Scene updates of what has changed.

    Parameters
    ----------
    robot : Robot
    info : StreamInfo
    context : foxglove.Context
    """

    def __init__(self, robot: Robot, info: StreamInfo, context: Any) -> None:
        from foxglove import messages
        from foxglove.channels import SceneUpdateChannel

        self._messages, self._robot = messages, robot
        self._skin = SceneUpdateChannel("/skin/scene", context=context)
        self._touches = SceneUpdateChannel("/skin/touches", context=context)
        columns = taxel_columns(robot, info.parts, info.widths)
        counts = [len(robot.skin(part)) for part in info.parts]
        ends = np.cumsum(counts)
        self._columns = dict(zip(info.parts, np.split(columns, ends[:-1]), strict=True))
        self._points = {part: self._lifted(part) for part in info.parts}
        self._faces = {
            part: build_surface(robot.skin(part)).faces.ravel().tolist() for part in info.parts
        }
        steps = np.linspace(0.0, 2.0, LEVELS)
        shades = np.column_stack([np.interp(steps, range(3), RAMP[:, k]) for k in range(3)])
        self._shades = [messages.Color(r=r, g=g, b=b, a=1.0) for r, g, b in shades.tolist()]
        self._shown: dict[str, NDArray[np.int64]] = {}
        self._shown_at: dict[str, int] = {}
        self._marked: set[int] = set()
        self._lock = threading.Lock()

    def forget(self) -> None:
        """Take all for changed."""
        with self._lock:
            self._shown = {}

    def skin(self, stamp: int, values: NDArray[Any], colour_max: float, period: int) -> None:
        """Show a sample (channels,): parts with other colours, the longest shown first.

        Parameters
        ----------
        stamp : int
            [ns].
        values : (channels,) array
        colour_max : float
            Counts of the reddest colour.
        period : int
            A part is shown as often at most [ns].
        """
        changed, room = [], AT_ONCE
        for part in sorted(self._columns, key=lambda one: self._shown_at.get(one, 0)):
            columns, last = self._columns[part], self._shown_at.get(part)
            if room <= 0:
                break
            if last is not None and part in self._shown and 0 <= stamp - last < period:
                continue
            share = np.asarray(values[columns], np.float64) * ((LEVELS - 1) / colour_max)
            levels = np.rint(share).clip(0, LEVELS - 1).astype(np.int64)
            with self._lock:
                if part in self._shown and np.array_equal(self._shown[part], levels):
                    continue
                self._shown[part] = levels
            self._shown_at[part] = stamp
            room -= len(columns)
            changed.append(self._sheet(stamp, part, levels))
        if changed:
            self._skin.log(self._messages.SceneUpdate(entities=changed))

    def touches(self, stamp: int, touches: Sequence[NamedTouch]) -> None:
        """Show touches with their names; those that ended are taken away."""
        messages = self._messages
        now = {one.identity for one in touches}
        gone = [
            messages.SceneEntityDeletion(id=f"touch {identity}")
            for identity in sorted(self._marked - now)
        ]
        entities = [self._mark(stamp, one) for one in touches]
        if gone or entities:
            self._touches.log(messages.SceneUpdate(entities=entities, deletions=gone))
        self._marked = now

    def _sheet(self, stamp: int, part: str, levels: NDArray[np.int64]) -> Any:
        messages = self._messages
        triangles = messages.TriangleListPrimitive(
            points=self._points[part],
            colors=[self._shades[level] for level in levels.tolist()],
            indices=self._faces[part],
        )
        return messages.SceneEntity(
            timestamp=_time(stamp, messages),
            frame_id=self._robot.part(part).link,
            id=f"skin {part}",
            frame_locked=True,
            triangles=[triangles],
        )

    def _mark(self, stamp: int, touch: NamedTouch) -> Any:
        messages = self._messages
        x, y, z = touch.centre.tolist()
        size = messages.Vector3(x=TOUCH_SIZE, y=TOUCH_SIZE, z=TOUCH_SIZE)
        red = messages.Color(r=0.94, g=0.25, b=0.16, a=0.9)
        turn = messages.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
        place = messages.Pose(position=messages.Vector3(x=x, y=y, z=z), orientation=turn)
        above = messages.Pose(
            position=messages.Vector3(x=x, y=y, z=z + WORD_LIFT), orientation=turn
        )
        words = f"{touch.label} {touch.confidence:.0%}"
        return messages.SceneEntity(
            timestamp=_time(stamp, messages),
            frame_id=self._robot.part(touch.part).link,
            id=f"touch {touch.identity}",
            frame_locked=True,
            spheres=[messages.SpherePrimitive(pose=place, size=size, color=red)],
            texts=[
                messages.TextPrimitive(
                    pose=above,
                    billboard=True,
                    font_size=WORD_SIZE,
                    color=messages.Color(r=1.0, g=1.0, b=1.0, a=1.0),
                    text=words,
                )
            ],
        )

    def _lifted(self, part: str) -> list[Any]:
        """Taxels a little outside of the body, as Foxglove's points."""
        skin = self._robot.skin(part)
        places = (skin.positions + LIFT * skin.normals).tolist()
        return [self._messages.Point3(x=x, y=y, z=z) for x, y, z in places]


def _time(stamp: int, messages: Any) -> Any:
    return messages.Timestamp(stamp // 1_000_000_000, stamp % 1_000_000_000)
