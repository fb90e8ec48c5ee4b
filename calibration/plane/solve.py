"""The most likely mounts and planes: from coarse to fine, with the spreads of what is random.

And whether presses on a plane tell where patches are, and what no press can tell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from calibration.patch.patch_calibration import Status
from calibration.plane.model import (
    SENSELESS,
    TAIL,
    TAU,
    Layout,
    Plane,
    PlaneProblem,
    PlaneState,
    Spreads,
)
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import transform_points, turn_about
from skinmap.summary import first_few

COARSE = (12e-3, 6e-3, 3e-3)  # widths of the logistic curve [m]: from starts that are 20 mm off
COARSE_STEPS, STEPS = 12, 60
COARSE_DEPTH = 3e-3  # spread of the press depths while the curve is that wide [m]
SETTLED = 0.01  # a step that moves no main unknown further is the last, in predicted errors
COARSE_SETTLED = 1e-4  # [m, rad]
EASY, HARDEST = 1e-3, 1e8  # damping
# Beliefs about the spreads, each worth so many values: few contacts cannot tell them.
BELIEF = Spreads()
WORTH = Spreads(depth=4.0, shift=5.0, height=20.0)
KNOWN = 3e-3  # a patch is located where its taxels' predicted errors are below [m]
ODD_DEPTH = 5.0  # press depth of a contact that contradicts the rest, in spreads
ODD_READINGS = 8.0  # its readings' loss over the median's, in median absolute deviations
ODD_LOSS = 6.0  # and at least so much above the median
MUTE = 0.15  # share of a contact's pressed taxels that may be dead, where no contact felt them
MANY_ODD = 0.25  # share of contradicting contacts above which nobody knows which are right
ROUGH = 4e-3  # spread of the press depths [m]: above, poses and taxels do not belong together
RIVAL = 3.0  # log likelihood by which a second minimum is as good
MM = 1e3


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """A minimum, and its normal matrix."""

    state: PlaneState
    spreads: Spreads
    layout: Layout
    evidence: FloatArray  # (count, count) information of the evidence
    prior: FloatArray  # (count,) of the priors
    cost: float

    def covariance(self) -> FloatArray:
        """(count, count) of all unknowns."""
        return inverse(self.evidence, self.prior)


def inverse(evidence: FloatArray, prior: FloatArray) -> FloatArray:
    """The inverse of evidence + diag(prior), scaled so that units do not matter."""
    normal = evidence + np.diag(prior)
    scale = 1.0 / np.sqrt(np.diag(normal))
    scaled = normal * scale[:, None] * scale
    found = cho_solve(cho_factor(scaled), np.eye(len(scaled)), check_finite=False)
    return np.asarray(found * scale[:, None] * scale)


def solve(problem: PlaneProblem, start: PlaneState) -> Solution:
    """The minimum that a start leads to."""
    search = _Search(problem, problem.layout(), start)
    state = start.copy()
    for tau in COARSE:
        state.tau = tau
        state = search.coarse(state)
    state.tau = max(state.tau / 2.0, TAU)
    return refine(problem, state, start)


def refine(
    problem: PlaneProblem, state: PlaneState, start: PlaneState, spreads: Spreads = BELIEF
) -> Solution:
    """The minimum near a state, spreads and all."""
    layout = problem.layout()
    search, damping = _Search(problem, layout, start), EASY
    every = np.arange(layout.count)
    for _ in range(STEPS):
        step = search.descend(state, spreads, every, damping)
        if step is None:
            break
        state, damping = step.state, step.damping
        variance = np.diag(inverse(step.evidence, step.prior))
        spreads = search.spreads(state, variance, step.prior, spreads)
        if (np.abs(step.move) < SETTLED * np.sqrt(variance))[: layout.tau].all():
            break
    system = problem.system(state, layout)
    prior = problem.prior(state, layout, spreads)
    return Solution(state, spreads, layout, system.normal, prior, search.cost(state, spreads))


@dataclass(frozen=True, eq=False, slots=True)
class _Step:
    state: PlaneState
    move: FloatArray
    damping: float
    evidence: FloatArray  # of the state before
    prior: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class _Search:
    """A problem, and the start that its priors are about."""

    problem: PlaneProblem
    layout: Layout
    start: PlaneState

    def coarse(self, state: PlaneState) -> PlaneState:
        """Steps of mounts, planes, joints and press depths alone under a wide curve."""
        own = np.concatenate([np.arange(self.layout.tau), self.layout.depth])
        spreads, damping = replace(BELIEF, depth=COARSE_DEPTH), EASY
        for _ in range(COARSE_STEPS):
            step = self.descend(state, spreads, own, damping)
            if step is None:
                break
            state, damping = step.state, step.damping
            if np.abs(step.move).max() < COARSE_SETTLED:
                break
        return state

    def descend(
        self, state: PlaneState, spreads: Spreads, own: IntArray, damping: float
    ) -> _Step | None:
        """One of Levenberg's steps of some unknowns that lowers the cost; None where none does."""
        layout = self.layout
        system = self.problem.system(state, layout)
        prior = self.problem.prior(state, layout, spreads)
        gradient = system.slope - prior * self.problem.values(state, layout, self.start)
        gradient[layout.tau] += 0.5 * spreads.fitted
        whole = system.normal[np.ix_(own, own)] + np.diag(prior[own])
        scale = 1.0 / np.sqrt(np.diag(whole))
        scaled = whole * scale[:, None] * scale
        cost = self.cost(state, spreads)
        move = np.zeros(layout.count)
        while damping < HARDEST:
            damped = cho_factor(scaled + damping * np.eye(len(own)))
            move[own] = scale * cho_solve(damped, scale * gradient[own], check_finite=False)
            moved = self.problem.moved(state, layout, move)
            # A hair of slack: at the minimum rounding decides.
            if self.cost(moved, spreads) <= cost + 1e-9 * abs(cost):
                return _Step(moved, move, max(damping / 10.0, 1e-9), system.normal, prior)
            damping *= 10.0
        return None

    def cost(self, state: PlaneState, spreads: Spreads) -> float:
        """-log of evidence and priors, but for what does not change with the state."""
        layout = self.layout
        x = self.problem.values(state, layout, self.start)
        squares = self.problem.prior(state, layout, spreads) * x**2
        # Depths are weighed again before each step: within one they are plain squares.
        scaled = (x[layout.depth] / spreads.depth) ** 2
        squares[layout.depth] = (TAIL + 1.0) * np.log1p(scaled / TAIL)
        # Unknowns that follow the noise make the curve look steeper than it is: integrated over
        # them, the evidence has a factor of tau for every two (its information goes with 1 / tau).
        fitted = 0.5 * spreads.fitted * x[layout.tau]
        return self.problem.evidence_cost(state) + 0.5 * float(squares.sum()) - fitted

    def spreads(
        self, state: PlaneState, variance: FloatArray, prior: FloatArray, before: Spreads
    ) -> Spreads:
        """Spreads that make what was found, and what is left unknown of it, most likely."""
        layout = self.layout
        x = self.problem.values(state, layout, self.start)
        settled = np.clip(1.0 - prior * variance, 0.0, 1.0)
        squares = x**2
        # As the heavy tails weigh them.
        squares[layout.depth] *= prior[layout.depth] * before.depth**2 * TAIL / (TAIL + 1.0)
        found = {}
        columns = {
            "depth": layout.depth,
            "shift": np.concatenate(list(layout.shift.values())),
            "height": np.concatenate(list(layout.height.values())),
        }
        for kind, own in columns.items():
            # MacKay, Neural Computation 4, 1992: only what the evidence settles counts.
            worth, belief = getattr(WORTH, kind), getattr(BELIEF, kind)
            total = worth * belief**2 + squares[own].sum()
            found[kind] = float(np.sqrt(total / (worth + settled[own].sum())))
        return Spreads(**found, fitted=float(settled.sum()))


def first_states(problem: PlaneProblem, planes: Sequence[Plane] | None) -> list[PlaneState]:
    """States to start from: mounts as they came, planes as the contacts suggest them."""
    places, back = _middles(problem)
    if planes is not None:
        return [_state(problem, [_facing(problem, one, k, back) for k, one in enumerate(planes)])]
    pressed = [problem.contacts.surface == number for number in range(problem.surfaces)]
    return [
        _state(problem, [_first_plane(places[rows], back[rows], kind) for rows in pressed])
        for kind in ("spread", "side")
    ]


def _state(problem: PlaneProblem, planes: Sequence[Plane]) -> PlaneState:
    contacts = problem.contacts
    return PlaneState(
        {name: one.chain.mount for name, one in problem.patches.items()},
        np.array([plane.normal for plane in planes]),
        np.array([plane.point for plane in planes]),
        np.zeros(contacts.angles.shape[1]),
        COARSE[0],
        np.zeros(len(contacts)),
        {name: np.zeros((one.member.shape[1], 3)) for name, one in problem.patches.items()},
        {name: np.zeros(len(one.module)) for name, one in problem.patches.items()},
    )


def _middles(problem: PlaneProblem) -> tuple[FloatArray, FloatArray]:
    """Middle of the active taxels (m, 3) in the base, and the way from there to the patches'."""
    sums = np.zeros((len(problem.contacts), 3))
    whole, count = sums.copy(), np.zeros(len(sums))
    total = 0
    for name, one in problem.patches.items():
        T = one.chain.frames(problem.contacts.angles) @ one.chain.mount
        x = np.einsum("mij,nj->mni", T[:, :3, :3], one.chain.taxels) + T[:, None, :3, 3]
        felt = problem.contacts.active[name] & one.usable
        sums += np.einsum("mn,mni->mi", felt, x)
        whole += x.sum(axis=1)
        count += felt.sum(axis=1)
        total += len(one.usable)
    middle = sums / np.maximum(count, 1)[:, None]
    return middle, whole / total - middle


def _facing(problem: PlaneProblem, plane: Plane, number: int, back: FloatArray) -> Plane:
    """The plane with its normal on the patches' side."""
    side = back[problem.contacts.surface == number].sum(axis=0) @ plane.normal
    return plane if side >= 0 else Plane(plane.point, -plane.normal)


def _first_plane(places: FloatArray, back: FloatArray, kind: str) -> Plane:
    """A plane through the middles of contacts: by their spread, or by which side patches are on."""
    middle = np.median(places, axis=0)
    side = back.mean(axis=0)
    if kind == "spread" and len(places) >= 4:
        _, _, axes = np.linalg.svd(places - middle, full_matrices=False)
        normal = axes[2] * (1.0 if axes[2] @ side >= 0 else -1.0)
    else:
        normal = side / max(float(np.linalg.norm(side)), 1e-9)
    return Plane(middle, normal)


def rivals(problem: PlaneProblem, best: Solution, start: PlaneState) -> list[Solution]:
    """Minima that half turns of a patch lead to, about each of its own axes.

    Presses whose normals lie in one plane fit a flat patch and its mirror image alike, and a half
    turn makes the one of the other. The middle of the mount's prior is turned too: that prior
    bounds the search and decides nothing.
    """
    return [
        refine(problem, _half_turned(best.state, name, turn), _half_turned(start, name, turn))
        for name, one in problem.patches.items()
        for turn in _half_turns(one.chain.taxels)
    ]


def _half_turns(places: FloatArray) -> list[FloatArray]:
    """(4, 4) half turns about the principal axes of places (n, 3), through their middle."""
    middle = places.mean(axis=0)
    _, _, axes = np.linalg.svd(places - middle, full_matrices=False)
    return [turn_about(middle, 2.0 * np.outer(axis, axis) - np.eye(3)) for axis in axes]


def _half_turned(state: PlaneState, name: str, turn: FloatArray) -> PlaneState:
    return replace(state.copy(), mounts=state.mounts | {name: state.mounts[name] @ turn})


def second_place(problem: PlaneProblem, found: Sequence[Solution]) -> float | None:
    """How far taxels lie in a second minimum that is as good [m]; None where there is none."""
    first = found[0].state
    for other in found[1:]:
        if other.cost > found[0].cost + RIVAL:
            continue
        apart = []
        for name, one in problem.patches.items():
            taxels = one.chain.taxels
            here, there = (transform_points(x.mounts[name], taxels) for x in (first, other.state))
            apart.append(np.linalg.norm(there - here, axis=1).mean())
        if max(apart) > KNOWN:
            return float(max(apart))
    return None


def contradicting(problem: PlaneProblem, best: Solution) -> tuple[int, ...]:
    """Contacts whose depth or readings contradict the others."""
    depth = np.abs(best.state.depths) / best.spreads.depth
    losses = problem.contact_losses(best.state)
    # A large contact meets some of the taxels that are dead but were pressed too seldom to be
    # left out: their silence contradicts nobody.
    never, pressed = problem.silent_losses(best.state)
    losses -= np.minimum(never, -MUTE * np.log(SENSELESS) * pressed)
    middle = float(np.median(losses))
    spread = max(1.4826 * float(np.median(np.abs(losses - middle))), 1.0)
    odd = (depth > ODD_DEPTH) | (
        (losses > middle + ODD_READINGS * spread) & (losses > middle + ODD_LOSS)
    )
    return tuple(np.flatnonzero(odd).tolist())


def judge(
    own: Mapping[str, FloatArray],
    widening: float,
    best: Solution,
    odd: tuple[int, ...],
    rival: float | None,
    contacts: int,
    weakest: Mapping[str, str],
) -> list[tuple[Status, str]]:
    """Every doubt with its status, the first of which counts."""
    judged: list[tuple[Status, str]] = []
    if odd:
        advice = "leave them out of the file or press again"
        if len(odd) > MANY_ODD * contacts:
            advice = "too many to identify the right ones: poses and taxels may not belong together"
        named = first_few(odd, 8)
        words = f"{len(odd)} of {contacts} contacts contradict the others: contacts {named}"
        judged.append((Status.AMBIGUOUS, f"{words} (counted from 0); {advice}"))
    if best.spreads.depth > ROUGH:
        words = (
            f"press depths differ by {MM * best.spreads.depth:.1f} mm (sd): poses and taxels "
            "do not belong together, or the surface is not flat"
        )
        judged.append((Status.AMBIGUOUS, words))
    if rival is not None:
        words = f"another place fits as well, {MM * rival:.1f} mm away"
        judged.append((Status.AMBIGUOUS, f"{words}: more contacts, from other sides"))
    for name, covariance in own.items():
        sd = float(np.percentile(np.sqrt(np.einsum("nii->n", covariance)), 95))
        if sd > KNOWN:
            # First of all where contacts are too few to tell contradictions from the unknown.
            first = sd > KNOWN * np.sqrt(widening)
            words = (
                f"taxels of {name} are known to {MM * sd:.1f} mm only (limit {MM * KNOWN:.0f} mm), "
                f"{weakest[name]}: press in other poses, `next` lists them"
            )
            judged.insert(0 if first else len(judged), (Status.UNOBSERVABLE, words))
    return judged


def assumed(problem: PlaneProblem, names: Sequence[str]) -> tuple[str, ...]:
    """Exact nulls, and what decided them."""
    sigma = f"{np.rad2deg(problem.joint_sigma):.2g} degrees"
    joints = {name: one.chain.joints for name, one in problem.patches.items()}
    ways = {name: [names[int(k)] for k in own] for name, own in joints.items() if len(own)}
    slides = {names[int(k)] for one in problem.patches.values()
              for k in one.chain.joints[one.chain.sliding]}  # fmt: skip
    words = [
        f"the zero position of {way[-1]}, the joint just before {name}, is the same as a turn of "
        f"the mount about its axis: prior of {sigma}"
        for name, way in ways.items()
        if way[-1] not in slides
    ]
    if not problem.tilting:
        deep = "how deep the skin must be pressed before it feels the given plane: prior of 2 mm"
        return (*words, deep)
    turned = [
        f"the zero position of {joint}, the first joint, turns the robot as the unknown plane "
        f"would turn the other way: prior of {sigma}"
        for joint in dict.fromkeys(way[0] for way in ways.values())
        if joint not in slides
    ]
    high = (
        "the press depth that all contacts share is the same as the height of the unknown "
        "plane: the plane is given where the skin begins to feel it"
    )
    return (*words, *turned, high)
