"""The trade task `view`: one drawn update of the picture, by what is drawn and how.

Simulated touches of the first part are shown, all taxels changing from one update to the next, at
the size of the live window and with the camera at rest; one update of `ANEW` draws everything
anew, as when the camera has come to rest. The error is the root mean square difference of the
colours from the picture in its richest form (`RICHEST`), in percent of full scale, over all pixels
of a few updates. It says how much of the picture is another one, not how much worse a person
reads it: a body left out on purpose counts as an error too.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.trade.measuring import cpu_seconds
from skinmap.trade.task import Knob, Outcome, Setting

if TYPE_CHECKING:
    from skinmap.live.contacts.named_touch import NamedTouch
    from skinmap.live.moment import Moment
    from skinmap.skin.robot import Robot
    from skinmap.touch.prepared_skin import PreparedSkin

SIZE = (1024, 768)
LEAST = 0.15  # seconds of updates that are timed: they differ more than other work does
STEPS, STEP = 6, 0.04  # updates of a touch, and the time between two [s]
COMPARED = 2  # one update of so many is compared
ANEW = 20  # updates of which one draws everything anew
FINE, DETAIL = 0.75, 1.5  # sides of the cells of links [px]: of the truth, and what is drawn
RICHEST: Setting = {"style": "surface", "links": "all", "detail": FINE}
ALWAYS = "each sample"  # contours, where no rate is named


@dataclass(frozen=True, eq=False, slots=True)
class Richest:
    """Pictures (k, h, w, 3) of the richest form, and where its camera stood."""

    pictures: NDArray[np.uint8]
    camera: tuple[Any, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Show:
    """What is shown: the robot, its skins and moments; the richest form, once it was drawn.

    Moments are those of one touch after another, `STEPS` of each.
    """

    robot: Robot
    skins: dict[str, PreparedSkin]
    moments: list[Moment]
    richest: list[Richest]


class ViewTask:
    """The live picture of some parts."""

    name = "view"
    unit = "%"
    work = f"one drawn update at {SIZE[0]} x {SIZE[1]}, 1 in {ANEW} drawn anew"
    truth = "the richest picture: rms difference of the colours over all pixels"
    knobs = (
        Knob("style", ("surface", "discs"), "surface", "a coloured sheet, or a disc a taxel"),
        Knob("links", ("all", "skin", "none"), "all", "what is drawn of the body"),
        Knob("detail", (DETAIL, 12.0), DETAIL, "side of the cells that links are cut to [px]"),
        Knob("contour_rate", (ALWAYS, 4.0), ALWAYS, "contours found anew a second, at most"),
    )

    def settings(self) -> Sequence[Setting]:
        """Each knob alone, what is left of the body with discs, and all of them quick."""
        base: Setting = {"style": "surface", "links": "all", "detail": DETAIL}
        return [
            base,
            {**base, "style": "discs"},
            {**base, "detail": 12.0},
            {**base, "contour_rate": 4.0},
            {"style": "surface", "links": "skin", "detail": DETAIL},
            {"style": "surface", "links": "none"},
            {"style": "discs", "links": "none"},
            {"style": "discs", "links": "all", "detail": 12.0, "contour_rate": 4.0},
        ]

    def prepare(self, robot: Robot, parts: tuple[str, ...], *, seed: int) -> Show:
        """Touches on the parts, simulated with the seed."""
        from skinmap.touch.prepared_skin import PreparedSkin

        skins = {part: PreparedSkin(robot.skin(part)) for part in parts}
        return Show(robot, skins, _moments(skins, seed), [])

    def run(self, prepared: Show, setting: Setting, *, seed: int) -> Outcome:
        """Draw updates in turns; seconds of one, and how far the pictures are from the richest."""
        if not prepared.richest:
            scene = _scene(prepared, RICHEST)
            prepared.richest.append(Richest(_pictures(scene, prepared.moments), _camera(scene)))
            scene.close()
        richest = prepared.richest[0]
        scene = _scene(prepared, setting)
        try:
            _place(scene, richest.camera)
            pictures = _pictures(scene, prepared.moments)
            update, anew = _seconds(scene, prepared.moments)
        finally:
            scene.close()
        return Outcome(
            update + (anew - update) / ANEW,
            100.0 * colour_difference(pictures, richest.pictures),
            beside={"update_seconds": update, "anew_seconds": anew},
        )


def _seconds(scene: Any, moments: Sequence[Moment]) -> tuple[float, float]:
    """CPU time of an update with the camera at rest, and of one that draws everything anew."""
    turn = itertools.cycle(moments)
    clock = itertools.count(moments[-1].time + STEP, STEP)  # else contours are found at each turn

    def update() -> None:
        scene.show_moment(replace(next(turn), time=next(clock)))
        scene.refresh()

    def anew() -> None:
        scene.canvas.cache.forget()
        update()

    rest, _ = cpu_seconds(update, least=LEAST)
    whole, _ = cpu_seconds(anew)
    return rest, whole


def colour_difference(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Root mean square difference of pictures (k, h, w, 3), as a share of full scale."""
    squares = 0.0
    for here, there in zip(one, other, strict=True):  # a picture at a time: a third of the time
        apart = np.subtract(here, there, dtype=np.float64).ravel()
        squares += float(np.dot(apart, apart))  # of whole numbers: exact
    return float(np.sqrt(squares / one.size) / 255.0)


def _scene(show: Show, setting: Setting) -> Any:
    from viewer.drawing.skin.lazy_maps import LazyMaps
    from viewer.scene import Scene

    links: Any = {"all": None, "skin": "skin", "none": ()}[str(setting.get("links", "all"))]
    rate = setting.get("contour_rate", ALWAYS)
    return Scene(
        show.robot,
        {part: skin.mesh for part, skin in show.skins.items()},
        LazyMaps(show.skins),
        links=links,
        window_size=SIZE,
        style=str(setting.get("style", "surface")),
        camera="still",
        detail=float(setting.get("detail", DETAIL)),
        contour_rate=float("inf") if rate == ALWAYS else float(rate),
    )


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
    """(k, h, w, 3) a picture of some moments of each touch."""
    found = []
    scene.frame(0.0)  # the camera finds its place, and the skin the triangles that it needs there
    for place, moment in enumerate(moments, start=1):
        scene.show_moment(moment)
        if place % COMPARED:
            scene.refresh()
        else:
            found.append(scene.frame(0.0))
    return np.stack(found)


def _moments(skins: dict[str, PreparedSkin], seed: int) -> list[Moment]:
    """Moments from the middles of simulated touches, one of each gesture, on all parts at once."""
    from skinmap.live.moment import Moment
    from skinmap.touch.contacts import pressed
    from skinmap.touch.gestures import FOUR
    from skinmap.touch.simulator import simulate

    rngs = np.random.default_rng([seed, 6]).spawn(len(skins))
    felt: dict[str, list[tuple[str, FloatArray]]] = {}
    for (part, skin), rng in zip(skins.items(), rngs, strict=True):
        made = simulate(skin.skin, rng=rng, per_gesture=1, gestures=FOUR)
        stride = max(1, round(STEP / float(np.median(np.diff(made.times)))))
        felt[part] = [
            (label, _middle(pressed(samples).astype(np.float64), stride))
            for _, label, samples in made.touches()
        ]
    moments = []
    for number, step in np.ndindex(len(FOUR), STEPS):
        values, named = {}, []
        for part, touches in felt.items():
            label, samples = touches[number]
            values[part] = samples[step]
            named.append(_named(part, skins[part], samples[step], label, number))
        shown = tuple(one for one in named if one is not None)
        moments.append(Moment(number + step * STEP, values, shown))
    return moments


def _middle(samples: FloatArray, stride: int) -> FloatArray:
    """(STEPS, n) samples from the middle of a touch (k, n), some more than once in a short one."""
    rows = len(samples) // 2 + stride * (np.arange(STEPS) - STEPS // 2)
    return samples[np.clip(rows, 0, len(samples) - 1)]


def _named(
    part: str, skin: PreparedSkin, values: FloatArray, label: str, number: int
) -> NamedTouch | None:
    """The touch that values (n,) are of; None where nothing is active."""
    from skinmap.live.contacts.named_touch import NamedTouch
    from skinmap.touch.contacts import ACTIVE

    taxels = np.flatnonzero(values >= ACTIVE)
    if not len(taxels):
        return None
    centre = np.average(skin.skin.positions[taxels], axis=0, weights=values[taxels])
    return NamedTouch(part, taxels, centre, label, 1.0, identity=number, began=float(number))


view_task = ViewTask()
