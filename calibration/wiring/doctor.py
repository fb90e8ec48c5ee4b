"""The wiring doctor: asks for touches, hears the answers, and names faults one after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from calibration.wiring.boards import Boards, Fault, Hypotheses, Wiring, all_faults, compose
from calibration.wiring.places import AGAIN, Candidates, Chooser, candidates
from calibration.wiring.touches import (
    NEAR,
    PLACE,
    SHAPES,
    TABLE,
    THRESHOLD,
    TIMING,
    RestFindings,
    Touch,
    level_of,
    offsets,
    sideways,
    steps_at,
    tangents,
)
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidArrayError

MISS, AIR = 0.03, 0.01  # chances that a touch is somewhere else, and that it touches nothing
SILENCE = 5.0  # most that a silent module's silence says for its being mute, a touch [nats]
ODD = 1e-4  # chance of an answer that no model foresaw: what one touch can say is bounded by it
STROKE_SHAPES = ((5e-3, 80.0), (7e-3, 170.0))
PEAKS = 6  # of the strongest answers: where a touch may have been that missed its place


@dataclass(frozen=True, eq=False, slots=True)
class Terms:
    """What one touch says of modules and sites, for q cases of what is unknown of it.

    Attributes
    ----------
    weights : (q,) float
        Logarithm of the chance of each case.
    asked : (q,) bool
        Cases of a touch that was where it was asked for.
    near : (b,) int
        Sites that may answer.
    reads : (q, m, b) float
        Log chance of the answers of a module's channels if they read a near site.
    silent : (m,) float
        The same if they read nothing, or a site far away.
    laid : (q, b, 5) float
        Of the module that reads a near site, were its board turned or mirrored.
    some : (s,) int
        Places in `near` of the modules that answered.
    exchanged : (q, s, p) float
        Of these, were two of their channels exchanged.
    """

    weights: FloatArray
    asked: BoolArray
    near: IntArray
    reads: NDArray[Any]
    silent: FloatArray
    laid: NDArray[Any]
    some: IntArray
    exchanged: NDArray[Any]


class Witness:
    """Reads touches on one part, as a wiring has it.

    Parameters
    ----------
    boards : Boards
    hypotheses : Hypotheses
    wiring : Wiring
        What is known already: faults are looked for beyond it.
    """

    def __init__(self, boards: Boards, hypotheses: Hypotheses, wiring: Wiring) -> None:
        self.boards, self.hypotheses, self.wiring = boards, hypotheses, wiring
        m, k = boards.columns.shape
        self.owner = wiring.owner
        there = boards.columns >= 0
        self.column = np.where(there, boards.columns, 0)
        self.there = there & ~wiring.mute[:, None]
        # Where the slots of each site lie, and the place that each takes as its board is laid now
        # and beyond it: layouts that a turn carries into themselves have the same places again.
        self.spots = (
            boards.places[:, 0] if boards.turns is not None else boards.places.reshape(m, 6 * k, 3)
        )
        self.taken = np.empty((m, 6, k), np.int64)
        for site in range(m):
            for element in range(6):
                total = compose(element, int(wiring.element[site]))
                order = wiring.order[site]
                self.taken[site, element] = (
                    boards.turns[total][order] if boards.turns is not None else total * k + order
                )
        self.pairs = np.array(boards.pairs, np.int64).reshape(-1, 2)
        self.centres = boards.centres
        moves = [fault.moves(boards) for fault in hypotheses.faults[hypotheses.chain_first :]]
        self.chain_moves = [(np.array([*one]), np.array([*one.values()])) for one in moves]
        self.sites = len(boards.table) / 3.0  # places a missed touch may be at: a few mm apart

    def hear(self, touch: Touch) -> tuple[FloatArray, bool]:
        """(h,) log chance of a touch's answers, and whether they came from where it was asked."""
        terms = self._terms(touch)
        found = self._judge(terms)
        first = 1 + len(self.hypotheses.swaps)
        mute = slice(first, first + len(self.boards))  # silence has more causes than one
        found[mute] = np.minimum(found[mute], found[0] + SILENCE)
        # Whatever happens, one touch cannot say more than a model may be trusted.
        return np.logaddexp(found, found.max() + np.log(ODD)), self._fits(terms)

    def _fits(self, terms: Terms) -> bool:
        """Whether the answers came from where the touch was asked for, as the wiring is known."""
        own = self.owner[terms.near]
        base = terms.weights + terms.reads[:, own, np.arange(len(own))].sum(axis=1)
        base = base - terms.silent[own].sum()
        there = base[terms.asked]
        return bool(np.logaddexp.reduce(there) >= np.logaddexp.reduce(base) + np.log(0.5))

    # What was unknown of the touch.

    def _terms(self, touch: Touch) -> Terms:
        level = np.where(self.there, level_of(touch.response)[self.column], -1)
        points, weights, here = self._cases(touch, level)
        near = self._near(points)
        square, along = _to_paths(points.astype(np.float32), self.spots[near].astype(np.float32))
        step = steps_at(square, STROKE_SHAPES if touch.how == "stroke" else SHAPES)
        s, o = step.shape[:2]
        step = step.reshape(s * o, *step.shape[2:])
        weights = np.add.outer(np.full(s, -np.log(s)), weights).ravel()
        step = np.concatenate([step, np.zeros_like(step[:1])])  # a touch of nothing
        weights = np.append(weights, np.log(AIR))
        asked = np.append(np.tile(here, s), False)
        arrival = None
        if touch.how == "stroke":
            arrival = self._as_laid(np.concatenate([np.tile(along, (s, 1, 1)), along[:1]]), near)
        return self._told(self._as_laid(step, near), (weights, asked), near, level, touch, arrival)

    def _as_laid(self, values: NDArray[Any], near: IntArray) -> NDArray[Any]:
        """(q, b, 6, k) of values (q, b, places): for each way that a board may be laid."""
        rows = np.arange(len(near))[:, None, None]
        return np.asarray(values[:, rows, self.taken[near]])

    def _cases(self, touch: Touch, level: IntArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Where it may really have been: (o, p, 3) paths, log chances, whether as asked."""
        if touch.how == "stroke":
            points, weight = self._strokes(touch.path)
            return points, weight, np.ones(len(points), bool)
        place = touch.path[0]
        shift, weight = offsets()
        axes = tangents(self.boards, place)
        points = place + shift @ axes
        there, chance = self._anywhere(level)
        here = np.arange(len(points) + len(there)) < len(points)
        return (np.concatenate([points[:, None], there]), np.concatenate([weight, chance]), here)

    def _anywhere(self, level: IntArray) -> tuple[FloatArray, FloatArray]:
        """Where the answers themselves say that the touch was: (o, 1, 3) paths, log chances."""
        strong = np.argsort(-level, axis=None, kind="stable")[:PEAKS]
        module, slot = np.unravel_index(strong, level.shape)
        felt = (level[module, slot] > 0) & (self.wiring.site[module] >= 0)
        module, slot = module[felt], slot[felt]
        site = self.wiring.site[module]
        places = self.spots[site, self.taken[site, 0, slot]]
        places = places[np.isfinite(places[:, 0])]
        return places[:, None], np.full(len(places), np.log(MISS / self.sites))

    def _strokes(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Strokes beside the one asked for: both ends off to a side."""
        share = np.linspace(0.0, 1.0, len(path))
        off = np.array([-8e-3, -4e-3, 0.0, 4e-3, 8e-3])
        first, last = (end.ravel() for end in np.meshgrid(off, off, indexing="ij"))
        lateral = first[:, None] * (1.0 - share) + last[:, None] * share
        points = path + lateral[..., None] * sideways(self.boards, path)
        weight = -0.5 * (first**2 + last**2) / PLACE**2
        return points, weight - np.log(np.exp(weight).sum())

    def _near(self, points: FloatArray) -> IntArray:
        flat = points.reshape(-1, 3)
        away = np.linalg.norm(self.centres[:, None] - flat[None], axis=2).min(axis=1)
        return np.flatnonzero((away < NEAR) & (self.owner >= 0))

    # What that makes of modules and sites.

    def _told(
        self,
        step: IntArray,
        cases: tuple[FloatArray, BoolArray],
        near: IntArray,
        level: IntArray,
        touch: Touch,
        arrival: FloatArray | None,
    ) -> Terms:
        silent = np.where(level >= 0, TABLE[level, 0], 0.0).sum(axis=1)
        now = step[:, :, 0]  # (q, b, k)
        kinds, which = np.unique(level, axis=0, return_inverse=True)
        late: _Late = None
        if arrival is not None:  # the answers of two modules differ by when they came, too
            busy = (level > 0).any(axis=1)
            rest, inverse = np.unique(level[~busy], axis=0, return_inverse=True)
            kinds = np.concatenate([level[busy], rest])
            which = np.empty(len(level), np.int64)
            which[busy] = np.arange(busy.sum())
            which[~busy] = busy.sum() + inverse.ravel()
            when = touch.arrival[self.column]
            shown = np.zeros_like(kinds, float)
            shown[: busy.sum()] = when[busy]
            late = shown[None, :, None], arrival[:, None, :, 0]
        chance = _log_chance(kinds[None, :, None], now[:, None], late)  # (q, u, b, k)
        reads = chance.sum(axis=-1)[:, which.ravel()]
        own = self.owner[near]
        mine = level[own]
        laid = np.zeros((len(step), len(near), 5), np.float32)
        if self.boards.turnable:
            if arrival is not None:
                late = when[own][None, :, None], arrival[:, :, 1:]
            laid = _log_chance(mine[None, :, None], step[:, :, 1:], late).sum(axis=-1)
        some = np.flatnonzero((mine > 0).any(axis=1))  # silent channels may well be exchanged
        late = None if arrival is None else (when[own[some]][None], arrival[:, some, 0])
        exchanged = self._exchanged(mine[some], now[:, some], late)
        return Terms(*cases, near, reads, silent, laid, some, exchanged)

    def _exchanged(self, level: IntArray, step: IntArray, late: _Late) -> FloatArray:
        """(q, s, p) log chance of modules' answers (s, k), were two channels exchanged."""
        one, other = self.pairs[:, 0], self.pairs[:, 1]

        def chance(a: IntArray | slice, b: IntArray | slice) -> FloatArray:
            own = None if late is None else (late[0][..., a], late[1][..., b])
            return _log_chance(level[None][..., a], step[..., b], own)

        direct = chance(slice(None), slice(None))
        kept = direct.sum(axis=-1, keepdims=True) - direct[..., one] - direct[..., other]
        return np.asarray(kept + chance(one, other) + chance(other, one))

    # What that makes of faults.

    def _judge(self, terms: Terms) -> FloatArray:
        """(h,) log chance of the answers for each hypothesis, summed over the cases."""
        m, near = len(self.boards), terms.near
        b = np.arange(len(near))
        own = self.owner[near]
        mine = terms.reads[:, own, b]  # (q, b) each near site read by its own module
        far = terms.silent.sum() - terms.silent[own].sum()
        base = terms.weights + far + mine.sum(axis=1)
        top = base.max()
        share = np.exp(base - top)
        healthy = np.log(share.sum()) + top

        def summed(delta: NDArray[Any]) -> FloatArray:
            """Log chance with changes (q, ...) against the wiring as it is."""
            total = delta + base.reshape(-1, *[1] * (delta.ndim - 1)).astype(np.float32)
            most = total.max(axis=0)
            inside = np.exp(total - most)
            return np.asarray(most + np.log(inside.sum(axis=0)))

        place = np.full(m, -1)
        place[near] = b
        spot = np.where(self.wiring.site >= 0, place[self.wiring.site], -1)  # of modules
        now = np.tile(terms.silent.astype(np.float32), (len(base), 1))
        now[:, own] = mine
        takes = terms.reads - now[:, :, None]  # (q, m, b) module reads a near site instead
        leaves = terms.silent.astype(np.float32) - now  # (q, m) module reads a far one or none
        # Swaps, for each near site's module against all others.
        gives = leaves[:, own][:, :, None].repeat(m, axis=2)  # the near module reads the other
        inside = spot >= 0
        gives[:, :, inside] = takes[:, own][:, :, spot[inside]]
        swap = summed(gives + takes.transpose(0, 2, 1))  # (b, m)
        matrix = np.full((m, m), healthy)
        matrix[own] = swap
        matrix[:, own] = swap.T
        found = np.full(len(self.hypotheses), healthy)
        pairs = self.hypotheses.swaps
        n = 1
        found[n : n + len(pairs)] = matrix[pairs[:, 0], pairs[:, 1]]
        n += len(pairs)
        found[n + own] = summed(leaves[:, own])
        n += m
        laid = summed(terms.laid - mine[..., None])
        for element in range(5):
            found[n + own] = laid[:, element]
            n += m
        p = len(self.pairs)
        if p and len(terms.some):
            spots = n + own[terms.some, None] * p + np.arange(p)
            found[spots] = summed(terms.exchanged - mine[:, terms.some, None])
        n += m * p
        for number, (modules, others) in enumerate(self.chain_moves):
            spots = np.where(others >= 0, spot[others], -1)
            change = (
                np.where(spots >= 0, takes[:, modules, np.maximum(spots, 0)], leaves[:, modules])
                if len(near)
                else leaves[:, modules]
            )
            found[n + number] = summed(change.sum(axis=1))
        return found


def _to_paths(points: FloatArray, slots: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Squared distances (o, b, k) of slots (b, k, 3) to paths (o, p, 3), and shares along them."""
    o, p = points.shape[:2]
    shape = (o, *slots.shape[:2])
    middle = points[0, 0]
    flat, points = slots.reshape(-1, 3) - middle, points - middle
    flat = np.where(np.isnan(flat), np.float32(1e3), flat)  # a place that is not there is far
    square = (
        (points**2).sum(axis=2)[..., None]
        + (flat**2).sum(axis=1)
        - 2.0 * (points.reshape(-1, 3) @ flat.T).reshape(o, p, -1)
    )
    if p == 1:
        return square.reshape(shape), np.zeros((0,), np.float32)
    nearest = square.argmin(axis=1)
    least = np.take_along_axis(square, nearest[:, None], axis=1)[:, 0]
    return least.reshape(shape), (nearest / np.float32(p - 1)).astype(np.float32).reshape(shape)


_Late = tuple[FloatArray, FloatArray] | None  # when answers came, and when they should


def _log_chance(level: IntArray, step: IntArray, late: _Late = None) -> FloatArray:
    """Log chance of levels for expected answers; 0 where there is no channel (level -1)."""
    found = TABLE[np.maximum(level, 0), step]
    found = np.where(level >= 0, found, np.float32(0.0))
    if late is not None:
        found = found + np.where(level > 0, _timing(*late, step), np.float32(0.0))
    return np.asarray(found)


def _timing(when: FloatArray, where: FloatArray, step: IntArray) -> FloatArray:
    """Log density of when an answer came, where one was expected; 0 elsewhere."""
    gap = np.asarray(when - where, np.float32) / np.float32(TIMING)
    density = 0.1 + 0.9 / (2.5066 * TIMING) * np.exp(-0.5 * gap**2)
    return np.where(step > 0, np.log(density), np.float32(0.0))


SURE = 0.99  # a fault that is so probable is named
ILL, LIKELY = 0.1, 0.5  # at the end: healthy less probable, and one fault more than all others
CLEAR = 0.95  # a skin without one that is so probable is healthy
# Channels that answer a fingertip, at the iCub's pitch: those of the simulator light 14 at most.
MAX_OF_A_POKE, USUAL = 18, 6.8e-3
BACKING = 2.0  # evidence beside the touch that speaks loudest for a fault, to name it [nats]
INSIDE = {"turned_module", "mirrored_module"}  # a poke that misses its module looks like neither
QUIET = 14.0  # a module whose channels do not even have noise is mute [nats]
LIVELY = np.log(0.005)  # a module with noise of its own is hardly mute: its foam may have come off
MAX_FAULTS = 8  # found one after the other, at most
MISFIT = 0.34  # share of touches that fit no fault's model: the places are not those touched
FEW = 3
NEVER = -60.0  # logarithm of the probability of what cannot be


@dataclass(frozen=True, eq=False, slots=True)
class Found:
    """A fault that was named.

    Attributes
    ----------
    fault : Fault
    confidence : float
    alternatives : tuple of (Fault, float)
        What else it may be, most probable first.
    """

    fault: Fault
    confidence: float
    alternatives: tuple[tuple[Fault, float], ...] = ()


@dataclass(eq=False)
class Doctor:
    """What is known of the wiring of one part.

    Attributes
    ----------
    boards : Boards
    hypotheses : Hypotheses
    touches : list of Touch
        So far.
    found : list of Found
        Faults named, in the order in which they were found.
    """

    boards: Boards
    hypotheses: Hypotheses
    places: dict[str, Candidates] = field(default_factory=dict)
    healthy_choosers: dict[str, Chooser] = field(default_factory=dict)
    touches: list[Touch] = field(default_factory=list)
    found: list[Found] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.wiring = Wiring.as_mapped(self.boards)
        self._rest: RestFindings | None = None
        self._begin()

    @classmethod
    def of(cls, boards: Boards) -> Doctor:
        """A doctor who has seen nothing."""
        return cls(boards, all_faults(boards))

    def again(self) -> Doctor:
        """A doctor for another skin of the same layout, with the same preparations."""
        return Doctor(self.boards, self.hypotheses, self.places, self.healthy_choosers)

    @property
    def posterior(self) -> FloatArray:
        """(h,) logarithm of the probability of each hypothesis."""
        return np.asarray(self._log - logsumexp(self._log))

    @property
    def healthy(self) -> float:
        """Probability that nothing is wrong beyond what was found."""
        return float(np.exp(self.posterior[0]))

    def rest(self, findings: RestFindings) -> list[Found]:
        """Take what the skin told untouched; the mute modules and chains that are sure with it."""
        if not findings.tells:
            return []
        self._rest = findings
        self._replay()
        return self._name(self._sure)

    def hear(self, touch: Touch) -> list[Found]:
        """Take a touch; the faults that are sure with it.

        Raises
        ------
        InvalidArrayError
            An answer of another length than the part's table.
        """
        if len(touch.response) != len(self.boards.table):
            raise InvalidArrayError(
                f"{len(touch.response)} answers for the {len(self.boards.table)} taxels of "
                f"{self.boards.part!r}"
            )
        self.touches.append(touch)
        self._take(touch)
        return self._name(self._sure)

    def conclude(self) -> list[Found]:
        """Name what is certainly wrong, though not for certain which fault it is; the last word."""
        return self._name(self._likely)

    def _name(self, found_next: Callable[[], Found | None]) -> list[Found]:
        """Name one fault after the other, and judge all touches again with each as known."""
        first = len(self.found)
        while len(self.found) < MAX_FAULTS and (one := found_next()) is not None:
            self.found.append(one)
            self.wiring = one.fault.apply(self.wiring, self.boards)
            self._replay()
        return self.found[first:]

    def _sure(self) -> Found | None:
        return self._likeliest(SURE, self._backed, 3, 1e-4)

    def _likely(self) -> Found | None:
        ill = self.touches and self.healthy < ILL
        return self._likeliest(LIKELY, self._shown, 4, 0.01) if ill else None

    def suspects(self, count: int) -> list[tuple[Fault, float]]:
        """The most probable faults beyond those found, and how probable."""
        posterior = self.posterior
        order = np.argsort(-posterior[1:], kind="stable")[:count] + 1
        return [(self.hypotheses.faults[row], float(np.exp(posterior[row]))) for row in order]

    def next_place(self, how: str) -> tuple[FloatArray, float]:
        """The path (p, 3) to touch next [m], and what it would tell [nats]."""
        if how not in self.places:
            self.places[how] = candidates(self.boards, how)
        # One for all doctors of this layout while nothing was found.
        choosers = self._choosers if self.found else self.healthy_choosers
        if how not in choosers:
            choosers[how] = Chooser(self.boards, self.hypotheses, self.wiring, self.places[how])
        asked = [touch.middle for touch in self.touches if touch.how == how]
        gains = choosers[how].gains(self.posterior, asked)
        row = int(np.argmax(gains))
        return self.places[how].paths[row], float(gains[row])

    @property
    def misfits(self) -> int:
        """Touches that were not felt where they were asked for, as the wiring is known now."""
        return sum(not fits for fits in self._fits)

    @property
    def status(self) -> str:
        """One of "healthy", "faulty", "undecided" and "inconsistent"."""
        if len(self.touches) >= FEW and self.misfits > MISFIT * len(self.touches):
            return "inconsistent"
        if self.found:
            return "faulty"
        return "healthy" if self.healthy >= CLEAR else "undecided"

    def _begin(self) -> None:
        self._witness = Witness(self.boards, self.hypotheses, self.wiring)
        self._log = self.hypotheses.log_prior.copy()
        # A mute module in another's place would be that one's silence, for which one touch is
        # bounded; and what was named once is known.
        swaps = self.hypotheses.swaps
        self._log[1 : 1 + len(swaps)][self.wiring.mute[swaps].any(axis=1)] = NEVER
        named = {one.fault for one in self.found}
        self._log[[fault in named for fault in self.hypotheses.faults]] = NEVER
        if self._rest is not None:
            self._log += self._at_rest(self._rest)
        self._choosers: dict[str, Chooser] = {}
        self._heard: list[FloatArray] = []
        self._fits: list[bool] = []
        self.broad = 0  # pokes that more channels answered than a fingertip presses
        self._said: list[FloatArray] = []
        self._before = self._log.copy()

    def _at_rest(self, rest: RestFindings) -> FloatArray:
        """(h,) what the rest says: a fault that mutes modules fits those that do not send."""
        quiet = np.isin(np.arange(len(self.boards)), rest.mute)
        quiet &= ~self.wiring.mute & (self.wiring.site >= 0)
        score = np.where(quiet, QUIET, np.where(rest.alive, LIVELY, 0.0))
        found = np.zeros(len(self.hypotheses))
        first = 1 + len(self.hypotheses.swaps)
        found[first : first + len(self.boards)] = score
        for row in range(self.hypotheses.chain_first, len(self.hypotheses)):
            moves = self.hypotheses.faults[row].moves(self.boards)
            found[row] = score[[module for module, to in moves.items() if to < 0]].sum()
        return found

    def _replay(self) -> None:
        self._begin()
        for touch in self.touches:
            self._take(touch)

    def _take(self, touch: Touch) -> None:
        before = sum(float(np.linalg.norm(touch.middle - old)) < AGAIN for old in self._heard)
        weight = 1.0 / (1.0 + before)  # the same taxels answer again: no new evidence
        self._heard.append(touch.middle)
        found, fits = self._witness.hear(touch)
        most = MAX_OF_A_POKE * max(1.0, USUAL / self.boards.pitch) ** 2
        if touch.how == "poke" and int((touch.response > THRESHOLD).sum()) > most:
            found, fits = np.zeros_like(found), False  # whatever that was, it was no poke
            self.broad += 1
        self._fits.append(fits)
        self._said.append(weight * (found - found[0]))
        self._log = self._log + weight * found

    def _backed(self, row: int) -> bool:
        """Whether a fault has more behind it than one touch, which may just have missed."""
        start = self.hypotheses.log_prior
        rest = float(self._before[row] - self._before[0] - (start[row] - start[0]))
        said = [float(one[row]) for one in self._said]
        return rest + sum(said) - max([*said, 0.0]) >= BACKING

    def _shown(self, row: int) -> bool:
        """Whether a touch that missed its place cannot be all there is behind a fault."""
        poked = all(touch.how == "poke" for touch in self.touches)
        return self._backed(row) or (poked and self.hypotheses.faults[row].kind in INSIDE)

    def _likeliest(
        self, sure: float, trusted: Callable[[int], bool], count: int, least: float
    ) -> Found | None:
        """The likeliest fault, if it is so sure and trusted; with others of at least so much."""
        posterior = self.posterior
        row = int(np.argmax(posterior))
        if row == 0 or posterior[row] < np.log(sure) or not trusted(row):
            return None
        others = tuple(one for one in self.suspects(count + 1)[1:] if one[1] > least)
        return Found(self.hypotheses.faults[row], float(np.exp(posterior[row])), others)
