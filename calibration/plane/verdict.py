"""Whether presses on a plane tell where patches are, and what no press can tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibration.patch.patch_calibration import Status
from calibration.plane.model import PlaneProblem
from calibration.plane.solve import Solution
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import transform_points

KNOWN = 3e-3  # a patch is located where its taxels' predicted errors are below [m]
ODD_DEPTH = 5.0  # press depth of a contact that contradicts the rest, in spreads
ODD_READINGS = 8.0  # its readings' loss over the median's, in median absolute deviations
ODD_LOSS = 6.0  # and at least so much above the median
MANY_ODD = 0.25  # share of contradicting contacts above which nobody knows which are right
ROUGH = 4e-3  # spread of the press depths [m]: above, poses and taxels do not belong together
RIVAL = 3.0  # log likelihood by which a second minimum is as good
MM = 1e3


def some(rows: Sequence[int] | IntArray, most: int = 8) -> str:
    """The first few numbers, in words."""
    return ", ".join(str(int(row)) for row in rows[:most]) + (" ..." if len(rows) > most else "")


def second_place(problem: PlaneProblem, found: Sequence[Solution]) -> float | None:
    """How far taxels lie in a second minimum that is as good [m]; None where there is none."""
    first = found[0].state
    for other in found[1:]:
        if other.cost > found[0].cost + RIVAL:
            continue
        apart = [
            np.linalg.norm(
                transform_points(other.state.mounts[name], one.chain.taxels)
                - transform_points(first.mounts[name], one.chain.taxels),
                axis=1,
            ).mean()
            for name, one in problem.patches.items()
        ]
        if max(apart) > KNOWN:
            return float(max(apart))
    return None


def contradicting(problem: PlaneProblem, best: Solution) -> tuple[int, ...]:
    """Contacts whose depth or readings contradict the others."""
    depth = np.abs(best.state.depths) / best.spreads.depth
    losses = problem.contact_losses(best.state)
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
    dropped: tuple[int, ...],
    rival: float | None,
    contacts: int,
    weakest: Mapping[str, str],
) -> list[tuple[Status, str]]:
    """Every doubt with its status, the first of which counts."""
    judged: list[tuple[Status, str]] = []
    left = [row for row in odd if row not in dropped]
    if left:
        advice = (
            "leave them out (--drop-inconsistent) or press again"
            if len(left) <= MANY_ODD * contacts
            else "too many to tell which are right: poses and taxels may not belong together"
        )
        judged.append(
            (
                Status.AMBIGUOUS,
                f"{len(left)} of {contacts} contacts contradict the others: contacts "
                f"{some(left)} (counted from 0); {advice}",
            )
        )
    if best.spreads.depth > ROUGH:
        judged.append(
            (
                Status.AMBIGUOUS,
                f"press depths differ by {MM * best.spreads.depth:.1f} mm (sd): poses and taxels "
                "do not belong together, or the surface is not flat",
            )
        )
    if rival is not None:
        judged.append(
            (
                Status.AMBIGUOUS,
                f"another place fits as well, {MM * rival:.1f} mm away: more contacts, from other "
                "sides",
            )
        )
    for name, covariance in own.items():
        sd = np.sqrt(np.einsum("nii->n", covariance))
        if np.percentile(sd, 95) > KNOWN:
            # First of all where contacts are too few to tell contradictions from the unknown.
            first = np.percentile(sd, 95) > KNOWN * np.sqrt(widening)
            judged.insert(
                0 if first else len(judged),
                (
                    Status.UNOBSERVABLE,
                    f"taxels of {name} are known to {MM * float(np.percentile(sd, 95)):.1f} mm "
                    f"only (limit {MM * KNOWN:.0f} mm), {weakest[name]}: press in other poses, "
                    "`next` says which",
                ),
            )
    return judged


def assumed(problem: PlaneProblem, names: Sequence[str]) -> tuple[str, ...]:
    """Exact nulls, and what decided them."""
    sigma = f"{np.rad2deg(problem.joint_sigma):.2g} degrees"
    words = []
    for name, one in problem.patches.items():
        if len(one.chain.joints):
            words.append(
                f"the zero position of {names[int(one.chain.joints[-1])]}, the joint just before "
                f"{name}, is the same as a turn of the mount about its axis: prior of {sigma}"
            )
    first = dict.fromkeys(
        names[int(one.chain.joints[0])] for one in problem.patches.values() if len(one.chain.joints)
    )
    if problem.tilting:
        words += [
            f"the zero position of {joint}, the first joint, turns the robot as the unknown plane "
            f"would turn the other way: prior of {sigma}"
            for joint in first
        ]
        words.append(
            "the press depth that all contacts share is the same as the height of the unknown "
            "plane: the plane is given where the skin begins to feel it"
        )
    else:
        words.append(
            "how deep the skin must be pressed before it feels the given plane: prior of 2 mm"
        )
    return tuple(words)
