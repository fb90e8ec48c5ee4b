"""What a stream says of the skin it comes from, and whether it is the skin we have."""

from __future__ import annotations

from skinmap.errors import SkinMismatchError
from skinmap.live.sources.source import StreamInfo
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin, fingerprint


def live_width(skin: Skin) -> int:
    """Channels of a part's live vector as far as taxels use it."""
    return int(skin.channels.max(initial=-1)) + 1


def check_skin(info: StreamInfo, robot: Robot) -> None:
    """Refuse a stream that cannot come from a robot's skin.

    Raises
    ------
    UnknownNameError
        A part that the robot has not.
    SkinMismatchError
        A part with too few channels for its taxels, or with another layout.
    """
    for part, width in zip(info.parts, info.widths, strict=True):
        skin = robot.skin(part)
        if width != len(skin) and width < live_width(skin):
            raise SkinMismatchError(
                f"stream {info.name!r} has {width} channels for {part!r}; its {len(skin)} taxels "
                f"on {robot.name!r} need {len(skin)}, or {live_width(skin)} of the live vector"
            )
        theirs = info.fingerprints.get(part)
        if theirs is not None and theirs != fingerprint(robot.skin(part)):
            raise SkinMismatchError(
                f"stream {info.name!r} comes from another skin: the layout of {part!r} "
                f"is not that of {robot.name!r}"
            )
