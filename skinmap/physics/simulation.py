"""Touches on a skin as MuJoCo presses them: the same recordings as of our own simulator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray
from skinmap.errors import UnknownNameError
from skinmap.geometry.log_maps import log_map
from skinmap.geometry.point_surface import PointSurface
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.triangles import unit
from skinmap.physics.bodies import PRESSERS, Presser
from skinmap.physics.pressing import (
    STEP,
    Pressed,
    SpringBed,
    import_mujoco,
    mount_frame,
    press,
)
from skinmap.physics.variants import DEFAULT, Range, Variant, find_variant
from skinmap.skin.skin import Skin
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.gestures import FOUR, LONG_ON_SKIN, ON_SKIN, TIME
from skinmap.touch.simulation.hands import OBLIQUE, Draw
from skinmap.touch.simulation.moving_touches import TIME_GESTURES, Laid, Timing, lay
from skinmap.touch.simulation.simulator import MISSES, SUBJECTS, TRIES, Plays
from skinmap.touch.simulation.variety import (
    FULL_SCALE,
    HABITS,
    LEANS,
    Sensing,
    Sensors,
    Subject,
    beyond,
    hand_sizes,
    happens,
    on_skin_of,
    over_rim_of,
)

AROUND = 5  # taxels whose normals an arm comes in along
LIFT = 0.06  # time in which a presser leaves the skin [s]
FURTHER = 0.25  # spread of forces more at a variety of 2, as a logarithm
TREMOR = 0.04  # of the force, standard deviation of its share
TRIES_IN_TIME = 20
FULL_PRESSURE = 160.0 / FULL_SCALE  # load that a variant's `full_scale` stands for
# What each gesture is made with, one drawn; the second of a squeeze is its other side.
HANDS: dict[str, tuple[str, ...]] = {
    "stroke": ("poke", "three_finger", "full_finger"),
    "rub": ("poke", "three_finger", "full_finger"),
    "pat": ("whole_hand", "full_finger"),
    "tap": ("poke",),
    "slide": ("edge",),
    "twist": ("three_finger", "full_finger"),
    "squeeze": ("poke",),
    "hold": ("whole_hand", "full_finger", "three_finger", "poke"),
}
RISE, REST = 0.05, 0.07  # an arm pushes as hard as it will within the first, and rests [s]


@dataclass(frozen=True, slots=True)
class Person:
    """Who touches: a hand of a size, 1 = adult, its flesh [Pa/m], and how slowly it moves."""

    number: int
    hand: float
    flesh: float
    pace: float


@dataclass(frozen=True, eq=False, slots=True)
class Ground:
    """A skin ready to be pressed in a variant.

    Attributes
    ----------
    bed : SpringBed
    variant : Variant
    foam : float
        Stiffness of its foam per area [Pa/m].
    feel : (n, c) sparse
        Load of each taxel, 1 = a firm finger, for a newton on each spring.
    full_scale : float
        Pressure that a load of 1 in `feel` stands for [Pa].
    """

    bed: SpringBed
    variant: Variant
    foam: float
    feel: csr_array
    full_scale: float


@dataclass(frozen=True, eq=False, slots=True)
class Place:
    """Where and with what a touch is made: a presser and the frames (m, 4, 4) of its mounts."""

    presser: Presser
    frames: FloatArray


def simulate(
    skin: Skin,
    *,
    rng: np.random.Generator,
    variant: str = DEFAULT,
    per_gesture: int = 20,
    gestures: Sequence[str] = FOUR,
    subjects: int = SUBJECTS,
    sensing: Sensing | None = None,
    variety: float = 1.0,
    progress: Callable[[str], None] | None = None,
) -> Recording:
    """Touches on a skin, each gesture equally often, in random order, pressed by MuJoCo.

    Parameters
    ----------
    skin : Skin
        n taxels.
    rng : numpy.random.Generator
    variant : str
        Name from `skinmap.physics.variants.VARIANTS`.
    per_gesture : int
        Touches of each gesture. A gesture that does not fit the skin is left out.
    gestures : sequence of str
        Names from `skinmap.physics.bodies.PRESSERS`; the four of the first paper by default.
    subjects : int
        How many people touch.
    sensing : Sensing, optional
        How taxels answer; its foam is not used, as the variant has its own.
    variety : float
        Above 1, to 2, rarer people and touches: small and large hands, light and quick ones,
        oblique ones, and some over the rim of the skin.
    progress : callable, optional
        Called once a touch with the name of the part.

    Returns
    -------
    Recording
        With the true force and place of each sample.

    Raises
    ------
    MissingLibraryError
        MuJoCo is not installed.
    UnknownNameError
        A gesture or variant that does not exist.
    InvalidMeshError
        Taxels that make no surface.
    """
    import_mujoco()
    for name in gestures:
        if name not in PRESSERS and name not in TIME:
            raise UnknownNameError("gesture that MuJoCo presses", name, [*PRESSERS, *TIME])
    kind, more = find_variant(variant), beyond(variety)
    kind = replace(kind, force_spread=kind.force_spread + FURTHER * more)
    ground = make_ground(skin, kind, rng=rng)
    people = draw_people(subjects, kind, rng=rng, further=more)
    player = _Player(ground, Sensors(skin, sensing or Sensing(), rng=rng), rng)
    missed = dict.fromkeys(gestures, 0)
    for row in rng.permutation(np.repeat(np.arange(len(gestures)), per_gesture)).tolist():
        name = gestures[row]
        if progress is not None:
            progress(skin.part)
        person = people[int(rng.integers(len(people)))]
        if name in TIME:
            missed[name] += missed[name] >= MISSES or not player.touch_in_time(
                name, person, variety
            )
            continue
        place = None
        if missed[name] < MISSES:
            place = find_place(ground, name, person, rng=rng, variety=variety)
        if place is None:
            missed[name] += 1
            continue
        player.touch(name, place, person)
    return player.recording()


def make_ground(skin: Skin, variant: Variant, *, rng: np.random.Generator) -> Ground:
    """Draw the foam of a skin, and find how its taxels feel the springs."""
    bed = SpringBed(skin)
    spread, full = float(rng.uniform(*variant.spread)), _log_uniform(rng, variant.full_scale)
    foam = _log_uniform(rng, variant.foam)
    return Ground(bed, variant, foam, bed.spread(spread) / full, full)


def draw_people(
    count: int, variant: Variant, *, rng: np.random.Generator, further: float = 0.0
) -> tuple[Person, ...]:
    """People with hands from child to adult, and `further` people from 0 to 1 beside these."""
    sizes = hand_sizes(further)
    return tuple(
        Person(
            number,
            float(rng.uniform(*sizes)),
            _log_uniform(rng, variant.flesh),
            float(np.exp(rng.normal(-0.3 * further, 0.2 + 0.2 * further))),
        )
        for number in range(count)
    )


def find_place(
    ground: Ground,
    name: str,
    person: Person,
    *,
    rng: np.random.Generator,
    variety: float = 1.0,
) -> Place | None:
    """A touch at a place where enough of its footprint lies on the skin; None if there is none."""
    enough = on_skin_of(variety, LONG_ON_SKIN.get(name, ON_SKIN), rng)
    lean = float(np.tan(rng.uniform(*OBLIQUE))) if happens(LEANS, variety, rng) else 0.0
    for _ in range(TRIES):
        presser = PRESSERS[name](rng, person.hand, ground.variant)
        taxel = int(rng.integers(len(ground.bed.skin)))
        angle = float(rng.uniform(0.0, 2.0 * np.pi))
        place = place_at(ground.bed, presser, taxel, angle, lean)
        if place is not None and place[1] >= enough:
            return place[0]
    return None


def place_at(
    bed: SpringBed, presser: Presser, taxel: int, angle: float, lean: float = 0.0
) -> tuple[Place, float] | None:
    """A presser over a taxel, its x at an angle [rad], and the share of its footprint on skin.

    It comes in along the normal, or with a lean (the tangent of its angle) towards its x and y.
    """
    skin = bed.skin
    reach = float(np.linalg.norm(presser.footprint, axis=1).max()) + 3.0 * bed.spacing
    axes = presser_axes(skin, taxel, angle)
    uv, _ = log_map(skin.positions, skin.normals, bed.graph, taxel, reach, frame=axes)
    reached = np.flatnonzero(np.isfinite(uv[:, 0]))
    if len(reached) < AROUND:
        return None
    tree = cKDTree(uv[reached])
    distance, _ = tree.query(presser.footprint, distance_upper_bound=bed.spacing)
    frames = []
    for mount in presser.mounts:
        _, near = tree.query(mount.spot, k=AROUND)
        around = reached[near]
        normal = unit(skin.normals[around].mean(axis=0))
        if lean:
            normal = unit(normal + lean * np.sqrt(0.5) * axes.sum(axis=0))
        frame = mount_frame(skin.positions[around[0]], normal, axes[0])
        frame[:3, 3] += frame[:3, :2] @ (np.array(mount.spot) - uv[around[0]])
        frames.append(frame)
    return Place(presser, np.array(frames)), float(np.isfinite(distance).mean())


def press_place(
    ground: Ground, place: Place, person: Person, *, rate: float, rng: np.random.Generator
) -> Pressed:
    """Press, hold with a tremor, and let go."""
    steps = max(1, round(1.0 / (rate * STEP)))
    step = 1.0 / (rate * steps)
    return press(
        ground.bed,
        place.presser,
        place.frames,
        foam=ground.foam,
        flesh=person.flesh,
        course=_course(person.pace, len(place.frames), step, steps, rng),
        step=step,
        samples=steps,
        friction=ground.variant.friction,
    )


def taxel_loads(ground: Ground, pressed: Pressed) -> FloatArray:
    """(t, n) load of each taxel, 1 = a firm finger."""
    return np.asarray((ground.feel[:, pressed.springs] @ pressed.loads.T).T) * FULL_PRESSURE


def _course(
    pace: float, mounts: int, step: float, samples: int, rng: np.random.Generator
) -> FloatArray:
    """Share (s, m) of the full force of each mount, at each step of whole samples."""
    press, hold, release = pace * rng.uniform((0.08, 0.4, 0.08), (0.25, 0.9, 0.2))
    length = press + hold + release + LIFT
    count = samples * int(np.ceil(length / (step * samples)))
    time = step * np.arange(count)
    ends = [0.0, press, press + hold, press + hold + release, length]
    course = np.interp(time, ends, [0.0, 1.0, 1.0, 0.0, -0.5])
    knots = np.arange(0.0, length + 0.1, 0.05)  # people tremble at about 10 Hz
    tremor = 1.0 + TREMOR * np.interp(time, knots, rng.standard_normal(len(knots)))
    lag = rng.uniform(0.0, 0.06, mounts)  # fingers do not land together
    each = np.stack([np.interp(time - late, time, course, left=0.0) for late in lag], axis=1)
    return np.where(each > 0, each * tremor[:, None], each)


def presser_axes(skin: Skin, taxel: int, angle: float) -> FloatArray:
    """(2, 3) x and y of a presser at a taxel.

    At angle 0 [rad], x is the coordinate axis that the normal has least of, laid into the skin.
    """
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(np.array([[s, -c], [c, s]]) @ tangent_frames(skin.normals[taxel]))


def press_in_time(
    name: str,
    ground: Ground,
    person: Person,
    *,
    rate: float,
    rng: np.random.Generator,
    variety: float = 1.0,
) -> tuple[Laid, FloatArray, FloatArray] | None:
    """A touch in time at a place drawn at random; None where it does not fit.

    Beside it the contact forces (k,) [N] and their places (k, 3) [m] in its poses.

    Quasi-static: in every pose the presser is pushed at the springs until it rests, and in between
    the loads are mixed. So foam and flesh are MuJoCo's, and nothing slips, drags or swings.
    """
    bed, variant = ground.bed, ground.variant
    subject = Subject(person.number, person.hand, 1.0, person.pace, int(rng.integers(HABITS)))
    surface = PointSurface(bed.skin.positions, bed.skin.normals, bed.spacing)
    time = STEP * np.arange(round((RISE + REST) / STEP))
    rise = np.minimum(time / RISE, 1.0)[:, None]
    timing = Timing(rate, rng, subject)
    for _ in range(TRIES_IN_TIME):
        gesture = TIME_GESTURES[name](Draw(rng, 1.0, subject.hand), timing)
        kinds = HANDS[name]
        presser = PRESSERS[kinds[int(rng.integers(len(kinds)))]](rng, subject.hand, variant)
        first = 0.5 * np.pi + float(rng.uniform(-0.6, 0.6)) if name == "slide" else 0.0
        forces: list[float] = []
        centres: list[FloatArray] = []

        def push(
            spot: FloatArray,
            heading: FloatArray,
            angle: float,
            other: bool,
            presser: Presser = presser,
            turn: float = first,
            forces: list[float] = forces,
            centres: list[FloatArray] = centres,
        ) -> FloatArray:
            del other  # thumb and finger alike
            frames = _frames(surface, presser, spot, heading, angle + turn)
            made = press(
                bed, presser, frames, foam=ground.foam, flesh=person.flesh,
                course=np.tile(rise, (1, len(frames))), friction=variant.friction,
            )  # fmt: skip
            forces.append(float(made.forces[-1]))
            centres.append(np.nan_to_num(made.centres[-1]))
            return np.asarray(ground.feel[:, made.springs] @ made.loads[-1])

        over = over_rim_of(variety, rng)
        laid = lay(surface, gesture, push, subject.hand, rng=rng, over=over)
        if laid is not None:
            if gesture.other:  # both sides of a grip are one pose
                forces, centres = [sum(forces[-2:])], [np.mean(centres[-2:], axis=0)]
            return laid, np.array(forces), np.array(centres)
    return None


def _frames(
    surface: PointSurface, presser: Presser, spot: FloatArray, heading: FloatArray, angle: float
) -> FloatArray:
    """(m, 4, 4) where each mount pushes from: its spot in the plane, on the skin."""
    place, normal, _ = surface.project(spot)
    ahead = unit(heading - (heading @ normal) * normal)
    side = np.cross(normal, ahead)
    c, s = np.cos(angle), np.sin(angle)
    ahead, side = c * ahead + s * side, c * side - s * ahead
    middle = np.mean([mount.spot for mount in presser.mounts], axis=0)
    frames = []
    for mount in presser.mounts:
        x, y = np.array(mount.spot) - (middle if len(presser.mounts) > 1 else 0.0)
        at, up, _ = surface.project(place + x * ahead + y * side)
        frames.append(mount_frame(at, up, ahead))
    return np.array(frames)


def _log_uniform(rng: np.random.Generator, between: Range) -> float:
    return float(np.exp(rng.uniform(*np.log(between))))


class _Player(Plays):
    """Plays what MuJoCo presses, with its true forces and places."""

    def __init__(self, ground: Ground, sensors: Sensors, rng: np.random.Generator) -> None:
        super().__init__(ground.bed.skin, sensors, rng)
        self._ground = ground
        self._forces = [np.zeros(0)]
        self._places = [np.zeros((0, 3))]

    def touch_in_time(self, name: str, person: Person, variety: float) -> bool:
        """A touch that goes on in time; whether there was a place for it."""
        rng = self.rng
        made = press_in_time(name, self._ground, person, rate=self.rate, rng=rng, variety=variety)
        if made is None:
            return False
        laid, forces, centres = made
        tremor = 1.0 + TREMOR * rng.standard_normal((len(laid.weights), 1))
        weights = tremor * laid.weights
        whole = np.maximum(weights.sum(axis=1, keepdims=True), 1e-9)
        places = np.where(whole > 1e-6, weights / whole @ centres, np.nan)
        self.play(name, person.number, FULL_PRESSURE * (weights @ laid.loads), laid.motion)
        self._know(weights @ forces, places)
        return True

    def touch(self, name: str, place: Place, person: Person) -> None:
        pressed = press_place(self._ground, place, person, rate=self.rate, rng=self.rng)
        self.play(name, person.number, taxel_loads(self._ground, pressed))
        self._know(pressed.forces, pressed.centres)

    def _know(self, forces: FloatArray, centres: FloatArray) -> None:
        self._forces += [forces, np.zeros(len(self.rest))]
        self._places += [centres, np.full((len(self.rest), 3), np.nan)]

    def recording(self) -> Recording:
        return self.played(forces=np.concatenate(self._forces), places=np.concatenate(self._places))
