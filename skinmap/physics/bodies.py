"""Hands and things that press: rigid pieces on joints, with flesh around them as capsules.

All lie above the plane of the skin around the place that is touched: x and y along it, z outward,
a finger points along x and bends towards the skin about y. Sizes are those of an adult and scale
with the hand: phalanges of 44, 26 and 18 mm (Buryanov and Kotiuk, Int. J. Morphol. 28(3), 2010),
fingers 15 to 19 mm thick, palms 75 to 85 mm wide (Pheasant, "Bodyspace", 1996). Forces of people
who touch somebody, and the shapes of elbows, forearms and things, are estimated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.physics.variants import Variant
from skinmap.touch.simulation.hands import STIFF, THINGS, Body, Draw, pair

Point = tuple[float, float, float]
PHALANGES = (44e-3, 26e-3, 18e-3)  # from the knuckle to the tip, of an index finger [m]
FINGERS = (0.92, 1.0, 0.94, 0.76)  # lengths, index first, of the longest
PALM = 0.4  # its pads are thicker and softer than a finger's
PULP = 0.55  # of a phalanx's radius is left free at both of its creases


@dataclass(frozen=True, slots=True)
class Capsule:
    """All points within a radius of a segment [m], in the frame of its piece."""

    start: Point
    end: Point
    radius: float


@dataclass(frozen=True, slots=True)
class Piece:
    """A rigid piece that turns about y at `at`, in the frame of the piece that carries it.

    Attributes
    ----------
    flesh : tuple of Capsule
    at : (3,) float
        [m].
    bend : float
        Angle at rest [rad], positive towards the skin.
    turn : float
        Angle about z at which it is fixed [rad].
    torque : float
        Towards the skin at full press [N m].
    further : tuple of Piece
        What it carries.
    firm : float
        Stiffness of its flesh, 1 = a finger's.
    """

    flesh: tuple[Capsule, ...]
    at: Point = (0.0, 0.0, 0.0)
    bend: float = 0.0
    turn: float = 0.0
    torque: float = 0.0
    further: tuple[Piece, ...] = ()
    firm: float = 1.0


@dataclass(frozen=True, slots=True)
class Mount:
    """A piece that an arm pushes at the skin from a spot of the plane.

    Attributes
    ----------
    spot : (2,) float
        [m].
    piece : Piece
    force : float
        Towards the skin at full press [N].
    tilt : float
        Stiffness against tilting [N m / rad].
    """

    spot: tuple[float, float]
    piece: Piece
    force: float
    tilt: float = 0.3


@dataclass(frozen=True, slots=True)
class Presser:
    """What one touch is made with: mounts, and points of the plane (m, 2) that must have skin."""

    mounts: tuple[Mount, ...]
    footprint: FloatArray = field(repr=False)


def poke(rng: np.random.Generator, hand: float, variant: Variant) -> Presser:
    """One fingertip, on its point or on its pulp."""
    tip = _tip(rng, hand, lean=rng.uniform(0.5, 1.4))
    return Presser((Mount((0.0, 0.0), tip, _force(rng, variant, 3.0)),), np.zeros((1, 2)))


def full_finger(rng: np.random.Generator, hand: float, variant: Variant) -> Presser:
    """One finger laid down along its three phalanges, the two last ones bent by its tendons."""
    push = _force(rng, variant, 4.0)
    lengths = hand * np.array(PHALANGES) * rng.uniform(0.92, 1.08)
    middle = float(lengths.sum()) / 2.0
    piece = _phalanges(rng, lengths, _thickness(rng, hand), variant, push)
    along = np.linspace(-middle, middle, 9)
    mount = Mount((-middle, 0.0), piece, push, tilt=5.0)
    return Presser((mount,), np.column_stack([along, np.zeros(9)]))


def three_finger(rng: np.random.Generator, hand: float, variant: Variant) -> Presser:
    """Thumb against index and middle finger: three fingertips, apart."""
    opening, between = hand * rng.uniform(40e-3, 62e-3), hand * rng.uniform(19e-3, 25e-3)
    skew = rng.uniform(-8e-3, 8e-3)
    spots = [(-opening / 2, skew), (opening / 2, -between / 2), (opening / 2, between / 2)]
    push = _force(rng, variant, 2.2)
    lean = rng.uniform(0.6, 1.3)
    mounts = tuple(
        Mount(spot, _tip(rng, hand, lean=lean, turn=turn), push * float(rng.uniform(0.7, 1.3)))
        for spot, turn in zip(spots, (0.0, np.pi, np.pi), strict=True)
    )
    return Presser(mounts, np.array(spots))


def whole_hand(rng: np.random.Generator, hand: float, variant: Variant) -> Presser:
    """A palm with its pads, four fingers and the thumb that close round the body."""
    push = _force(rng, variant, 12.0)
    width = hand * rng.uniform(75e-3, 85e-3)
    grip = push * rng.uniform(0.06, 0.14)  # of a finger [N]
    height = 9e-3 * hand - 0.15 * width  # of the fingers' axes: as low as the pads
    fingers = []
    for number, reach in enumerate(FINGERS):
        lengths = hand * reach * np.array(PHALANGES) * rng.uniform(0.95, 1.05)
        fingers.append(
            _phalanges(
                rng,
                lengths,
                hand * 7.5e-3,
                variant,
                grip * float(rng.uniform(0.6, 1.3)),
                at=(0.5 * width, (1.5 - number) * 0.25 * width, height),
                turn=float(rng.normal((1.5 - number) * 0.06, 0.03)),
            )
        )
    lengths = hand * np.array([34e-3, 26e-3])
    thumb = _phalanges(
        rng, lengths, hand * 9e-3, variant, grip * 1.3, at=(0.0, 0.48 * width, height), turn=0.9
    )
    palm = Piece(
        _palm(width, float(rng.uniform(*variant.hollow))), further=(*fingers, thumb), firm=PALM
    )
    reach = 0.5 * width + 0.7 * hand * sum(PHALANGES)
    along, across = np.linspace(-0.45 * width, reach, 9), np.linspace(-0.4, 0.4, 5) * width
    middle = (reach - 0.45 * width) / 2.0
    footprint = np.stack(np.meshgrid(along - middle, across), -1).reshape(-1, 2)
    return Presser((Mount((-middle, 0.0), palm, push, tilt=4.0),), footprint)


def elbow(rng: np.random.Generator, hand: float, variant: Variant) -> Presser:
    """The point of an elbow: a bone, hardly covered."""
    return _thing(
        rng, variant, hand * rng.uniform(11e-3, 17e-3), hand * rng.uniform(2e-3, 8e-3), 8.0
    )


def forearm(rng: np.random.Generator, hand: float, variant: Variant) -> Presser:
    """The fleshy side of a forearm laid on."""
    length = hand * rng.uniform(80e-3, 150e-3)
    return _thing(rng, variant, hand * rng.uniform(30e-3, 42e-3), length, 12.0)


def ball(rng: np.random.Generator, hand: float, variant: Variant) -> Presser:
    """A ball of 10 to 18 cm."""
    del hand
    return _thing(rng, variant, rng.uniform(50e-3, 90e-3), 0.0, 6.0)


def edge(rng: np.random.Generator, hand: float, variant: Variant) -> Presser:
    """The straight, hardly rounded edge of a board or a table."""
    del hand
    return _thing(rng, variant, rng.uniform(1.5e-3, 3e-3), rng.uniform(50e-3, 120e-3), 6.0)


def cylinder(rng: np.random.Generator, hand: float, variant: Variant) -> Presser:
    """A bottle or a pole lying on the skin."""
    del hand
    return _thing(rng, variant, rng.uniform(20e-3, 38e-3), rng.uniform(60e-3, 140e-3), 8.0)


Pressing = Callable[[np.random.Generator, float, Variant], Presser]


def _pressed(name: str) -> Pressing:
    """A touch of `things` as MuJoCo presses it: fingers each by itself, a thing in one piece."""

    def presser(rng: np.random.Generator, hand: float, variant: Variant) -> Presser:
        bodies = THINGS[name](Draw(rng, 1.0, hand))
        push = _force(rng, variant, 1.0)
        ends = np.array([[body.start, body.end] for body in bodies])
        middle = ends.mean(axis=(0, 1))
        ends = ends - middle
        along = np.linspace(0.0, 1.0, 5)[:, None, None]
        footprint = (ends[:, 0] + along * (ends[:, 1] - ends[:, 0])).reshape(-1, 2)
        if bodies[0].stiffness < STIFF and len(bodies) > 1:
            mounts = [
                Mount(
                    pair(body.middle - middle),
                    Piece((_capsule(body, body.middle),)),
                    push * body.force,
                    tilt=0.05,
                )
                for body in bodies
            ]
            return Presser(tuple(mounts), footprint)
        piece = Piece(tuple(_capsule(body, middle) for body in bodies))
        force = push * sum(body.force for body in bodies)
        return Presser((Mount((0.0, 0.0), piece, force, tilt=0.5),), footprint)

    return presser


def _capsule(body: Body, middle: FloatArray) -> Capsule:
    """A body around its own middle; all of one piece reach as far towards the skin."""
    (ax, ay), (bx, by) = np.subtract(body.start, middle), np.subtract(body.end, middle)
    return Capsule((ax, ay, body.radius), (bx, by, body.radius), body.radius)


PRESSERS: dict[str, Pressing] = {
    made.__name__: made
    for made in (poke, full_finger, three_finger, whole_hand, elbow, forearm, ball, edge, cylinder)
}
PRESSERS.update({name: _pressed(name) for name in THINGS})


def _force(rng: np.random.Generator, variant: Variant, median: float) -> float:
    """[N], log-normal around the median of people [N]."""
    return median * variant.force * float(np.exp(rng.normal(0.0, variant.force_spread)))


def _thickness(rng: np.random.Generator, hand: float) -> float:
    return hand * float(rng.uniform(7.5e-3, 9.5e-3))


def _tip(rng: np.random.Generator, hand: float, *, lean: float, turn: float = 0.0) -> Piece:
    """The last phalanx, standing on its tip and leaning back by an angle from the skin [rad]."""
    radius, length = _thickness(rng, hand) * 0.9, hand * PHALANGES[-1]
    back = (-length * float(np.cos(lean)), 0.0, length * float(np.sin(lean)))
    return Piece((Capsule((0.0, 0.0, 0.0), back, radius),), turn=turn)


def _phalanges(
    rng: np.random.Generator,
    lengths: FloatArray,
    radius: float,
    variant: Variant,
    load: float,
    *,
    at: Point = (0.0, 0.0, 0.0),
    turn: float = 0.0,
) -> Piece:
    """A finger from knuckle to tip, pulled by its tendons so that a load [N] lies evenly."""
    ends = np.cumsum(lengths[::-1])[::-1]  # from each joint to the tip
    piece: tuple[Piece, ...] = ()
    for number in reversed(range(len(lengths))):
        length = float(lengths[number])
        thick = radius * (1.0 - 0.06 * number)
        last = number == len(lengths) - 1
        free = PULP * thick
        flesh = Capsule(
            (free, 0.0, 0.0), (length - (0.6 * thick if last else free), 0.0, 0.0), thick
        )
        piece = (
            Piece(
                (flesh,),
                at if number == 0 else (float(lengths[number - 1]), 0.0, 0.0),
                bend=float(rng.normal(0.0, variant.bend)),
                turn=turn if number == 0 else 0.0,
                torque=load * float(ends[number]) ** 2 / (2.0 * float(ends[0])),
                further=piece,
            ),
        )
    return piece[0]


def _palm(width: float, hollow: float) -> tuple[Capsule, ...]:
    """Ball of the thumb, ball of the little finger, the row of knuckles, and a hollow middle."""
    w, low = width, -0.15 * width  # the pads lie in one plane
    pads = (
        ((-0.42, 0.22), (-0.02, 0.32), 0.2, 0.0),
        ((-0.42, -0.24), (0.08, -0.3), 0.18, 0.0),
        ((0.38, -0.34), (0.38, 0.34), 0.14, 0.0),
        ((-0.1, 0.0), (0.12, 0.0), 0.16, hollow),
    )
    return tuple(
        Capsule(
            (w * start[0], w * start[1], low + w * thick + lifted),
            (w * end[0], w * end[1], low + w * thick + lifted),
            w * thick,
        )
        for start, end, thick, lifted in pads
    )


def _thing(
    rng: np.random.Generator, variant: Variant, radius: float, length: float, median: float
) -> Presser:
    """A capsule lying on the skin."""
    half = length / 2.0
    piece = Piece((Capsule((-half, 0.0, 0.0), (half, 0.0, 0.0), radius),))
    count = 1 + 2 * int(half / 5e-3)
    along = np.linspace(-half, half, count) if count > 1 else np.zeros(1)
    mount = Mount((0.0, 0.0), piece, _force(rng, variant, median), tilt=0.5)
    return Presser((mount,), np.column_stack([along, np.zeros(count)]))
