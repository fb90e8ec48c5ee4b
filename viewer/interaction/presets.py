"""Where to look from at the press of a key."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinmap.errors import UnknownNameError
from viewer.drawing.frame.camera import Target, View, fit, silhouette
from viewer.drawing.frame.framing import Framing

THREE_QUARTER = 20.0  # the front view stands so far to the side [deg]
RISE = 8.0  # of the level views: feet and shoulders show their tops [deg]
TOP = 82.0  # straight down the picture would have no upright [deg]
AROUND = 0.06  # what is shown around a touch that is looked at [m]

# How far each view is turned from the robot's front, seen from above [deg], and its elevation.
PRESETS = {
    "front": (0.0, RISE),
    "back": (180.0, RISE),
    "left": (90.0, RISE),
    "right": (-90.0, RISE),
    "top": (0.0, TOP),
}


def preset(name: str, front: View) -> View:
    """The view of a name; left and right are the robot's own.

    Parameters
    ----------
    name : str
        One of `PRESETS`.
    front : View
        The scene's three-quarter view.

    Raises
    ------
    UnknownNameError
        No such preset.
    """
    if name not in PRESETS:
        raise UnknownNameError("camera preset", name, PRESETS)
    turn, elevation = PRESETS[name]
    azimuth = (front.azimuth - THREE_QUARTER + turn + 180.0) % 360.0 - 180.0
    return View(azimuth, elevation)


def focus(framing: Framing, targets: Sequence[Target]) -> bool:
    """Bring touches close, seen from straight above them; False where there are none.

    The camera stays there until a key or the mouse moves it.
    """
    if not targets:
        return False
    normals = np.concatenate([target.normals for target in targets]).mean(axis=0)
    length = float(np.linalg.norm(normals))
    view = framing.view
    if length > 0.2:  # touches all round have no side
        n = normals / length
        azimuth = np.degrees(np.arctan2(n[1], n[0])) if np.hypot(n[0], n[1]) > 0.1 else view.azimuth
        view = View(float(azimuth), float(np.clip(np.degrees(np.arcsin(n[2])), -70.0, 70.0)))
    points = np.concatenate([target.points for target in targets])
    corners = np.array(np.meshgrid(*[[-AROUND, AROUND]] * 3)).reshape(3, -1).T
    around = silhouette((points[:, None] + corners).reshape(-1, 3))
    framing.look(view, "free")
    renderer = framing.renderer
    fit(renderer.GetActiveCamera(), view, around, renderer.GetSize(), framing.margins)
    renderer.ResetCameraClippingRange()
    return True
