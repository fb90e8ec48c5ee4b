"""How far simulated touches are drawn at random: none, some, wide, wider, or a number from 0 to 2.

At 0 touches are the fixed pads of `gestures` on the sensors of `Sensing()`. Above, most touches
are bodies with a force (`hands`) on an elastic bed (`elastic_bed`), a few remain pads, and each
skin has faults. All ranges grow with the number. Above 1 come rarer people and skins: hands from a
child's to large ones, light and quick touches, touches half on the rim, stiff thin and soft thick
foam, and more cross-talk. docs/simulator.md has the sources.

`Sensors` are what taxels make of a load: gains, faults, drift, noise, saturation, rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.geometry.proximity import nearest_first
from skinmap.skin.skin import Skin
from skinmap.touch.simulation.elastic_bed import Foam

FULL_SCALE = 160.0  # counts at the middle of a pad of strength 1
DRIFT_TIME = 20.0  # the baseline forgets in this time [s]
SPIKE = (8.0, 30.0)  # height of spikes: a real CySkin's are up to 17 % of a touch [counts]
STUCK = (30.0, 200.0)  # where a stuck area hangs [counts]
STUCK_AREA = 8  # taxels that are stuck together at most
GAP = (1, 4)  # samples that are lost at once
CREEP_TIME = 0.6  # the foam creeps in this time [s]
FORGETS = 5.0  # and forgets how far it was pressed in this [s]
MAY_BE_ZERO = (
    *("noise", "gain_spread", "drift", "dead", "foam", "rate", "saturation", "sensitivity"),
    *("unplaced", "stuck", "spikes", "gaps", "hysteresis", "creep", "cross_talk"),
    "compression",
)
SHARES = ("dead", "unplaced", "stuck", "spikes", "gaps", "hysteresis", "cross_talk")


@dataclass(frozen=True, slots=True)
class Sensing:
    """How taxels answer.

    Attributes
    ----------
    rate : float
        Samples a second; the iCub sends 50.
    foam : float
        Spread of the pressure through the foam, standard deviation [m].
    noise : float
        Standard deviation of a sample [counts].
    gain_spread : float
        Standard deviation of the taxels' gains, 0.15 = 15 %.
    drift : float
        Standard deviation of the slow wandering of each taxel's baseline [counts].
    dead : float
        Share of the taxels that always send 0.
    saturation : float
        No taxel sends more [counts].
    bits : int
        Resolution: 8 bits are steps of one count, 4 bits steps of 16.
    gain_law : {"normal", "lognormal"}
        How gains are spread.
    sensitivity : float
        Of the whole skin, 1 = 160 counts under a firm finger.
    unplaced : float
        Share of the modules whose channels have no place: their taxels send 0.
    stuck : float
        Share of the taxels, in areas side by side, that always send one value.
    spikes : float
        Chance that a taxel jumps in a sample.
    gaps : float
        Share of the samples that are lost, one to four at once.
    hysteresis : float
        By how much a reading stays above its load while that falls, of what it has fallen.
    creep : float
        By how much a reading still grows while the load stands.
    cross_talk : float
        Share of its module's mean reading that a taxel reads with its own.
    compression : float
        How much of a load `L` is lost as it grows: (1 + c) L / (1 + c L), 1 at a load of 1.
    """

    rate: float = 50.0
    foam: float = 2.5e-3
    noise: float = 1.2
    gain_spread: float = 0.15
    drift: float = 0.5
    dead: float = 0.0
    saturation: float = 255.0
    bits: int = 8
    gain_law: Literal["normal", "lognormal"] = "normal"
    sensitivity: float = 1.0
    unplaced: float = 0.0
    stuck: float = 0.0
    spikes: float = 0.0
    gaps: float = 0.0
    hysteresis: float = 0.0
    creep: float = 0.0
    cross_talk: float = 0.0
    compression: float = 0.0

    def __post_init__(self) -> None:
        for name in MAY_BE_ZERO:
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InvalidArrayError(f"{name} must be finite and not negative, got {value}")
        if not 0 < self.rate <= 10_000 or self.foam == 0:
            raise InvalidArrayError(
                f"rate must lie in 0..10000 and foam above 0, got {self.rate} and {self.foam}"
            )
        for name in SHARES:
            if getattr(self, name) > 1:
                raise InvalidArrayError(f"{name} is a share of 0..1, got {getattr(self, name)}")
        if self.gaps > 0.5:
            raise InvalidArrayError(f"gaps may take half of the samples at most, got {self.gaps}")
        if self.saturation > 255 or not 1 <= self.bits <= 8:
            raise InvalidArrayError(
                f"saturation is at most 255 counts and bits 1..8, got {self.saturation} "
                f"and {self.bits}"
            )


class Sensors:
    """The taxels of one skin: their gains, baselines and faults, drawn once.

    Parameters
    ----------
    skin : Skin
    sensing : Sensing
    rng : numpy.random.Generator
    """

    def __init__(self, skin: Skin, sensing: Sensing, *, rng: np.random.Generator) -> None:
        count = len(skin)
        self.sensing = sensing
        if sensing.gain_law == "normal":
            gains = np.clip(rng.normal(1.0, sensing.gain_spread, count), 0.4, 1.6)
        else:
            gains = np.exp(rng.normal(0.0, sensing.gain_spread, count))
        self.gains: FloatArray = sensing.sensitivity * gains
        self.dead: BoolArray = np.zeros(count, bool)
        self.dead[rng.permutation(count)[: round(sensing.dead * count)]] = True
        self._baseline = rng.normal(0.0, sensing.drift, count)
        self._module = np.unique(skin.modules, return_inverse=True)[1]
        if sensing.unplaced > 0:
            lost = rng.random(self._module.max(initial=0) + 1) < sensing.unplaced
            self.dead |= lost[self._module]
        if skin.wired is not None:
            self.dead |= ~skin.wired
        self.stuck: IntArray = _areas(skin, sensing.stuck, rng)
        self._hangs = rng.uniform(*STUCK, len(self.stuck)) if len(self.stuck) else np.zeros(0)
        self._crept, self._highest = np.zeros(count), np.zeros(count)

    def read(self, loads: FloatArray, *, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Counts (t, n) of loads (t, n), 1 = a firm finger; time goes on from call to call."""
        sensing = self.sensing
        keep = np.exp(-len(loads) / sensing.rate / DRIFT_TIME)
        # Ornstein-Uhlenbeck, stepped once a call and straight in between: it is slow.
        fresh = rng.normal(0.0, sensing.drift, len(self.gains))
        after = keep * self._baseline + np.sqrt(1.0 - keep**2) * fresh
        along = np.linspace(0.0, 1.0, len(loads))[:, None]
        loads = self._cross_talk(self._lags(loads))
        if sensing.compression > 0:
            loads = (1.0 + sensing.compression) * loads / (1.0 + sensing.compression * loads)
        counts = FULL_SCALE * loads * self.gains + self._baseline + along * (after - self._baseline)
        self._baseline = after
        counts += rng.normal(0.0, sensing.noise, counts.shape)
        if sensing.spikes > 0:
            hit = rng.random(counts.shape) < sensing.spikes
            counts[hit] += rng.uniform(*SPIKE, int(hit.sum()))
        step = 2.0 ** (8 - sensing.bits)
        counts = step * np.rint(np.clip(counts, 0.0, sensing.saturation) / step)
        counts[:, self.dead] = 0.0
        counts[:, self.stuck] = self._hangs
        return np.minimum(counts, 255.0).astype(np.uint8)

    def _lags(self, loads: FloatArray) -> FloatArray:
        """Loads (t, n) as a foam with creep and hysteresis passes them on."""
        sensing = self.sensing
        if sensing.creep == 0 and sensing.hysteresis == 0:
            return loads
        step = 1.0 / sensing.rate
        follow, keep = 1.0 - np.exp(-step / CREEP_TIME), np.exp(-step / FORGETS)
        felt = np.empty_like(loads)
        for row, load in enumerate(loads):
            self._crept += follow * (load - self._crept)
            self._highest = np.maximum(load, keep * self._highest)
            fallen = 1.0 - load / np.maximum(self._highest, 1e-12)
            felt[row] = load * (1.0 + sensing.hysteresis * fallen) + sensing.creep * self._crept
        return felt

    def _cross_talk(self, loads: FloatArray) -> FloatArray:
        if self.sensing.cross_talk == 0:
            return loads
        count = np.bincount(self._module)
        rows = [np.bincount(self._module, row) / count for row in loads]
        means = np.reshape(rows, (-1, len(count)))  # a slow sensor may miss a touch
        return np.asarray(loads + self.sensing.cross_talk * means[:, self._module])

    def lost(self, count: int, *, rng: np.random.Generator) -> BoolArray:
        """(count,) which of some samples never arrive."""
        lost = np.zeros(count, bool)
        if self.sensing.gaps > 0:
            begins = np.flatnonzero(rng.random(count) < self.sensing.gaps / np.mean(GAP))
            sizes = rng.integers(GAP[0], GAP[1] + 1, len(begins))
            for first, size in zip(begins, sizes, strict=True):
                lost[first : first + size] = True
        return lost


def _areas(skin: Skin, share: float, rng: np.random.Generator) -> IntArray:
    """Taxels of areas side by side, about so many in all; none where none are wanted."""
    wanted, found = share * len(skin), np.zeros(len(skin), bool)
    while share > 0 and rng.random() < (wanted - found.sum()) / STUCK_AREA:
        centre = skin.positions[rng.integers(len(skin))]
        away = np.linalg.norm(skin.positions - centre, axis=1)
        found[nearest_first(away)[: rng.integers(1, STUCK_AREA + 1)]] = True
    return np.flatnonzero(found)


LEVELS = {"none": 0.0, "some": 0.5, "wide": 1.0, "wider": 2.0}
DEFAULT = 1.0  # what most people and skins are like
MOST = 2.0
PADS = 0.4  # share of touches that remain fixed pads at full variety
STIFFNESS = (1e7, 1.5e8)  # of a foam of 2 mm with a modulus of 20 to 300 kPa [N/m3]
SPREAD = (1.4e-3, 2.6e-3)  # of a pressure by the foam of a skin, 1 to 3 mm thick [m]
UNEVEN = 0.15  # by which it differs from place to place, as a logarithm
FURTHER = 1.5  # the logarithm of foam's stiffness and spread reach so much further at 2
CROSS_TALK = 0.08  # more at most within a module, at 2
LEANS, ROLLS = 0.35, 0.4  # share of touches that come in obliquely at 2, and that roll while held
COMPRESSION = 0.6  # of high readings at most, at 2
AT_RIM, LESS_ON_SKIN = 0.35, 0.3  # share of touches that lie over a rim at 2, and by how much
OVER_RIM = (0.01, 0.03)  # how far those that move go over it, or come from there [m]; estimated


def variety_of(text: str) -> float:
    """The number that a word or a figure stands for.

    Raises
    ------
    UnknownNameError, InvalidArrayError
        Neither a level nor a number; a number outside 0 to 2.
    """
    if text in LEVELS:
        return LEVELS[text]
    try:
        number = float(text)
    except ValueError:
        raise UnknownNameError("variety level", text, [*LEVELS, "a number from 0 to 2"]) from None
    return check_variety(number)


def check_variety(variety: float) -> float:
    """The variety, if it lies in 0 to 2."""
    if not 0.0 <= variety <= MOST:  # false for NaN
        raise InvalidArrayError(f"variety must lie in 0..2, got {variety:g}")
    return float(variety)


def beyond(variety: float) -> float:
    """How far a variety is above 1, from 0 to 1."""
    return max(0.0, variety - 1.0)


def on_skin_of(variety: float, enough: float, rng: np.random.Generator) -> float:
    """The least share of a touch over taxels; now and then less above 1, where none else is drawn.

    Half of a touch at the rim of a patch is on nothing.
    """
    return enough - LESS_ON_SKIN * happens(AT_RIM, variety, rng)


def over_rim_of(variety: float, rng: np.random.Generator) -> float:
    """How far a touch that moves may go over the rim [m]; 0 up to 1, where nothing is drawn."""
    return float(rng.uniform(*OVER_RIM)) if happens(AT_RIM, variety, rng) else 0.0


def happens(share: float, variety: float, rng: np.random.Generator) -> bool:
    """Whether something rare happens to a touch, in a share of them at 2; nothing is drawn to 1."""
    return beyond(variety) > 0 and bool(rng.random() < share * beyond(variety))


def uses_pads(variety: float, rng: np.random.Generator) -> bool:
    """Whether the next touch is one of fixed pads; nothing is drawn at 0."""
    return variety == 0.0 or bool(rng.random() < 1.0 - (1.0 - PADS) * min(1.0, 2.0 * variety))


def draw_foam(variety: float, spread: float, rng: np.random.Generator) -> Foam:
    """The foam under one touch, of a skin with a known spread [m].

    Its stiffness is drawn for each touch: a training set has too few skins.
    """
    low, high = np.log(STIFFNESS)
    most, further = min(variety, 1.0), 1.0 + (FURTHER - 1.0) * beyond(variety)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) * most * further
    stiffness = np.exp(rng.uniform(middle - half, middle + half))
    return Foam(float(stiffness), float(spread * np.exp(UNEVEN * most * rng.uniform(-1, 1))))


def draw_sensing(variety: float, *, rng: np.random.Generator, rate: float = 50.0) -> Sensing:
    """How the taxels of one skin answer; `Sensing()` at 0, where nothing is drawn.

    Samples are never lost unless asked for: all parts of a robot are sampled together.
    docs/simulator.md has the sources of the ranges.
    """
    clean = Sensing(rate=rate)
    if variety == 0.0:
        return clean
    more, variety = beyond(variety), min(variety, 1.0)
    middle, half = 0.5 * sum(SPREAD), 0.5 * (SPREAD[1] - SPREAD[0]) * variety
    half *= 1.0 + (FURTHER - 1.0) * more
    return replace(
        clean,
        foam=float(rng.uniform(middle - half, middle + half)),
        gain_law="lognormal",
        gain_spread=float(rng.uniform(0.1, 0.1 + 0.3 * variety)),
        sensitivity=float(np.exp(rng.uniform(-0.4, 0.4) * variety)),
        noise=float(rng.uniform(1.0, 1.0 + 0.8 * variety)),
        dead=float(rng.uniform(0.0, 0.02 * variety)),
        unplaced=float(rng.uniform(0.0, 0.02 * variety)),
        stuck=float(rng.uniform(0.0, 0.01 * variety)),
        spikes=float(rng.uniform(0.0, 4e-4 * variety)),
        hysteresis=float(rng.uniform(0.0, 0.2 * variety)),
        creep=float(rng.uniform(0.0, 0.15 * variety)),
        cross_talk=float(rng.uniform(0.0, 0.04 * variety + CROSS_TALK * more)),
        compression=float(rng.uniform(0.0, COMPRESSION * more)) if more > 0 else 0.0,
    )


# Who touches: subjects with a hand size and habits, and the places that they touch.

HAND = (0.75, 1.0)  # sizes of hands, 1 = adult
# Of small children to large men: 120 to 210 mm from wrist to fingertip, where an adult has 185
# (Pheasant, "Bodyspace", 1996).
ALL_HANDS = (0.65, 1.13)
HABITS = 3  # habitual places of a gesture on a part
HABIT_SHIFT = 8e-3  # how near a subject comes to them, standard deviation [m]
HABIT_TURN = 0.25  # and with the angle of the hand [rad]
Places = Literal["anywhere", "habitual", "grips"]  # grips: these alone at habitual places
GRIPS = ("three_finger", "whole_hand")


@dataclass(frozen=True, slots=True)
class Subject:
    """A simulated person who touches.

    Attributes
    ----------
    number : int
        0 first.
    hand : float
        Size of the hand, 1 = adult.
    force : float
        How firmly, 1 = as most.
    pace : float
        How slowly, 1 = as most.
    habit : int
        Which habitual place, 0..HABITS-1.
    left : bool
        Whether a left hand touches: the mirror image of a right one.
    """

    number: int
    hand: float
    force: float
    pace: float
    habit: int
    left: bool = False


def hand_sizes(further: float) -> tuple[float, float]:
    """Sizes of the smallest and the largest hand, 1 = adult; `further` is 1 for nearly all."""
    low, high = HAND
    return low - further * (low - ALL_HANDS[0]), high + further * (ALL_HANDS[1] - high)


def draw_subjects(
    count: int, *, rng: np.random.Generator, further: float = 0.0
) -> tuple[Subject, ...]:
    """Subjects with hands from child to adult, and `further` people from 0 to 1 beside these."""
    sizes = hand_sizes(further)
    return tuple(
        Subject(
            number,
            float(rng.uniform(*sizes)),
            float(np.exp(rng.normal(-0.2 * further, 0.15 + 0.35 * further))),
            float(np.exp(rng.normal(-0.3 * further, 0.2 + 0.2 * further))),
            int(rng.integers(HABITS)),
        )
        for number in range(count)
    )


@dataclass(frozen=True, slots=True)
class Habit:
    """A place on a part that a gesture is often made at: a taxel and an angle [rad]."""

    taxel: int
    angle: float
