"""Hands and things as they press: round bodies with a force, for an elastic skin to answer.

Sizes are those of adults, scaled by the hand of who touches. Where a range is estimated and not
taken from a source, docs/simulator.md says so. Every range is drawn as far as the variety says:
0 is its middle, 1 all of it.

Things are what a hand is told from (`hand` or `other`, docs/touches.md): table tops, boxes, tools,
the fingers of grippers, limbs about a robot. Their sizes are all estimated; docs/simulator.md lists
them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.errors import check_known
from skinmap.touch.simulation.gestures import EIGHT, FOUR, GESTURES, TIME, Pad

FLESH = (0.8e7, 4e7)  # foundation stiffness of a pulp of 3 to 6 mm [N/m3]
STIFF = 1e9  # and of wood, metal or bone: the foam alone gives way
# Shares of proximal, middle and distal phalanx, of an index finger of 82 mm with its pulp (Buryanov
# and Kotiuk, Int. J. Morphol. 28(3), 2010).
PHALANGES = (0.48, 0.28, 0.24)
OBLIQUE = tuple(np.radians((10.0, 35.0)))  # between an oblique press and the skin's normal [rad]
TIP, RISE, FRONT = 9e-3, 6e-3, 25e-3  # half a last phalanx; see `oblique` [m]
ROLLED = (1e-3, 5e-3)  # how far a contact wanders while it is held [m]
LEAST_SHARE = 0.15  # of the mean load of the pieces that touch: less is not felt at all


@dataclass(frozen=True, slots=True)
class Body:
    """A round piece that is pressed on the skin.

    Attributes
    ----------
    start, end : (2,) float
        Ends of its axis in the plane of the skin [m]; the same point for a ball.
    radius : float
        Across its axis [m].
    bow : float
        How the axis itself is bent away from the skin, as a curvature [1/m]; a phalanx is.
    force : float
        [N].
    stiffness : float
        Of the body alone, as a foundation: pressure for each metre of depth [N/m3].
    follows : float
        How much of the skin's bend along its axis it follows: joints do, 1 all of it.
    ceiling : float
        No higher pressure, as under the air of a ball [Pa].
    lean : (2,) float
        How steeply it rises from the skin along the plane, as under an oblique press.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    radius: float
    bow: float
    force: float
    stiffness: float
    follows: float = 0.0
    ceiling: float = float("inf")
    lean: tuple[float, float] = (0.0, 0.0)

    @property
    def axis(self) -> tuple[float, FloatArray]:
        """Length of the axis [m] and its direction (2,), along x for a ball."""
        way = np.subtract(self.end, self.start)
        length = float(np.hypot(*way))
        return length, way / length if length > 0 else np.array([1.0, 0.0])

    @property
    def middle(self) -> FloatArray:
        """(2,) middle of the axis [m]."""
        return np.asarray(0.5 * (np.array(self.start) + np.array(self.end)))

    def footprint(self, pressed: float) -> Pad:
        """The part of the plane that it may touch, as wide as `pressed` says [m]."""
        return Pad(self.start, self.end, min(pressed, self.radius), 1.0)


@dataclass(frozen=True, slots=True)
class Draw:
    """Draws from ranges as far as the variety says.

    Attributes
    ----------
    rng : numpy.random.Generator
    variety : float
        Random spread, 0 to 1.
    hand : float
        Size of the hand, 1 = adult.
    strength : float
        How firmly, 1 = as most.
    """

    rng: np.random.Generator
    variety: float
    hand: float
    strength: float = 1.0

    def within(self, low: float, high: float) -> float:
        """A number of the middle `variety` of a range."""
        middle, half = 0.5 * (low + high), 0.5 * (high - low) * self.variety
        return float(self.rng.uniform(middle - half, middle + half))

    def ratio(self, low: float, high: float) -> float:
        """The same on a logarithmic scale."""
        return float(np.exp(self.within(np.log(low), np.log(high))))

    def force(self, low: float, high: float) -> float:
        """A force [N] of who touches."""
        return self.strength * self.ratio(low, high)

    def length(self, low: float, high: float) -> float:
        """A length of the hand [m] from adult millimetres."""
        return 1e-3 * self.hand * self.within(low, high)


def shared(bodies: list[Body], force: float, draw: Draw, uneven: float) -> list[Body]:
    """The bodies with a total force [N] shared by their weights, which is unevenly; few none."""
    weight = np.array([body.force for body in bodies])
    weight = weight * np.exp(draw.rng.normal(0.0, uneven * draw.variety, len(bodies)))
    keep = weight >= LEAST_SHARE * weight.mean()
    weight = np.where(keep, weight, 0.0)
    loads = force * weight / weight.sum()
    return [
        replace(body, force=float(load))
        for body, load, own in zip(bodies, loads, keep, strict=True)
        if own
    ]


def oblique(bodies: list[Body], rng: np.random.Generator) -> list[Body]:
    """The bodies as they come in at 10 to 35 degrees: each leans, and those in front carry more.

    A fingertip lies on along its last phalanx; what is long gives way until it rises by `RISE`.
    """
    turn, rise = float(rng.uniform(0.0, 2.0 * np.pi)), float(np.tan(rng.uniform(*OBLIQUE)))
    ahead = np.array([np.cos(turn), np.sin(turn)])
    front = np.array([body.middle @ ahead for body in bodies])
    share = np.array([body.force for body in bodies]) * np.exp(
        -rise * (front - front.mean()) / FRONT
    )
    share *= sum(body.force for body in bodies) / share.sum()
    found = []
    for body, force in zip(bodies, share.tolist(), strict=True):
        half = 0.5 * np.subtract(body.end, body.start)
        if body.stiffness < STIFF and np.hypot(*half) < TIP:
            half = float(rng.uniform(0.5, 1.0)) * TIP * ahead
        lean = min(rise, RISE / max(abs(float(half @ ahead)), 1e-4)) * ahead
        middle = body.middle
        found.append(
            replace(
                body, start=pair(middle - half), end=pair(middle + half), force=force,
                lean=pair(lean),
            )
        )  # fmt: skip
    return found


def rolled(bodies: list[Body], rng: np.random.Generator) -> list[Body]:
    """The bodies after they rolled and dragged the skin along, all by 1 to 5 mm one way."""
    turn, far = float(rng.uniform(0.0, 2.0 * np.pi)), float(rng.uniform(*ROLLED))
    return shifted(bodies, far * np.array([np.cos(turn), np.sin(turn)]))


def shifted(bodies: Sequence[Body], by: FloatArray) -> list[Body]:
    """Bodies moved along the plane by a step (2,) [m]."""
    return [replace(one, start=pair(by + one.start), end=pair(by + one.end)) for one in bodies]


def fingertip(at: tuple[float, float], weight: float, draw: Draw) -> Body:
    """A pulp: 6 to 9.5 mm of radius, pressed straight or a little along the finger."""
    half = draw.length(0.0, 3.0)
    angle = draw.rng.uniform(0.0, np.pi)
    reach = half * np.array([np.cos(angle), np.sin(angle)])
    start, end = np.array(at) - reach, np.array(at) + reach
    radius = draw.length(6.0, 9.5)
    flesh = draw.ratio(*FLESH)
    return Body(pair(start), pair(end), radius, 0.0, weight, flesh)


def phalanges(
    base: FloatArray, direction: FloatArray, lengths: list[float], radius: float, draw: Draw
) -> list[Body]:
    """A finger from its base: a body for each phalanx with its own bow, in one line."""
    bodies = []
    at, flesh = base, draw.ratio(*FLESH)
    for length in lengths:
        far = at + length * direction
        # The pulp bulges between the creases: the axis is shorter than the bone, and bent.
        inset = draw.within(0.1, 0.35) * length * direction
        bodies.append(
            Body(
                pair(at + inset),
                pair(far - inset),
                radius * draw.within(0.85, 1.15),
                draw.within(0.0, 24.0),
                length,
                flesh,
                draw.within(0.0, 0.6),
            )
        )
        at = far
    return bodies


def poke(draw: Draw) -> list[Body]:
    """One fingertip, straight on, with 0.8 to 6 N."""
    return [fingertip((0.0, 0.0), draw.force(0.8, 6.0), draw)]


def full_finger(draw: Draw) -> list[Body]:
    """One finger laid down: stretched in one piece, or as two or three uneven phalanges."""
    total = draw.length(58.0, 86.0)
    radius = draw.length(6.5, 10.0)
    force = draw.force(1.5, 10.0)
    if draw.rng.random() < 0.4:  # stretched so far that it is nearly straight
        start = np.array([-0.5 * total, 0.0])
        flesh, bow = draw.ratio(*FLESH), draw.within(0.0, 8.0)
        follows = draw.within(0.3, 0.95)
        return [Body(pair(start), pair(-start), radius, bow, force, flesh, follows)]
    shares = np.array(PHALANGES)
    first = 1 if draw.rng.random() < 0.4 * draw.variety else 0  # the base hangs in the air
    lengths = (1.25 if first else 1.0) * total * shares[first:]
    base = np.array([-0.5 * lengths.sum(), 0.0])
    line = phalanges(base, np.array([1.0, 0.0]), lengths.tolist(), radius, draw)
    return shared(line, force, draw, 0.4)


def three_finger(draw: Draw) -> list[Body]:
    """Thumb against index and middle finger: three tips, with 2 to 12 N together."""
    opening, between = draw.length(38.0, 66.0), draw.length(18.0, 27.0)
    skew = draw.within(-8e-3, 8e-3)
    ends = [(-opening / 2, skew), (opening / 2, -between / 2), (opening / 2, between / 2)]
    tips = [fingertip(end, 1.0, draw) for end in ends]
    return shared(tips, draw.force(2.0, 12.0), draw, 0.25)


def whole_hand(draw: Draw) -> list[Body]:
    """Palm and fingers round the body: islands of the palm and phalanges, with 5 to 30 N."""
    width = draw.length(70.0, 88.0)
    bodies = _palm(width, draw)
    for finger, reach in enumerate((0.85, 1.0, 0.95, 0.75)):
        y = (finger - 1.5) * 0.25 * width
        spread = draw.within(-0.15, 0.15) + 0.08 * (finger - 1.5)
        direction = np.array([np.cos(spread), np.sin(spread)])
        total = reach * draw.length(62.0, 80.0)
        lengths = (total * np.array(PHALANGES)).tolist()
        line = phalanges(
            np.array([0.46 * width, y]), direction, lengths, draw.length(6.5, 9.0), draw
        )
        # One phalanx in three does not reach the skin, and now and then a whole finger.
        gone = draw.rng.random(3) < 0.35 * draw.variety
        if draw.rng.random() < 0.12 * draw.variety:
            gone[:] = True
        bodies += [one for one, lost in zip(line, gone, strict=True) if not lost]
    thumb = np.array([-0.15 * width, -0.45 * width])
    away = draw.within(-0.6, 0.4)
    direction = np.array([np.sin(away), -np.cos(away)])
    bodies += phalanges(
        thumb, direction, [draw.length(28, 34), draw.length(22, 28)], draw.length(8, 10.5), draw
    )
    return shared(bodies, draw.force(5.0, 30.0), draw, 0.4)


def _palm(width: float, draw: Draw) -> list[Body]:
    """The palm: one soft cushion, or the balls of thumb and hand and the heads of the bones."""
    flesh = draw.ratio(*FLESH)
    if draw.rng.random() < 0.2:  # a limp hand: all of it lies on
        half = 0.2 * width
        return [Body((0.0, -half), (0.0, half), 0.6 * width, 10.0, 0.12, 0.5 * flesh)]
    islands = [
        ((-0.22, -0.30), (0.05, -0.22), 0.32, 0.030),  # ball of the thumb
        ((-0.30, 0.28), (0.08, 0.33), 0.28, 0.026),  # ball of the hand
        *(((0.33, (k - 1.5) * 0.24), (0.40, (k - 1.5) * 0.24), 0.16, 0.012) for k in range(4)),
    ]
    bodies = []
    for start, end, radius, weight in islands:
        small = radius < 0.2
        if draw.rng.random() < (0.35 if small else 0.15) * draw.variety:
            continue
        ends = [pair(width * np.array(end_) + draw.rng.normal(0, 2e-3, 2)) for end_ in (start, end)]
        bodies.append(
            Body(ends[0], ends[1], width * radius * draw.within(0.7, 1.3), 12.0, weight, flesh)
        )
    return bodies


def elbow(draw: Draw) -> list[Body]:
    """The point of an elbow: bone under little flesh, with 3 to 20 N."""
    half, radius = draw.length(0.5, 5.0), draw.length(13.0, 26.0)
    force, flesh = draw.force(3.0, 20.0), draw.ratio(3e7, 2e8)
    return [Body((-half, 0.0), (half, 0.0), radius, 0.0, force, flesh)]


def forearm(draw: Draw) -> list[Body]:
    """The fleshy side of a forearm laid on, with 4 to 30 N."""
    half, radius = draw.length(40.0, 75.0), draw.length(30.0, 48.0)
    force, flesh = draw.force(4.0, 30.0), draw.ratio(0.4e7, 1.6e7)
    return [Body((-half, 0.0), (half, 0.0), radius, draw.within(0.0, 3.0), force, flesh)]


def ball(draw: Draw) -> list[Body]:
    """An inflated ball, with 3 to 25 N under the even pressure of its air, 8 to 30 kPa."""
    radius, force = 1e-3 * draw.within(55.0, 120.0), draw.force(3.0, 25.0)
    return [Body((0.0, 0.0), (0.0, 0.0), radius, 0.0, force, STIFF, 0.0, draw.ratio(8e3, 30e3))]


def edge(draw: Draw) -> list[Body]:
    """The straight edge of a board or table: rounded by 1 to 3 mm, with 3 to 25 N."""
    half, radius = 1e-3 * draw.within(25.0, 60.0), 1e-3 * draw.within(1.5, 3.5)
    return [Body((-half, 0.0), (half, 0.0), radius, 0.0, draw.force(3.0, 25.0), STIFF)]


def cylinder(draw: Draw) -> list[Body]:
    """A bottle or a pole lying on the skin, with 4 to 30 N."""
    half, radius = 1e-3 * draw.within(30.0, 70.0), 1e-3 * draw.within(20.0, 40.0)
    return [Body((-half, 0.0), (half, 0.0), radius, 0.0, draw.force(4.0, 30.0), STIFF)]


def pair(point: FloatArray) -> tuple[float, float]:
    """A point (2,) as plain numbers."""
    return float(point[0]), float(point[1])


HANDS: dict[str, Callable[[Draw], list[Body]]] = {
    made.__name__: made
    for made in (poke, full_finger, three_finger, whole_hand, elbow, forearm, ball, edge, cylinder)
}


SIDES = 10  # straight pieces that a ring is made of


def several_fingers(draw: Draw) -> list[Body]:
    """Two, four or five fingertips in a bow, the thumb opposite of four, with 1.5 to 15 N."""
    count = int(draw.rng.choice((2, 4, 5)))
    between, opening = draw.length(18.0, 28.0), draw.length(38.0, 75.0)
    fingers = min(count, 4)
    rows = (np.arange(fingers) - 0.5 * (fingers - 1)) * between
    ends = [(opening / 2 - 2.0 * y * y, float(y)) for y in rows.tolist()]
    if count == 5:
        ends.append((-opening / 2, draw.within(-10e-3, 10e-3)))
    tips = [fingertip(end, 1.0, draw) for end in ends]
    return shared(tips, draw.force(0.9 * count, 3.0 * count), draw, 0.25)


def grasp(draw: Draw) -> list[Body]:
    """Three or four fingers laid side by side and the thumb against them, with 4 to 25 N."""
    bodies, between = [], draw.length(18.0, 24.0)
    count = int(draw.rng.choice((3, 4)))
    for finger in range(count):
        total = draw.length(55.0, 85.0)
        base = np.array([draw.length(8.0, 22.0), (finger - 0.5 * (count - 1)) * between])
        lengths = (total * np.array(PHALANGES)).tolist()
        line = phalanges(base, np.array([1.0, 0.0]), lengths, draw.length(6.5, 9.5), draw)
        gone = draw.rng.random(3) < 0.3 * draw.variety
        bodies += [one for one, lost in zip(line, gone, strict=True) if not lost]
    thumb = np.array([-draw.length(10.0, 25.0), draw.within(-12e-3, 12e-3)])
    lengths = [draw.length(28.0, 34.0), draw.length(22.0, 28.0)]
    bodies += phalanges(thumb, np.array([-1.0, 0.0]), lengths, draw.length(8.0, 10.5), draw)
    return shared(bodies, draw.force(4.0, 25.0), draw, 0.4)


def hard_ball(draw: Draw) -> list[Body]:
    """A wooden or rubber ball of 24 to 90 mm, with 2 to 20 N."""
    radius = 1e-3 * draw.within(12.0, 45.0)
    return [Body((0.0, 0.0), (0.0, 0.0), radius, 0.0, draw.force(2.0, 20.0), STIFF)]


def rod(draw: Draw) -> list[Body]:
    """A thin rod or a tool's handle: 6 to 18 mm thick, with 2 to 20 N."""
    half, radius = 1e-3 * draw.within(25.0, 70.0), 1e-3 * draw.within(3.0, 9.0)
    return [Body((-half, 0.0), (half, 0.0), radius, 0.0, draw.force(2.0, 20.0), STIFF)]


def ring(draw: Draw) -> list[Body]:
    """The rim of a cup or the end of a tube, 24 to 80 mm wide, with 3 to 25 N."""
    across, thick = 1e-3 * draw.within(12.0, 40.0), 1e-3 * draw.within(1.5, 4.0)
    turn = np.arange(SIDES + 1) * 2.0 * np.pi / SIDES
    corners = across * np.column_stack([np.cos(turn), np.sin(turn)])
    return _pieces(corners, thick, draw.force(3.0, 25.0), draw, 0.3)


def corner(draw: Draw) -> list[Body]:
    """The corner of a box, and the two edges that leave it, with 2 to 18 N."""
    far, thick = 1e-3 * draw.within(8.0, 40.0), 1e-3 * draw.within(1.5, 4.0)
    ends = np.array([[far, 0.0], [0.0, 0.0], [0.0, far * draw.within(0.4, 1.0)]])
    tip = Body((0.0, 0.0), (0.0, 0.0), 1.5 * thick, 0.0, 1.0, STIFF)
    edges = _pieces(ends, thick, draw.ratio(0.3, 1.5), draw, 0.3)
    return shared([tip, *edges], draw.force(2.0, 18.0), draw, 0.3)


def table_edge(draw: Draw) -> list[Body]:
    """The rounded edge of a table top: 8 to 30 mm thick and long, with 4 to 40 N."""
    half, radius = 1e-3 * draw.within(50.0, 110.0), 1e-3 * draw.within(4.0, 15.0)
    return [Body((-half, 0.0), (half, 0.0), radius, 0.0, draw.force(4.0, 40.0), STIFF)]


def plate(draw: Draw) -> list[Body]:
    """A flat board or a wall, hardly bent, with 4 to 40 N."""
    half, radius = 1e-3 * draw.within(15.0, 50.0), draw.ratio(0.12, 0.6)
    return [Body((-half, 0.0), (half, 0.0), radius, 0.0, draw.force(4.0, 40.0), STIFF)]


def gripper(draw: Draw) -> list[Body]:
    """The two fingers of a gripper, 8 to 26 mm broad and 25 to 85 mm apart, with 4 to 30 N."""
    apart, half = 1e-3 * draw.within(25.0, 85.0), 1e-3 * draw.within(4.0, 13.0)
    thick = 1e-3 * draw.within(3.0, 10.0)
    jaws = [
        Body((x, -half), (x, half), thick, 0.0, 1.0, STIFF) for x in (-apart / 2, apart / 2)
    ]  # fmt: skip
    return shared(jaws, draw.force(4.0, 30.0), draw, 0.15)


def link(draw: Draw) -> list[Body]:
    """A link of another robot: a hard limb of 60 to 140 mm, with 4 to 40 N."""
    half, radius = 1e-3 * draw.within(40.0, 90.0), 1e-3 * draw.within(30.0, 70.0)
    bow = draw.within(0.0, 4.0)
    return [Body((-half, 0.0), (half, 0.0), radius, bow, draw.force(4.0, 40.0), STIFF)]


def shoulder(draw: Draw) -> list[Body]:
    """A shoulder leant on: round flesh of 90 to 160 mm, with 6 to 50 N."""
    half, radius = draw.length(0.0, 25.0), draw.length(45.0, 80.0)
    force, flesh = draw.force(6.0, 50.0), draw.ratio(0.5e7, 2.5e7)
    return [Body((-half, 0.0), (half, 0.0), radius, 0.0, force, flesh)]


def _pieces(
    corners: np.ndarray, thick: float, force: float, draw: Draw, uneven: float
) -> list[Body]:
    """A bent bar through corners (k, 2), each straight piece with its share of the force."""
    ends = [pair(corner) for corner in corners]
    bars = [
        Body(a, b, thick, 0.0, float(np.hypot(b[0] - a[0], b[1] - a[1])), STIFF)
        for a, b in pairwise(ends)
    ]
    return shared(bars, force, draw, uneven)


THINGS: dict[str, Callable[[Draw], list[Body]]] = {
    made.__name__: made
    for made in (
        several_fingers, grasp, hard_ball, rod, ring, corner, table_edge, plate, gripper, link,
        shoulder,
    )
}  # fmt: skip
BODIES = {**HANDS, **THINGS}
STILL = (*GESTURES, *THINGS)  # all touches that stay
EVERY = (*STILL, *TIME)  # names of gestures
HAND = ("poke", "full_finger", "three_finger", "whole_hand", "several_fingers", "grasp")
OTHER = tuple(name for name in STILL if name not in HAND)
SETS = {
    "four": FOUR, "eight": EIGHT, "all": tuple(GESTURES), "hand": HAND, "other": OTHER,
    "time": TIME,
}  # fmt: skip
NAMES = (*EVERY, *SETS)  # all that names gestures


def gesture_set(names: Sequence[str]) -> tuple[str, ...]:
    """Names of gestures, sets and names with commas between written out.

    `four` (the default), `eight`, `all` (those of both papers and `cylinder`), `hand` and `other`
    (that a hand is told from), `time`.

    Raises
    ------
    UnknownNameError
        A name that is neither a gesture nor a set.
    """
    words = [word.strip() for name in names for word in name.split(",")] or ["four"]
    check_known("gesture", words, NAMES)
    return tuple(dict.fromkeys(one for word in words for one in SETS.get(word, (word,))))
