"""From moments to pictures: the one that shows most, and those of a movie."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from skinmap.geometry.rigid import transform_directions
from skinmap.live.moment import Moment
from viewer.drawing.frame.camera import front_view
from viewer.export.movie import MOVIE_FPS, Picture
from viewer.look import Look
from viewer.scene import Scene
from viewer.session import Session

CALM = 1.6  # how far the camera of a movie turns between two pictures [deg]: 40 a second


class Best:
    """Keeps the moment that shows most: large, surely named touches that are seen from the front.

    Parameters
    ----------
    session : Session
    look : Look
    """

    def __init__(self, session: Session, look: Look) -> None:
        robot = session.robot
        poses = robot.body.poses({**robot.pose, **(look.angles or {})})
        self._poses = {part: poses[robot.part(part).link] for part in session.parts}
        normals = [
            transform_directions(self._poses[part], skin.skin.normals)
            for part, skin in session.skins.items()
        ]
        self._front = front_view(np.concatenate(normals)).direction
        self.moment: Moment | None = None
        self.worth = -math.inf

    def watch(self, moments: Iterable[Moment]) -> Iterator[Moment]:
        """The same moments, looked at as they pass."""
        for moment in moments:
            worth = self._worth(moment)
            if worth > self.worth:
                self.moment, self.worth = moment, worth
            yield moment

    def _worth(self, moment: Moment) -> float:
        total = 0.0
        for touch in moment.touches:
            # What has no name yet has just begun: a later moment says more.
            sure = touch.confidence if math.isfinite(touch.confidence) else -1.0
            seen = 1.0
            if touch.normal is not None:
                normal = transform_directions(self._poses[touch.part], touch.normal[None])[0]
                seen = float(np.clip(0.5 + normal @ self._front, 0.2, 1.0))
            total += sure * seen * math.sqrt(min(len(touch.taxels), 16))
        return total


def show(scene: Scene, moment: Moment) -> None:
    """Show a moment, with the flat map of the part that was touched last."""
    scene.show_moment(moment)
    if scene.panel is not None:
        for touch in reversed(moment.touches):
            if touch.part in scene.panel.flat_maps:
                scene.show_flat_map(touch.part)
                return


def movie_frames(scene: Scene, moments: Iterable[Moment]) -> Iterator[Picture]:
    """Pictures (h, w, 3) of moments, 25 for each of their seconds; a turning camera is calm."""
    due = -math.inf
    for moment in moments:
        if moment.time < due - 1e-6:
            continue
        due = (moment.time if math.isinf(due) else due) + 1.0 / MOVIE_FPS
        if moment.time > due:
            due = moment.time + 1.0 / MOVIE_FPS
        show(scene, moment)
        yield scene.frame(CALM)
