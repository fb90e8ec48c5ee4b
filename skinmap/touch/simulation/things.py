"""More hands and things that press, as round bodies: those that a hand is told from.

With `hands`, these are the touches that `hand` or `other` is learnt from (docs/touches.md). Sizes
are those of things about a robot: table tops, boxes, tools, the fingers of grippers, limbs. All are
estimated; docs/simulator.md lists them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from skinmap.errors import check_known
from skinmap.touch.simulation.gestures import EIGHT, FOUR, GESTURES, TIME
from skinmap.touch.simulation.hands import (
    HANDS,
    PHALANGES,
    STIFF,
    Body,
    Draw,
    fingertip,
    phalanges,
    shared,
)

SIDES = 10  # straight pieces that a ring is made of
Point = tuple[float, float]


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
    ends: list[Point] = [(float(x), float(y)) for x, y in corners]
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
