"""Simulated touches on an imported skin: what the classifiers are trained and shown on.

A touch is laid on the skin around a point: its pieces live in the log map of that point, so
fingers follow the body and cross the gaps between patches. With variety the pieces are bodies with
a force (`hands`) on a bed of springs (`elastic_bed`). Without, and now and then with it, they are
pads of fixed sizes (`gestures`): pressure inside a pad falls off like Hertz contact, spreads
through the foam as a Gaussian, and what is not a hand loses its load where the skin bends away.
Taxels read loads as `sensing` says. Somebody (`subjects`) presses, holds with a tremor, lets go.

The physics and its limits are in docs/simulator.md. Accuracy on such touches is simulated accuracy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, get_args

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.geometry.log_maps import LogMaps
from skinmap.geometry.point_surface import PointSurface
from skinmap.geometry.proximity import bridged_graph
from skinmap.geometry.rigid import plane_turns
from skinmap.skin.skin import Skin, fingerprint
from skinmap.touch.recording import Recording, TrueMotion
from skinmap.touch.simulation.elastic_bed import bed_loads, contact_width
from skinmap.touch.simulation.gestures import FOUR, GESTURES, LONG_ON_SKIN, ON_SKIN, TIME, Pad
from skinmap.touch.simulation.hands import BODIES, Body, Draw, gesture_set, oblique, rolled
from skinmap.touch.simulation.moving_touches import TIME_GESTURES, Timing, bed_press, lay
from skinmap.touch.simulation.variety import (
    DEFAULT,
    FULL_SCALE,
    GRIPS,
    HABIT_SHIFT,
    HABIT_TURN,
    HABITS,
    LEANS,
    ROLLS,
    Habit,
    Places,
    Sensing,
    Sensors,
    Subject,
    beyond,
    check_variety,
    draw_foam,
    draw_sensing,
    draw_subjects,
    happens,
    on_skin_of,
    over_rim_of,
    uses_pads,
)

SENSING = Sensing()
RATE = SENSING.rate
NOISE = SENSING.noise
FOAM = SENSING.foam
SUBJECTS = 10
REACH = 0.13  # no pad goes further from its middle [m]
GAP = 0.25  # pause between touches [s]
TRIES = 60  # places tried for one touch
FELT = 0.15  # load that any taxel tells from noise, 24 counts on the usual one
FINGER_FELT, PIECES_FELT = 0.5, 0.4
MISSES = 3  # touches that found no place before the part counts as too small for the gesture


@dataclass(frozen=True, eq=False)
class Stage:
    """What touches on one skin share: its graph, spacing, sensors, habitual places, variety."""

    skin: Skin
    graph: csr_array
    spacing: float
    sensors: Sensors
    habits: dict[str, tuple[Habit, ...]]
    variety: float = 0.0

    @cached_property
    def surface(self) -> PointSurface:
        """What touches that go on in time are laid on."""
        return PointSurface(self.skin.positions, self.skin.normals, self.spacing)

    @cached_property
    def maps(self) -> LogMaps:
        """What still touches are laid on: the plane around each taxel."""
        return LogMaps(self.skin.positions, self.skin.normals, self.graph, REACH)


@dataclass(frozen=True, eq=False, slots=True)
class Placed:
    """A gesture on the skin: the load (p, n) of each piece on each taxel at full press.

    Of one that goes on in time these are its poses; `weights` (t, p) say how much of each there is
    in each sample.
    """

    label: str
    loads: FloatArray
    subject: Subject
    weights: FloatArray | None = None
    motion: TrueMotion | None = None
    rolled: FloatArray | None = None  # `loads` at the end of the hold


def prepare(
    skin: Skin,
    *,
    rng: np.random.Generator,
    sensing: Sensing = SENSING,
    variety: float = 0.0,
) -> Stage:
    """Build the neighbour graph of a skin and draw its sensors and habitual places."""
    spacing = skin.spacing
    graph = bridged_graph(skin.positions, 10, 2.5 * spacing)
    habits = {
        name: tuple(
            Habit(int(rng.integers(len(skin))), float(rng.uniform(0.0, 2.0 * np.pi)))
            for _ in range(HABITS)
        )
        for name in GESTURES
    }
    sensors = Sensors(skin, sensing, rng=rng)
    return Stage(skin, graph, spacing, sensors, habits, check_variety(variety))


def simulate(
    skin: Skin,
    *,
    rng: np.random.Generator | int = 0,
    per_gesture: int = 20,
    gestures: Sequence[str] = FOUR,
    subjects: int = SUBJECTS,
    places: Places = "anywhere",
    sensing: Sensing | None = None,
    variety: float = DEFAULT,
    progress: Callable[[str], None] | None = None,
) -> Recording:
    """Touches on a skin, each gesture equally often, in random order.

    Parameters
    ----------
    skin : Skin
        n taxels.
    rng : numpy.random.Generator or int
        A number is its seed.
    per_gesture : int
        Touches of each gesture. A gesture that does not fit the skin (less than 70 % of it
        over taxels wherever it is tried; 45 % of long things) is left out.
    gestures : sequence of str
        Names from `things.STILL` and `TIME`, or of sets (`things.SETS`: "time", "hand", ...);
        the four of the first paper by default.
    subjects : int
        How many people touch, each with a hand size, force, pace and habits.
    places : {"anywhere", "habitual", "grips"}
        Wherever a touch fits; near the places and angles that people keep to; or grips there and
        all else anywhere.
    sensing : Sensing, optional
        How the taxels answer; drawn as the variety says by default.
    variety : float
        How far touches are drawn at random, see `variety`; 0 are pads of fixed sizes.
    progress : callable, optional
        Called once a touch with the name of the part.

    Returns
    -------
    Recording
        uint8 samples with event numbers, labels and subjects.

    Raises
    ------
    UnknownNameError
        A gesture or a kind of places that does not exist.
    InvalidArrayError
        No gesture, no touch, no subject, a variety beyond 0 to 2, or a seed below 0.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("left_hand")
    >>> recording = skinmap.simulate(skin, per_gesture=2, gestures=["poke"], rng=0)
    >>> recording.labels
    ('poke', 'poke')
    """
    gestures = tuple(gestures)
    gestures = gestures and gesture_set(gestures)
    if places not in get_args(Places):
        raise UnknownNameError("place", places, get_args(Places))
    for what, count in {"per_gesture": per_gesture, "subjects": subjects,
                        "number of gestures": len(gestures)}.items():  # fmt: skip
        if not 1 <= count < np.inf or count != int(count):
            raise InvalidArrayError(f"{what} must be a whole number from 1, got {count}")
    if isinstance(rng, int | np.integer) and rng < 0:
        raise InvalidArrayError(f"a seed must be 0 or more, got {rng}")
    rng, variety = np.random.default_rng(rng), check_variety(variety)
    answers = draw_sensing(variety, rng=rng) if sensing is None else sensing
    stage = prepare(skin, rng=rng, sensing=answers, variety=variety)
    people = draw_subjects(subjects, rng=rng, further=beyond(variety))
    wanted = rng.permutation(np.repeat(np.arange(len(gestures)), per_gesture))
    player = Player(stage, rng)
    missed = dict.fromkeys(gestures, 0)
    for name in (gestures[i] for i in wanted):
        if progress is not None:
            progress(skin.part)
        subject = people[int(rng.integers(len(people)))]
        placed = None
        if missed[name] < MISSES:
            placed = place(stage, name, subject, rng=rng, places=places)
        if placed is None:
            missed[name] += 1
            continue
        player.touch([placed])
    return player.recording()


def touch_loads(stage: Stage, pads: Sequence[Pad], uv: FloatArray) -> FloatArray:
    """(p, n) load of each pad on each taxel at full press, foam spread included.

    Inside a pad of radius R the load falls off as its profile says: sqrt(1 - (d / R)^2) under
    round flesh (Hertz), evenly under an inflated ball or an edge, and half of it in the inner
    third of a bone. Outside, the foam carries the rim on as a Gaussian.
    """
    foam = stage.sensors.sensing.foam
    loads = np.zeros((len(pads), len(uv)))
    near = np.isfinite(uv[:, 0])
    for number, pad in enumerate(pads):
        depth = pad.depth(uv[near])
        inner = np.clip(depth, 0.0, 1.0)
        inside = np.sqrt(1.0 - (1.0 - inner) ** 2)
        if pad.profile == "flat":
            inside = np.minimum(1.0, 4.0 * inner)
        elif pad.profile == "bone":
            inside = 0.3 * inside + 0.7 * inner**2
        outside = np.clip(-depth, 0.0, None) * pad.radius
        rim = 0.35 * np.exp(-0.5 * (outside / foam) ** 2)
        if pad.profile == "bone":
            rim *= inner + (1.0 - inner) / 3.0
        loads[number, near] = pad.strength * (0.65 * inside + rim)
    return loads


def place(
    stage: Stage,
    name: str,
    subject: Subject,
    *,
    rng: np.random.Generator,
    places: Places = "anywhere",
    on_skin: float | None = None,
) -> Placed | None:
    """A gesture at a place where enough of it lies on the skin; None where it fits nowhere."""
    if name in TIME:
        return _place_in_time(stage, name, subject, rng=rng)
    enough = LONG_ON_SKIN.get(name, ON_SKIN) if on_skin is None else on_skin
    enough = on_skin_of(stage.variety, enough, rng)
    drawn = min(stage.variety, 1.0)
    as_pads = name in GESTURES and uses_pads(stage.variety, rng)
    for _ in range(TRIES):
        size = subject.hand * rng.uniform(0.97, 1.03)
        bodies: list[Body] = []
        if as_pads:
            pads = GESTURES[name](rng, size)
        else:
            bodies = BODIES[name](Draw(rng, drawn, size, subject.force))
            if happens(LEANS, stage.variety, rng):
                bodies = oblique(bodies, rng)
            foam = draw_foam(stage.variety, stage.sensors.sensing.foam, rng)
            pads = [body.footprint(contact_width(body, foam.stiffness)) for body in bodies]
        source, angle = _spot(stage, name, subject, places, rng)
        uv = stage.maps.around(source)
        shift = rng.normal(0.0, 0.3 * stage.spacing, 2) + _middle(pads)
        turned = uv @ plane_turns(angle).T + shift
        if subject.left:
            turned[:, 1] *= -1.0
        if covered_share(pads, turned, stage.spacing) < enough:
            continue
        if bodies:
            loads = bed_loads(bodies, foam, turned, stage.skin)
            if is_felt(name, bodies, loads, turned):
                after = None
                if happens(ROLLS, stage.variety, rng):
                    after = bed_loads(rolled(bodies, rng), foam, turned, stage.skin)
                return Placed(name, loads, subject, rolled=after)
            continue
        loads = touch_loads(stage, pads, turned) * _follows(stage, pads, source)
        return Placed(name, subject.force * loads, subject)
    return None


def _place_in_time(
    stage: Stage, name: str, subject: Subject, *, rng: np.random.Generator
) -> Placed | None:
    """A gesture that goes on in time; people make them anywhere, and with bodies alone."""
    timing = Timing(stage.sensors.sensing.rate, rng, subject)
    for _ in range(TRIES):
        size = subject.hand * rng.uniform(0.97, 1.03)
        foam = draw_foam(stage.variety, stage.sensors.sensing.foam, rng)
        draw = Draw(rng, min(stage.variety, 1.0), size, subject.force)
        gesture = TIME_GESTURES[name](draw, timing)
        press = bed_press(stage.skin, stage.graph, stage.surface, gesture, foam)
        over = over_rim_of(stage.variety, rng)
        laid = lay(stage.surface, gesture, press, size, rng=rng, over=over)
        if laid is not None:
            return Placed(name, laid.loads, subject, laid.weights, laid.motion)
    return None


def is_felt(name: str, bodies: Sequence[Body], loads: FloatArray, uv: FloatArray) -> bool:
    """Whether a skin feels enough of a touch to call it by its name.

    All of three fingertips, half of the length of a finger, two fifths of the pieces of anything
    else: what lies over gaps and bends, or hardly presses, is not there for the skin.
    """
    felt = loads > FELT
    if name == "full_finger":
        ends = np.array([[body.start[0], body.end[0]] for body in bodies])
        along = uv[felt.any(axis=0), 0]
        return len(along) > 1 and float(np.ptp(along)) >= FINGER_FELT * float(np.ptp(ends))
    return float(felt.any(axis=1).mean()) >= (1.0 if name == "three_finger" else PIECES_FELT)


def _spot(
    stage: Stage, name: str, subject: Subject, places: Places, rng: np.random.Generator
) -> tuple[int, float]:
    """Taxel and angle to touch at."""
    free = places == "anywhere" or (places == "grips" and name not in GRIPS)
    if free or name not in stage.habits:
        return int(rng.integers(len(stage.skin))), float(rng.uniform(0.0, 2.0 * np.pi))
    # Now and then people leave their habit; a gesture that does not fit there must get away.
    habit = stage.habits[name][subject.habit if rng.random() < 0.8 else int(rng.integers(HABITS))]
    around = stage.skin.positions - stage.skin.positions[habit.taxel]
    target = rng.normal(0.0, HABIT_SHIFT, 3)
    taxel = int(np.argmin(np.linalg.norm(around - target, axis=1)))
    return taxel, habit.angle + float(rng.normal(0.0, HABIT_TURN))


def _follows(stage: Stage, pads: Sequence[Pad], source: int) -> FloatArray:
    """(p, n) share of each pad's load that is left where the skin bends away from under it."""
    step = stage.skin.positions - stage.skin.positions[source]
    sag = np.clip(-step @ stage.skin.normals[source], 0.0, None)
    give = np.array([pad.give for pad in pads])
    return np.asarray(np.clip(1.0 - sag[None, :] / give[:, None], 0.0, 1.0))


def _middle(pads: Sequence[Pad]) -> FloatArray:
    return np.mean([[*pad.start, *pad.end] for pad in pads], axis=0).reshape(2, 2).mean(axis=0)


class Plays:
    """Plays loads one after another into a recording, with a pause after each."""

    def __init__(self, skin: Skin, sensors: Sensors, rng: np.random.Generator) -> None:
        self.skin, self.sensors, self.rng = skin, sensors, rng
        self.rate = sensors.sensing.rate
        self.rest = np.zeros((round(GAP * self.rate), len(skin)))
        self._blocks = [np.zeros((0, len(skin)), np.uint8)]
        self._events = [np.zeros(0, np.int64)]
        self._labels: list[str] = []
        self._subjects: list[int] = []
        self._motions: list[TrueMotion | None] = []

    def play(
        self, label: str, subject: int, loads: FloatArray, motion: TrueMotion | None = None
    ) -> None:
        """Play the loads (t, n) of one event; its true motion counts from their first sample."""
        self._motions.append(None if motion is None else motion.shifted(self.count / self.rate))
        for block, event in ((loads, len(self._labels)), (self.rest, -1)):
            self._blocks.append(self.sensors.read(block, rng=self.rng))
            self._events.append(np.full(len(block), event))
        self._labels.append(label)
        self._subjects.append(subject)

    @property
    def count(self) -> int:
        """Samples so far."""
        return sum(map(len, self._blocks))

    def played(self, kept: BoolArray | slice = slice(None), **known: Any) -> Recording:
        """Everything so far, or the samples that are kept, with what else is known of it."""
        return Recording(
            self.skin.part,
            (np.arange(self.count) / self.rate)[kept],
            np.concatenate(self._blocks)[kept],
            np.concatenate(self._events)[kept],
            tuple(self._labels),
            np.array(self._subjects, np.int64),
            motions=tuple(self._motions) if any(self._motions) else (),
            fingerprint=fingerprint(self.skin),
            **known,
        )


class Player(Plays):
    """Plays touches one after another into a recording, with a pause after each."""

    def __init__(self, stage: Stage, rng: np.random.Generator) -> None:
        super().__init__(stage.skin, stage.sensors, rng)
        self._owners: list[IntArray] = []

    def touch(self, together: Sequence[Placed], starts: Sequence[float] = (0.0,)) -> None:
        """Play touches that overlap in time as one event; each starts at its own time [s]."""
        courses = [loads_over_time(placed, self.rate, self.rng) for placed in together]
        first = [round(start * self.rate) for start in starts]
        total = max(begin + len(one) for begin, one in zip(first, courses, strict=True))
        loads = np.zeros((total, len(self.skin)))
        for begin, one in zip(first, courses, strict=True):
            loads[begin : begin + len(one)] += one
        motion = together[0].motion
        label = "+".join(placed.label for placed in together)
        self.play(label, together[0].subject.number, loads, motion)
        peaks = np.array([placed.loads.sum(axis=0) for placed in together])
        self._owners.append(np.where(peaks.max(axis=0) > 0, peaks.argmax(axis=0), -1))

    def recording(self, *, owners: bool = False) -> Recording:
        """Everything played so far; with `owners` the touch that each taxel belongs to."""
        owned = np.array(self._owners, np.int64).reshape(-1, len(self.skin)) if owners else None
        return self.played(~self.sensors.lost(self.count, rng=self.rng), owners=owned)


def loads_over_time(placed: Placed, rate: float, rng: np.random.Generator) -> FloatArray:
    """Loads (t, n) of one touch: press, hold with a tremor, let go; or its course in time."""
    if placed.weights is not None:
        shake = 1.0 + 0.05 * rng.standard_normal((len(placed.weights), 1))
        return np.asarray((shake * placed.weights) @ placed.loads)
    pace = placed.subject.pace
    press, hold, release = pace * rng.uniform((0.08, 0.4, 0.08), (0.25, 0.9, 0.2))
    time = np.arange(0.0, press + hold + release, 1.0 / rate) + 0.5 / rate
    course = np.clip(np.minimum(time / press, (press + hold + release - time) / release), 0.0, 1.0)
    lag = rng.uniform(0.0, 0.06, len(placed.loads))  # fingers do not land together
    each = np.stack([np.interp(time - late, time, course, left=0.0) for late in lag], axis=1)
    # Mostly of the arm, and a little of each finger.
    tremor = 1.0 + 0.05 * rng.standard_normal((len(time), 1))
    tremor = tremor + 0.03 * rng.standard_normal((len(time), len(placed.loads)))
    each = each * tremor
    if placed.rolled is None:
        return np.asarray(each @ placed.loads)
    share = np.clip((time - press) / hold, 0.0, 1.0)[:, None]
    return np.asarray((each * (1.0 - share)) @ placed.loads + (each * share) @ placed.rolled)


COARSE, FINE = 3e-3, 1.5e-3  # between the points of the grid [m]
SLENDER = 4e-3  # radius of a pad up to which the fine grid is needed [m]


def covered_share(pads: Sequence[Pad], uv: FloatArray, spacing: float) -> float:
    """Share of the pads' area that lies within one spacing of a taxel.

    Parameters
    ----------
    pads : sequence of Pad
    uv : (n, 2) float
        Taxels in the plane of the pads, NaN where the map does not reach [m].
    spacing : float
        Of the taxels [m].

    Returns
    -------
    float
        0 to 1; 1 for pads too small for a point of the grid.
    """
    step = COARSE if min(pad.radius for pad in pads) > SLENDER else FINE
    ends = np.array([[pad.start, pad.end] for pad in pads])
    radii = np.array([pad.radius for pad in pads])
    low = ends.min(axis=(0, 1)) - radii.max()
    high = ends.max(axis=(0, 1)) + radii.max()
    x, y = (np.arange(a, b + step, step) for a, b in zip(low, high, strict=True))
    first = ((ends.min(axis=1) - radii[:, None] - low) / step).astype(np.int64)
    last = ((ends.max(axis=1) + radii[:, None] - low) / step).astype(np.int64) + 2
    under = np.zeros((len(x), len(y)), bool)
    for pad, (i, j), (k, m) in zip(pads, first.tolist(), last.tolist(), strict=True):
        under[i:k, j:m] |= _inside(pad, x[i:k], y[j:m])
    touched = int(np.count_nonzero(under))
    if touched == 0:
        return 1.0
    return int(np.count_nonzero(under & _over_taxels(x, y, step, uv, spacing))) / touched


def _inside(pad: Pad, x: FloatArray, y: FloatArray) -> BoolArray:
    """(i, j) whether points of a grid lie inside a pad, as `Pad.depth` has it."""
    (start_x, start_y), (end_x, end_y) = pad.start, pad.end
    axis_x, axis_y = end_x - start_x, end_y - start_y
    away_x, away_y = (x - start_x)[:, None], (y - start_y)[None, :]
    length = axis_x * axis_x + axis_y * axis_y
    if length > 0:
        along = (away_x * axis_x + away_y * axis_y) / length
        along = np.minimum(np.maximum(along, 0.0), 1.0)
        away_x, away_y = away_x - along * axis_x, away_y - along * axis_y
    return np.asarray(np.sqrt(away_x * away_x + away_y * away_y) / pad.radius < 1.0)


def _over_taxels(
    x: FloatArray, y: FloatArray, step: float, uv: FloatArray, spacing: float
) -> BoolArray:
    """(i, j) which points of a grid lie within one spacing of a taxel (n, 2)."""
    over = np.zeros((len(x), len(y)), bool)
    reach = int(np.ceil(spacing / step))
    rows, away_x = _around(x, step, uv[:, 0], reach)
    columns, away_y = _around(y, step, uv[:, 1], reach)
    near = (rows >= 0).any(axis=1) & (columns >= 0).any(axis=1)
    rows, columns = rows[near], columns[near]
    inside = away_x[near][:, :, None] + away_y[near][:, None, :] < spacing * spacing
    inside &= (rows >= 0)[:, :, None] & (columns >= 0)[:, None, :]
    taxel, i, j = np.nonzero(inside)
    over[rows[taxel, i], columns[taxel, j]] = True
    return over


def _around(
    line: FloatArray, step: float, at: FloatArray, reach: int
) -> tuple[IntArray, FloatArray]:
    """The points (n, r) of an axis next to each place (n,), -1 beyond it, and how far, squared."""
    before = np.floor((np.where(np.isfinite(at), at, np.inf) - line[0]) / step)
    before = np.clip(before, -reach - 2, len(line) + reach).astype(np.int64)
    index = before[:, None] + np.arange(-reach, reach + 2)
    outside = (index < 0) | (index >= len(line))
    away = line[np.clip(index, 0, len(line) - 1)] - at[:, None]
    return np.where(outside, -1, index), away * away


# Two touches at once, at distinct places of one part, with the truth of who owns which taxel.

APART = 20e-3  # skin left free between two touches [m]
DELAY = 0.6  # the second begins within this time after the first [s]
TOLD = 4.0 / FULL_SCALE  # a load that a taxel tells from noise


def simulate_pairs(
    skin: Skin,
    *,
    rng: np.random.Generator,
    count: int = 20,
    gestures: Sequence[str] = FOUR,
    subjects: int = SUBJECTS,
    sensing: Sensing | None = None,
    variety: float = DEFAULT,
    progress: Callable[[str], None] | None = None,
) -> Recording:
    """Pairs of touches, drawn at random from the gestures, that overlap in time.

    Parameters
    ----------
    skin : Skin
        n taxels.
    rng : numpy.random.Generator
    count : int
        Pairs asked for. Fewer come where the part cannot hold two of those drawn.
    gestures, subjects, sensing, variety
        As for `simulate`; the two touches are of two people.
    progress : callable, optional
        Called once a pair with the name of the part.

    Returns
    -------
    Recording
        Labels such as "poke+whole_hand"; `owners` holds the label of each taxel.
    """
    gestures = gesture_set(gestures)
    answers = draw_sensing(variety, rng=rng) if sensing is None else sensing
    stage = prepare(skin, rng=rng, sensing=answers, variety=variety)
    people = draw_subjects(max(subjects, 2), rng=rng)
    player = Player(stage, rng)
    for _ in range(count):
        if progress is not None:
            progress(skin.part)
        names = [gestures[int(rng.integers(len(gestures)))] for _ in range(2)]
        who = rng.permutation(len(people))[:2]
        first = place(stage, names[0], people[int(who[0])], rng=rng)
        if first is None:
            continue
        for _ in range(TRIES):
            second = place(stage, names[1], people[int(who[1])], rng=rng)
            if second is None:
                break
            if _free(stage, first, second) >= APART:
                player.touch([first, second], [0.0, float(rng.uniform(0.0, DELAY))])
                break
            # A part that is nearly full: let the first one move, too.
            first = place(stage, names[0], people[int(who[0])], rng=rng) or first
    return player.recording(owners=True)


def _free(stage: Stage, one: Placed, other: Placed) -> float:
    """Distance between the taxels that two touches load [m]; inf where one loads none."""
    felt = [placed.loads.sum(axis=0) > TOLD for placed in (one, other)]
    points = [stage.skin.positions[taxels] for taxels in felt]
    if not len(points[0]) or not len(points[1]):
        return 0.0
    distance, _ = cKDTree(points[0]).query(points[1])
    return float(distance.min())
