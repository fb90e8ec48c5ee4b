"""The trade task `view`: one drawn update of the picture, by what is drawn and how.

Simulated touches of the first part are shown, all taxels changing from one update to the next, at
the size of the live window and with the camera at rest. The error is the root mean square
difference of the colours from the picture in its richest form (`RICHEST`), in percent of full
scale, over all pixels of a few updates. It says how much of the picture is another one, not how
much worse a person reads it: a body left out on purpose counts as an error too.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinmap.trade.measuring import cpu_seconds
from skinmap.trade.task import Knob, Outcome, Setting, defaults, product

if TYPE_CHECKING:
    from skinmap.live.moment import Moment
    from skinmap.skin.robot import Robot
    from skinmap.touch.prepared import PreparedSkin

SIZE = (1024, 768)
LEAST = 0.2  # seconds of updates that are timed: they differ more than other work does
UPDATES = 4  # pictures that are compared
RICHEST = {"style": "surface", "links": "all"}


@dataclass(frozen=True, eq=False, slots=True)
class Richest:
    """Pictures (k, h, w, 3) of the richest form, and where its camera stood."""

    pictures: NDArray[np.uint8]
    camera: tuple[Any, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Show:
    """What is shown: the robot, its skins and moments; the richest form, once it was drawn."""

    robot: Robot
    skins: dict[str, PreparedSkin]
    moments: list[Moment]
    richest: list[Richest]


class ViewTask:
    """The live picture of some parts."""

    name = "view"
    unit = "%"
    work = f"one drawn update at {SIZE[0]} x {SIZE[1]}, camera at rest"
    truth = "the richest picture: rms difference of the colours over all pixels"
    knobs = (
        Knob("style", ("surface", "discs"), "surface", "a coloured sheet, or a disc a taxel"),
        Knob("links", ("all", "skin", "none"), "all", "what is drawn of the body"),
    )

    def settings(self) -> Sequence[Setting]:
        """All of them."""
        return product(self.knobs)

    def prepare(self, robot: Robot, parts: tuple[str, ...], *, seed: int) -> Show:
        """Touches on the parts, simulated with the seed."""
        from skinmap.touch.prepared import PreparedSkin

        skins = {part: PreparedSkin(robot.skin(part)) for part in parts}
        return Show(robot, skins, _moments(skins, seed), [])

    def run(self, prepared: Show, setting: Setting, *, seed: int) -> Outcome:
        """Draw updates in turns; seconds of one, and how far the pictures are from the richest."""
        if not prepared.richest:
            scene = _scene(prepared, {**RICHEST})
            prepared.richest.append(Richest(_pictures(scene, prepared.moments), _camera(scene)))
            scene.close()
        richest = prepared.richest[0]
        scene = _scene(prepared, {**defaults(self.knobs), **setting})
        try:
            _place(scene, richest.camera)
            pictures = _pictures(scene, prepared.moments)
            turn = itertools.cycle(prepared.moments)

            def work() -> None:
                scene.show_moment(next(turn))
                scene.refresh()

            seconds, _ = cpu_seconds(work, least=LEAST)
        finally:
            scene.close()
        return Outcome(seconds, 100.0 * colour_difference(pictures, richest.pictures))


def colour_difference(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Root mean square difference of pictures (k, h, w, 3), as a share of full scale."""
    squares = 0.0
    for here, there in zip(one, other, strict=True):  # a picture at a time: a third of the time
        apart = np.subtract(here, there, dtype=np.float64).ravel()
        squares += float(np.dot(apart, apart))  # of whole numbers: exact
    return float(np.sqrt(squares / one.size) / 255.0)


def _scene(show: Show, setting: Setting) -> Any:
    from viewer.drawing.lazy_maps import LazyMaps
    from viewer.scene import Scene

    links: Any = {"all": None, "skin": "skin", "none": ()}[str(setting["links"])]
    scene = Scene(
        show.robot,
        {part: skin.mesh for part, skin in show.skins.items()},
        LazyMaps(show.skins),
        links=links,
        window_size=SIZE,
        style=str(setting["style"]),
        camera="still",
    )
    return scene


def _camera(scene: Any) -> tuple[Any, ...]:
    """Where the camera of a scene stands, and how it looks."""
    camera = scene.canvas.renderer.GetActiveCamera()
    place = camera.GetPosition(), camera.GetFocalPoint(), camera.GetViewUp()
    return (*place, camera.GetViewAngle())


def _place(scene: Any, place: tuple[Any, ...]) -> None:
    """Put the camera there for good: what is left out of a picture must not move the rest."""
    position, focus, up, angle = place
    scene.framing.mode = "free"
    camera = scene.canvas.renderer.GetActiveCamera()
    camera.SetPosition(position)
    camera.SetFocalPoint(focus)
    camera.SetViewUp(up)
    camera.SetViewAngle(angle)
    scene.canvas.renderer.ResetCameraClippingRange()


def _pictures(scene: Any, moments: Sequence[Moment]) -> NDArray[np.uint8]:
    """(k, h, w, 3) a picture of each moment."""
    found = []
    scene.frame(0.0)  # the camera finds its place, and the skin the triangles that it needs there
    for moment in moments:
        scene.show_moment(moment)
        found.append(scene.frame(0.0))
    return np.stack(found)


def _moments(skins: dict[str, PreparedSkin], seed: int) -> list[Moment]:
    """Moments from the middles of simulated touches on all parts."""
    from skinmap.live.moment import Moment
    from skinmap.touch.contacts import pressed
    from skinmap.touch.gestures import FOUR
    from skinmap.touch.simulator import simulate

    rngs = np.random.default_rng([seed, 6]).spawn(len(skins))
    tracks = {}
    for (part, skin), rng in zip(skins.items(), rngs, strict=True):
        made = simulate(skin.skin, rng=rng, per_gesture=1, gestures=tuple(FOUR))
        felt = np.concatenate([pressed(samples) for _, _, samples in made.touches()])
        rows = np.linspace(0, len(felt) - 1, UPDATES + 2).astype(int)[1:-1]
        tracks[part] = felt[rows].astype(np.float64)
    return [
        Moment(float(k), {part: track[k] for part, track in tracks.items()}) for k in range(UPDATES)
    ]


view_task = ViewTask()
