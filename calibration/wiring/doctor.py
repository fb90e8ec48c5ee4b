"""The wiring doctor: asks for touches, hears the answers, and names faults one after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.special import logsumexp

from calibration.wiring.answer_model import THRESHOLD
from calibration.wiring.boards import Boards, Wiring
from calibration.wiring.evidence import Witness
from calibration.wiring.faults import Fault, Hypotheses, all_faults
from calibration.wiring.places import AGAIN, Candidates, Chooser, candidates
from calibration.wiring.touches import RestFindings, Touch
from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError

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
        return self._name()

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
        return self._name()

    def _name(self) -> list[Found]:
        """Name what is sure, one fault after the other."""
        new: list[Found] = []
        while len(self.found) < MAX_FAULTS:
            one = self._likeliest(SURE, self._backed, 3, 1e-4)
            if one is None:
                break
            new.append(self._named(one))
        return new

    def _named(self, one: Found) -> Found:
        """Take a fault as known, and judge all touches again with it."""
        self.found.append(one)
        self.wiring = one.fault.apply(self.wiring, self.boards)
        self._replay()
        return one

    def conclude(self) -> list[Found]:
        """Name what is certainly wrong, though not for certain which fault it is; the last word."""
        new: list[Found] = []
        while self.touches and len(self.found) < MAX_FAULTS and self.healthy < ILL:
            one = self._likeliest(LIKELY, self._shown, 4, 0.01)
            if one is None:
                break
            new.append(self._named(one))
        return new

    def suspects(self, count: int = 5) -> list[tuple[Fault, float]]:
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
        row, gain = choosers[how].best(self.posterior, asked)
        return self.places[how].paths[row], gain

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
