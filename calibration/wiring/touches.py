"""What a skin sends touched and untouched: answers to touches, and the faults that a rest shows.

The analysis of channels at rest is that of `skinmap examine`; modules and the level of each channel
are added here.

What a stroke tells of gains: a finger of unknown shape and force passes on an unknown track. Its
load on a taxel is its force at that moment times a profile that falls with the distance times the
gain of the taxel: force, track, profile and gains are fitted together. The gains alone then have a
normal distribution, whose precisions add up over touches and check-ups.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.special import ndtr

from calibration.response.response import FREE
from calibration.wiring.boards import Boards
from skinmap.arrays import BoolArray, FloatArray, Frozen, IntArray, check_finite, freeze
from skinmap.errors import InvalidArrayError, check_known
from skinmap.geometry.log_maps import log_map
from skinmap.geometry.proximity import bridged_graph
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.triangles import unit
from skinmap.soundness.channel_faults import channel_faults
from skinmap.soundness.finding import Finding, finding, spans_of
from skinmap.soundness.survey import survey
from skinmap.soundness.track import Track

PLACE = 4e-3  # error of a person's place, standard deviation an axis [m]
THRESHOLD = 12.0  # counts above rest that are an answer, as `ACTIVE` of `skinmap.touch`
SPIKE, DEAD = 0.004, 0.03  # chances that an untouched channel answers and a touched one does not
SPREAD = 0.6  # of the logarithm of an answer: gains of 15 to 40 %, and the model's own error
TIMING = 0.12  # error of when a stroke comes by, in its duration
SHAPES = ((4.5e-3, 80.0), (6e-3, 50.0), (6e-3, 150.0), (8.5e-3, 200.0))  # width [m], force [counts]
NEAR = 32e-3  # sites further from a touch do not answer [m]
LEVELS = 9  # of an answer: none, and eight from the threshold to 255 counts
STEPS = 48  # of an expected answer, logarithmic
LOWEST = 1.0  # expected answers below are none [counts]


def _table() -> FloatArray:
    """(LEVELS, STEPS + 1) log chance of each level for each expected answer, none first."""
    log_edges = np.log(np.geomspace(THRESHOLD, 255.0, LEVELS))
    expected = np.concatenate([[1e-6], np.geomspace(LOWEST, 400.0, STEPS)])
    z = (log_edges[:, None] - np.log(expected)[None]) / SPREAD
    below = ndtr(z)
    inside = np.diff(below, axis=0)
    inside[-1] += 1.0 - below[-1]  # saturated
    felt = (1.0 - DEAD) * inside + SPIKE / (LEVELS - 1)
    none = 1.0 - felt.sum(axis=0)
    return np.log(np.maximum(np.vstack([none[None], felt]), 1e-12)).astype(np.float32)


TABLE = _table()
STEP = np.log(400.0 / LOWEST) / (STEPS - 1)


def level_of(response: FloatArray) -> IntArray:
    """(n,) level of each answer; 0 for none."""
    size = np.log(np.maximum(response, THRESHOLD) / THRESHOLD) / np.log(255.0 / THRESHOLD)
    level = 1 + np.floor(size * (LEVELS - 1)).astype(np.int64)
    return np.asarray(np.where(response < THRESHOLD, 0, np.minimum(level, LEVELS - 1)))


def steps_at(square: FloatArray, shapes: Sequence[tuple[float, float]]) -> IntArray:
    """(s, ...) columns of `TABLE` at squared distances (...) [m2] from touches of some shapes."""
    width, force = np.array(shapes, square.dtype).T.reshape(2, -1, *[1] * square.ndim)
    log_expected = np.log(force) - 0.5 * (square / width**2)
    step = (log_expected - np.float32(np.log(LOWEST))) * np.float32(1.0 / STEP) + 1.5
    return np.asarray(np.fmin(np.fmax(step, 0.0), STEPS), np.int16)  # fmax: NaN is none


def offsets() -> tuple[FloatArray, FloatArray]:
    """(o, 2) errors of a place on a grid and their log chances."""
    steps = 5e-3 * np.arange(-3, 4)
    grid = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    grid = grid[np.linalg.norm(grid, axis=1) < 14.5e-3]
    weight = -0.5 * (grid**2).sum(axis=1) / PLACE**2
    return grid, weight - np.log(np.exp(weight).sum())


def tangents(boards: Boards, place: FloatArray) -> FloatArray:
    """(2, 3) directions along the skin at a place (3,)."""
    nearest = int(np.argmin(np.linalg.norm(boards.table.positions - place, axis=1)))
    return tangent_frames(boards.normals[nearest])


def sideways(boards: Boards, path: FloatArray) -> FloatArray:
    """(3,) direction along the skin across a stroke (p, 3)."""
    normal = np.cross(*tangents(boards, path[len(path) // 2]))
    return unit(np.cross(normal, unit(path[-1] - path[0])))


BEGINS, ENDS = 3, 12  # samples that a touch is felt for, and quiet ones that end it
MIDDLE = 128.0  # raw values that rest above it fall under load, as those of the iCub do
MARGIN = 10  # samples beside a touch that are no rest
STRETCH, FEWEST = 30.0, 10  # of a recording that has one median [s], and samples of it
LEAST_REST = 100  # samples; fewer tell nothing
SILENT = 0.5  # share of samples without a number that makes a channel silent
FLICKER = 4  # changes of a stuck channel at most: two spikes
NOISY = 5.0  # times the noise of the others
QUARTILE = 1.1503 * np.sqrt(6.0)  # upper one of second differences, of normal noise of 1
ALIVE = 20  # changes that a lively channel shows at least, else the rest is too calm to judge
OF_CHANNELS = {"dead", "stuck", "clipped", "quantised", "copied"}  # that a rest shows


@dataclass(frozen=True, eq=False, slots=True)
class Touch:
    """A touch and its answer.

    Attributes
    ----------
    how : {"poke", "stroke"}
    path : (p, 3) float
        Where it was asked for, in the link's frame [m]: one point, or the points of a stroke in
        order.
    response : (n,) float
        Largest answer of each row of the table above its rest [counts].
    arrival : (n,) float
        When it came, 0 at the touch's beginning to 1 at its end; used for strokes.
    samples : (t, n) float or None
        All that was read above rest while it lasted, spikes too [counts].
    """

    how: str
    path: FloatArray
    response: FloatArray
    arrival: FloatArray
    samples: FloatArray | None = None

    def __post_init__(self) -> None:
        check_known("kind of touch", [self.how], ("poke", "stroke"))
        response = check_finite(self.response, "response", (None,))
        arrival = check_finite(self.arrival, "arrival", (len(response),))
        path = check_finite(self.path, "path", (None, 3))
        if len(path) == 0 or (self.how == "stroke" and len(path) < 2):
            raise InvalidArrayError("a touch has a place, a stroke at least two")
        freeze(self, response=response, arrival=arrival, path=path)

    def away(self, places: FloatArray) -> FloatArray:
        """(n,) how far places (n, 3) are from it [m]."""
        found = np.full(len(places), np.inf)
        for begin, end in pairwise([*self.path, self.path[-1]]):
            way = end - begin
            share = (places - begin) @ way / max(float(way @ way), 1e-18)
            foot = begin + np.clip(share, 0.0, 1.0)[:, None] * way
            found = np.minimum(found, np.linalg.norm(places - foot, axis=1))
        return found

    @property
    def middle(self) -> FloatArray:
        """(3,) the middle of where it was asked for [m]."""
        return np.asarray(self.path.mean(axis=0))


@dataclass(frozen=True, eq=False, slots=True)
class Baseline:
    """What channels send untouched.

    Attributes
    ----------
    level : (n,) or (t, n) float
        Median, or one for each sample [counts].
    sign : (n,) or (t, n) float
        -1 where load makes values fall.
    """

    level: FloatArray
    sign: FloatArray

    @classmethod
    def of(cls, rest: ArrayLike, kind: str) -> Baseline:
        """From samples (t, n) at rest, of raw values or pressures."""
        values = without_holes(rest)
        if len(values) == 0:
            raise InvalidArrayError("no samples at rest")
        return cls._at(np.median(values, axis=0), kind)

    @classmethod
    def along(cls, values: FloatArray, quiet: BoolArray, kind: str, rate: float) -> Baseline:
        """One that drifts with samples (t, n): medians of stretches of the `quiet` ones (t,)."""
        stretch = max(1, round(STRETCH * rate))
        rows = np.flatnonzero(quiet) if quiet.any() else np.arange(len(values))
        parts = np.split(
            rows, np.unique(np.searchsorted(rows, np.arange(0, rows[-1], stretch)))[1:]
        )
        parts = [part for part in parts if len(part) >= min(FEWEST, len(rows))]
        middles = [float(part.mean()) for part in parts]
        medians = np.array([np.median(values[part], axis=0) for part in parts])
        every = np.arange(len(values))
        level = np.stack([np.interp(every, middles, own) for own in medians.T], axis=1)
        return cls._at(level, kind)

    @classmethod
    def _at(cls, level: FloatArray, kind: str) -> Baseline:
        falls = (level > MIDDLE) & (kind == "raw")
        return cls(level, np.where(falls, -1.0, 1.0))

    def followed(self, quiet: FloatArray, rate: float) -> Baseline:
        """A baseline that has moved towards samples (t, n) in which nothing was touched."""
        share = 1.0 - np.exp(-len(quiet) / (rate * FREE))
        now = np.where(np.isfinite(quiet), quiet, self.level).mean(axis=0)
        return replace(self, level=self.level + share * (now - self.level))

    def above(self, samples: FloatArray) -> FloatArray:
        """(t, n) counts above rest; 0 for what is no number."""
        above = (samples - self.level) * self.sign
        return np.asarray(np.where(np.isfinite(above), above, 0.0))

    def answers(self, samples: ArrayLike) -> FloatArray:
        """(t, n) answers above rest [counts]; a spike of one sample is none."""
        return without_spikes(self.above(_of_channels(samples, self.level.shape[-1])))


def without_spikes(values: FloatArray) -> FloatArray:
    """Samples (t, n) in which a spike of one sample is cut off: the median of three."""
    if len(values) < 3:
        return values
    before, after = values[:-2], values[2:]
    middle = np.clip(values[1:-1], np.minimum(before, after), np.maximum(before, after))
    return np.concatenate([np.minimum(values[:1], values[1:2]), middle,
                           np.minimum(values[-1:], values[-2:-1])])  # fmt: skip


def _of_channels(samples: ArrayLike, count: int | None = None) -> FloatArray:
    values = np.asarray(samples, np.float64)
    if values.ndim != 2 or (count is not None and values.shape[1] != count):
        raise InvalidArrayError(f"samples must have shape (t, {count or 'n'}), got {values.shape}")
    return values


def without_holes(samples: ArrayLike) -> FloatArray:
    """Samples (t, n) with the channel's median where a number is missing; 0 where it has none."""
    values = _of_channels(samples)
    there = np.isfinite(values)
    if there.all():
        return values
    level = [np.median(own[known]) if known.any() else 0.0
             for own, known in zip(values.T, there.T, strict=True)]  # fmt: skip
    return np.where(there, values, level)


def make_touch(
    answers: FloatArray, how: str, path: FloatArray, samples: FloatArray | None = None
) -> Touch:
    """A touch from what channels answered while it lasted.

    Parameters
    ----------
    answers : (t, n) float
        Above rest, as `Baseline.answers` gives them [counts].
    how : {"poke", "stroke"}
    path : (p, 3) float
        Where it was asked for [m].
    samples : (t, n) float, optional
        The same above rest with their spikes, as `Baseline.above` gives them [counts].

    Returns
    -------
    Touch
        Largest answer of each channel, and when it came.

    Raises
    ------
    InvalidArrayError
        No sample, or a path that does not suit the kind of touch.

    Examples
    --------
    >>> import numpy as np
    >>> from calibration.wiring import Baseline, make_touch
    >>> level = Baseline.of(np.full((100, 3), 240.0), "raw")
    >>> sample = np.array([240.0, 150.0, 240.0])
    >>> touch = make_touch(level.answers(np.tile(sample, (5, 1))), "poke", np.zeros((1, 3)))
    >>> float(touch.response.max())
    90.0
    """
    if len(answers) == 0:
        raise InvalidArrayError("a touch without a sample")
    felt = np.where(answers > 0.5 * THRESHOLD, answers, 0.0)
    load = felt.sum(axis=0)
    when = np.linspace(0.0, 1.0, len(answers))
    arrival = (felt * when[:, None]).sum(axis=0) / np.where(load > 0, load, 1.0)
    return Touch(how, path, answers.max(axis=0), arrival, samples)


def find_touches(answers: FloatArray) -> IntArray:
    """(k, 2) first and last sample of each touch in answers (t, n)."""
    active = np.asarray((answers > THRESHOLD).any(axis=1))
    spans = spans_of(np.flatnonzero(active), join=ENDS)
    held = [[a, b] for a, b in spans if active[a : b + 1].sum() >= BEGINS]
    return np.array(held, np.int64).reshape(-1, 2)


def untouched(count: int, touches: IntArray) -> np.ndarray:
    """(count,) samples that are at rest, given the touches (k, 2)."""
    rest = np.ones(count, bool)
    for first, last in touches.tolist():
        rest[max(0, first - MARGIN) : last + MARGIN + 1] = False
    return rest


@dataclass(frozen=True, eq=False, slots=True)
class RestFindings(Frozen):
    """What a rest showed.

    Attributes
    ----------
    samples : int
    mute : tuple of int
        Modules (places in `Boards.numbers`) of which no channel changed.
    alive : (m,) bool
        Modules whose noise shows that they send.
    found : tuple of Finding
        Faults of channels beyond the mute modules; `channels` are rows of the table.
    tells : bool
        Whether there was noise enough to judge at all.
    level, noise : (n,) float
        Median and standard deviation of each row [counts].
    """

    samples: int
    mute: tuple[int, ...]
    alive: np.ndarray
    found: tuple[Finding, ...]
    tells: bool
    level: FloatArray
    noise: FloatArray

    def rows(self, kind: str) -> list[list[int]]:
        """Rows of the table of each finding of a kind."""
        return [one.channels or [] for one in self.found if one.kind == kind]


def judge_rest(samples: ArrayLike, boards: Boards) -> RestFindings:
    """Judge samples of an untouched skin.

    Parameters
    ----------
    samples : (t, n) array-like
        At least 100 of them [counts]; NaN where a number did not come.
    boards : Boards
        Of a part with n taxels.

    Returns
    -------
    RestFindings
        Mute modules, and faults of channels; one that sends no number in most samples is dead.

    Raises
    ------
    InvalidArrayError
        Samples of another length than the table, too few, or without any number.

    Examples
    --------
    >>> import numpy as np, skinmap
    >>> from calibration.wiring import boards_of, judge_rest
    >>> boards = boards_of(skinmap.load_robot("icub"), "left_forearm")
    >>> rest = np.rint(np.random.default_rng(0).normal(240.0, 1.2, (300, len(boards.table))))
    >>> rest[:, 5], rest[:, 33] = 255.0, np.nan
    >>> found = judge_rest(rest, boards)
    >>> found.rows("stuck"), found.rows("dead")
    ([[5]], [[33]])
    """
    values = without_holes(samples)
    missing = ~np.isfinite(np.asarray(samples, np.float64))
    n = len(boards.table)
    if values.shape[1] != n:
        raise InvalidArrayError(f"{values.shape[1]} values at rest for {n} taxels")
    if len(values) < LEAST_REST:
        raise InvalidArrayError(f"{len(values)} samples at rest, at least {LEAST_REST} are needed")
    if missing.all():
        raise InvalidArrayError(f"no channel of {boards.part!r} sends numbers")
    silent = missing.mean(axis=0) > SILENT
    changes = (np.diff(values, axis=0) != 0).sum(axis=0)
    moving = (changes > FLICKER) & ~silent
    tells = bool(moving[~silent].mean() >= 0.5 and np.percentile(changes[moving], 2.0) >= ALIVE)
    there = boards.columns >= 0
    lively = np.where(there, moving[np.where(there, boards.columns, 0)], False)
    mute = np.flatnonzero((lively.sum(axis=1) == 0) & (there.sum(axis=1) >= 3) & tells)
    rows = boards.columns[mute]
    within = set(rows[rows >= 0].tolist())
    # A channel with a spike or two stands still as well, and two spikes at once make no copy.
    level = np.median(values, axis=0)
    reach = np.where(moving, np.maximum(3.0, 9.0 * np.median(np.abs(values - level), axis=0)), 0.0)
    still = np.clip(values, level - reach, level + reach)
    still[:, silent] = np.nan
    looked = survey(Track(boards.part, still))
    with np.errstate(all="ignore"):
        every = channel_faults(looked)[0] if tells or silent.any() else []
    found = []
    for one in every:
        own = [c for c in one.channels or () if c not in within and (tells or silent[c])]
        if one.kind in OF_CHANNELS and own and one.rows is None:
            found.append(replace(one, channels=own))
    # Quartiles: a spike is not noise, and pressures that are cut off at zero mostly stand still.
    rough = np.percentile(np.abs(np.diff(values, 2, axis=0)), 75.0, axis=0) / QUARTILE
    wild = moving & (rough > NOISY * max(float(np.median(rough[moving])), 0.25)) if tells else ()
    if np.any(wild):
        found.append(finding("noisy", "noisy at rest", channels=np.flatnonzero(wild)))
    alive = np.asarray(2 * lively.sum(axis=1) > there.sum(axis=1)) & tells
    return RestFindings(len(values), tuple(mute.tolist()), alive, tuple(found), tells, level, rough)


MM = 1e3
FULL = 250.0  # counts above which an answer is cut off
KNOTS = np.array([0.0, 3.0, 5.5, 8.0, 11.0, 15.0, 40.0])  # of the profile [mm]
FLAT, STRAIGHT = (1, np.zeros(len(KNOTS))), (2, np.zeros(len(KNOTS)))  # its ends
PROFILE = CubicSpline(KNOTS, np.eye(len(KNOTS)), bc_type=(FLAT, STRAIGHT))
SLOPE = PROFILE.derivative()
WIDTH, LEAST_LOG = 6.0, -6.0  # of the profile that the fit begins with [mm], its least logarithm
GAINS = 0.3  # of gains, before anything is known [log]
BEND, SURGE = 1.0, 0.3  # of the track [mm] and of the force [log], second differences of samples
OVAL = 0.4  # of the metric in which the finger is round
ROUGH, SHARE = 2.0, 0.06  # error of an answer [counts], and of the model
LARGE = 2.0  # errors above count less [standard deviations]
ASIDE, REACH = 22.0, 0.13  # from the path [mm]; of the plane that a touch is laid in [m]
FEWEST_FELT, FELT = 6, 8.0  # taxels of a touch, and what they answer at least [counts]
SHORTEST, TOGETHER = 5, 3  # samples of a touch, and taxels that answer in each
FIT_STEPS, TRIES, DONE = 14, 4, 1e-3  # of the fit


class Told(NamedTuple):
    """Evidence of one touch on the logarithms of gains, for the rows (k,) of the table that it met.

    `precision` (k, k), and `pull` (k,): the precision times the likeliest gains.
    """

    rows: IntArray
    precision: FloatArray
    pull: FloatArray


def gains_told(boards: Boards, touch: Touch, trusted: BoolArray) -> Told | None:
    """Fit one touch.

    Parameters
    ----------
    boards : Boards
        Of a part with n taxels.
    touch : Touch
        With its samples and path.
    trusted : (n,) bool
        Rows of the table that may be judged.

    Returns
    -------
    Told or None
        None of a touch that is too short, too small, or has no path.
    """
    if touch.samples is None:
        return None
    samples, positions = touch.samples, boards.table.positions
    held = np.minimum(samples[1:-1], np.maximum(samples[:-2], samples[2:]))
    busy = np.flatnonzero((held > THRESHOLD).sum(axis=1) >= TOGETHER) + 1
    if len(busy) < SHORTEST:
        return None
    middle = touch.path[len(touch.path) // 2]
    source = int(np.linalg.norm(positions - middle, axis=1).argmin())
    graph = bridged_graph(positions, 10, 2.5 * boards.pitch)
    plane = MM * log_map(positions, boards.normals, graph, source, REACH)[0]
    aside = MM * np.linalg.norm(positions[:, None] - touch.path, axis=2).min(axis=1)
    peak = np.sort(samples, axis=0)[-2]  # a spike is in one sample
    met = trusted & (aside < ASIDE) & np.isfinite(plane[:, 0]) & (peak > FELT)
    if met.sum() < FEWEST_FELT:
        return None
    values = np.maximum(samples[busy[0] : busy[-1] + 1, met], 0.0)
    return Told(np.flatnonzero(met), *_Passage(plane[met], values).gains())


class _State(NamedTuple):
    """Where a fit stands: unknowns, and what follows from them for each sample and taxel."""

    unknowns: FloatArray
    away: FloatArray  # (t, k, 2) from the finger [mm]
    pull: FloatArray  # (t, k, 2) half the slope of the squared radius
    radius: FloatArray
    load: FloatArray
    error: FloatArray
    cost: float


class _Passage:
    """A finger over taxels at (k, 2) [mm] that answered (t, k) [counts].

    The unknowns are the logarithm of the force (t), the track (2 t) [mm], the logarithm of the
    profile at its knots but the first, how much longer than wide the finger is along the first axis
    and the diagonal, and the logarithms of the gains (k).
    """

    def __init__(self, places: FloatArray, values: FloatArray) -> None:
        self.places, self.values = places, values
        (t, k), knots = values.shape, len(KNOTS) - 1
        self.size = t
        self.known, self.full = _even(values), values >= FULL
        curved = np.diff(np.eye(t), 2, axis=0)
        smooth = curved.T @ curved
        profile = np.maximum(-0.5 * (KNOTS[1:] / WIDTH) ** 2, LEAST_LOG)
        weight = np.where(values > FELT, values, 0.0) ** 1.5
        total = weight.sum(axis=1)
        ticks, some = np.arange(t), total > 0
        rough = [np.interp(ticks, ticks[some], (weight @ own)[some] / total[some])
                 for own in places.T]  # fmt: skip
        track = np.linalg.solve(np.eye(t) + 4.0 * smooth, np.array(rough).T)
        force = np.log(np.maximum(values.max(axis=1), 5.0))
        self.first = np.concatenate([force, *track.T, profile, np.zeros(2 + k)])
        self.others = 3 * t + knots + 2
        self.expected = np.concatenate([np.zeros(3 * t), profile, np.zeros(2 + k)])
        self.prior = 1e-6 * np.eye(len(self.first))
        for number, size in enumerate((SURGE, BEND, BEND)):
            own = slice(number * t, (number + 1) * t)
            self.prior[own, own] += smooth / size**2
        rows = np.arange(3 * t, self.others)
        self.prior[rows, rows] += np.repeat([1.0 / 9.0, 1.0 / OVAL**2], [knots, 2])
        rows = np.arange(self.others, len(self.first))
        self.prior[rows, rows] += 1.0 / GAINS**2

    def state(self, unknowns: FloatArray) -> _State:
        """The expected answers and their errors for these unknowns."""
        t = self.size
        track, profile = unknowns[t : 3 * t].reshape(2, t).T, unknowns[3 * t : self.others - 2]
        away = self.places - track[:, None]
        pull = away @ _oval(*unknowns[self.others - 2 : self.others])
        radius = np.sqrt(np.maximum((away * pull).sum(axis=2), 0.0) + 0.01)
        fallen = PROFILE(np.minimum(radius, KNOTS[-1]))[..., 1:] @ profile
        load = np.exp(np.minimum(unknowns[:t, None] + unknowns[self.others :] + fallen, 8.0))
        error = _even(load) - self.known
        error = np.where(self.full, np.minimum(_even(load) - _even(FULL), 0.0), error)
        off = unknowns - self.expected
        cost = 2.0 * LARGE**2 * (np.hypot(1.0, error / LARGE) - 1.0).sum() + off @ self.prior @ off
        return _State(unknowns, away, pull, radius, load, error, float(cost))

    def normal_equations(self, at: _State) -> tuple[FloatArray, FloatArray]:
        """Matrix and slope of the answers alone."""
        t = self.size
        steep = at.load / np.hypot(ROUGH, SHARE * at.load)
        steep[self.full & (at.load > FULL)] = 0.0
        when, which = np.nonzero((steep > 0.3) | (np.abs(at.error) > 1.0))
        one = np.arange(len(when))
        steep, radius = steep[when, which], np.minimum(at.radius[when, which], KNOTS[-1])
        falls = SLOPE(radius)[:, 1:] @ at.unknowns[3 * t : self.others - 2]
        falls = falls / at.radius[when, which]
        jacobian = np.zeros((len(when), len(self.first)))
        jacobian[one, when] = 1.0
        for axis in (0, 1):
            jacobian[one, (1 + axis) * t + when] = -falls * at.pull[when, which, axis]
        jacobian[:, 3 * t : self.others - 2] = PROFILE(radius)[:, 1:]
        x, y = at.away[when, which].T
        jacobian[:, self.others - 2] = 0.5 * falls * (y**2 - x**2)
        jacobian[:, self.others - 1] = falls * x * y
        jacobian[one, self.others + which] = 1.0
        jacobian *= steep[:, None]
        error = at.error[when, which]
        scaled = jacobian / np.hypot(1.0, error / LARGE)[:, None]
        return scaled.T @ jacobian, scaled.T @ error

    def gains(self) -> tuple[FloatArray, FloatArray]:
        """Precision (k, k) and pull (k,) of the gains, by Levenberg's method."""
        at, damping = self.state(self.first), 1e-2
        for _ in range(FIT_STEPS):
            matrix, slope = self.normal_equations(at)
            slope = slope + self.prior @ (at.unknowns - self.expected)
            for _ in range(TRIES):
                damped = matrix + self.prior + damping * np.diag(matrix.diagonal() + 1e-6)
                new = self.state(at.unknowns - np.linalg.solve(damped, slope))
                if new.cost < at.cost:
                    break
                damping *= 8.0
            else:
                break
            settled = at.cost - new.cost < DONE * at.cost
            at, damping = new, max(damping / 5.0, 1e-6)
            if settled:
                break
        matrix, _ = self.normal_equations(at)
        matrix = matrix + self.prior
        rest, gain = slice(0, self.others), slice(self.others, None)
        told = np.linalg.solve(matrix[rest, rest], matrix[rest, gain])
        known = matrix[gain, gain] - matrix[gain, rest] @ told  # with the spread of gains
        size = 1.4826 * np.median(np.abs(at.error[at.load > 20.0])) if (at.load > 20).any() else 1.0
        trust = 1.0 / max(size, 0.3) ** 2
        alone = known - np.eye(len(known)) / GAINS**2
        return trust * alone, trust * (known @ at.unknowns[gain])


def _oval(along: float, across: float) -> FloatArray:
    """Metric (2, 2) in which the outline of a finger is a circle."""
    return np.array([[1.0 - along, across], [across, 1.0 + along]])


def _even(values: FloatArray | float) -> FloatArray:
    """Answers on a scale on which the errors of all are 1."""
    return np.asarray(np.arcsinh(SHARE / ROUGH * np.asarray(values)) / SHARE)
