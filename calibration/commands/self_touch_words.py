"""What a fit of self-touch is worth, in words: status, reasons, notes, and what to touch next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from calibration.commands.results import MM, Probe
from calibration.files.self_touch_files import SelfTouchData
from calibration.mount.chains import Chain
from calibration.mount.skin_contacts import SelfTouchFit, pitch_of, taxel_covariance
from calibration.patch.patch_calibration import Status
from calibration.patch.patch_status import COVERAGE, NEXT, weak_direction
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.rigid import transform_points

OVERFIT = 1.5  # times the misses of the fit that unseen touches may miss by
SLIPPED = 10e-3  # how far a tip may lie from where it was thought to be without a word [m]


def placed(chain: Chain, fit: SelfTouchFit) -> tuple[IntArray, FloatArray, FloatArray]:
    """Channels (n,), positions (n, 3) [m] and covariances (n, 3, 3) of a chain's taxels."""
    rows = np.flatnonzero(np.isfinite(chain.taxels).all(axis=1))
    mount = fit.mounts[chain.name]
    covariance = taxel_covariance(chain, mount, fit.covariances[chain.name])
    return rows, transform_points(mount, chain.taxels[rows]), covariance


def predicted(chain: Chain, fit: SelfTouchFit) -> FloatArray:
    """(n,) predicted errors of a chain's taxels [m]."""
    return np.asarray(np.sqrt(np.einsum("nii->n", placed(chain, fit)[2])))


def touched(data: SelfTouchData, fit: SelfTouchFit, name: str) -> BoolArray:
    """(n,) whether each taxel that there is was touched in a recording that counts."""
    chain = data.chains[name]
    count = np.zeros(len(chain.taxels), np.bool_)
    for recording in data.recordings:
        for side, own in zip(recording.chains, recording.touched, strict=True):
            if side == name and own is not None and recording.name not in fit.dropped:
                count[np.unique(np.concatenate([np.zeros(0, np.int64), *own]))] = True
    return count[np.isfinite(chain.taxels).all(axis=1)]


def judge(data: SelfTouchData, fit: SelfTouchFit, asked: Sequence[str]) -> list[tuple[str, str]]:
    """Statuses with their reasons, the gravest first; none where all is well."""
    checks = (
        (Status.AMBIGUOUS, _contradictions(fit)),
        (Status.UNOBSERVABLE, _unobservable(data, fit, asked)),
        (Status.LOW_COVERAGE, _uncovered(data, fit)),
        (Status.AMBIGUOUS, _too_few(fit)),
    )
    return [(status, reason) for status, check in checks for reason in check]


def _contradictions(fit: SelfTouchFit) -> Iterator[str]:
    left = [name for name in fit.inconsistent if name not in fit.dropped]
    if not left:
        return
    one = ", ".join(f"{name} (median {MM * fit.medians[name]:.1f} mm)" for name in left)
    own = [name for name in left if name in fit.agreement.senseless]
    both_stay = "of two the wrong one is unknown, so both stay"
    if own:
        yield (
            f"{one}: poses and touches of {', '.join(own)} do not belong together (wrong joints, "
            "another time, or another robot)"
        ) + (f"; {both_stay}" if len(fit.medians) == 2 else "")
    elif len(fit.medians) == 1:
        yield (
            f"{one}: explained only by zeros of joints further off than joints are; a mount that "
            "is not calibrated may be wrong"
        )
    elif len(fit.medians) == 2:
        yield f"{one} contradict each other; {both_stay}"
    else:
        yield f"{one}: one of them contradicts the others; which one is unknown, so all stay"


def _unobservable(data: SelfTouchData, fit: SelfTouchFit, asked: Sequence[str]) -> Iterator[str]:
    for name in fit.mounts:
        half = pitch_of(data.chains[name].taxels) / 2
        _, places, covariance = placed(data.chains[name], fit)
        sd = float(np.median(predicted(data.chains[name], fit)))
        if sd > half:
            yield (
                f"taxels of {name} are known to {MM * sd:.1f} mm only, half a pitch is "
                f"{MM * half:.1f} mm; the patch {weak_direction(places, covariance)}"
            )
    half = min(pitch_of(data.chains[name].taxels) for name in fit.mounts) / 2
    if fit.split_shift > half:
        yield (
            f"taxels move by {MM * fit.split_shift:.1f} mm between fits to two halves, half "
            f"a pitch is {MM * half:.1f} mm: more touches, in other poses"
        )
    for name in fit.left_alone:
        if name in asked:
            yield f"{name}: all its recordings were left out, its mount is as it came"


def _uncovered(data: SelfTouchData, fit: SelfTouchFit) -> Iterator[str]:
    for name in fit.mounts:
        share = float(touched(data, fit, name).mean())
        if share < COVERAGE:
            yield (
                f"{100 * share:.0f} % of the taxels of {name} were touched, {100 * COVERAGE:.0f} % "
                "are needed: those far from the others are a guess"
            )


def _too_few(fit: SelfTouchFit) -> Iterator[str]:
    if fit.held_out > OVERFIT * fit.rms_after:
        yield (
            f"touches that the fit never saw are missed by {MM * fit.held_out:.1f} mm, those "
            f"it saw by {MM * fit.rms_after:.1f} mm: too few touches"
        )


def notes_of(data: SelfTouchData, fit: SelfTouchFit, asked: Sequence[str]) -> Iterator[str]:
    """What was left out, what the touches cannot tell, and what deserves a second look."""
    told = fit.unobserved
    yield from data.notes
    for name in fit.dropped:
        why = "contradicts the others, which agree without it"
        if name in fit.agreement.senseless:
            why = "its poses and touches do not belong together; the others agree"
        yield f"{name} was left out: median {MM * fit.medians[name]:.1f} mm, {why}"
    for name in fit.left_alone:
        if name not in asked:
            yield f"{name} was not calibrated: all its recordings were left out"
    for joint, name in told.joints.items():
        other = f"equals a move of {name}" if name else "equals moves of several others together"
        yield f"the zero of {joint_name(data, joint)} cannot be determined: it {other}"
    for joint, way in told.still.items():
        yield (
            f"{joint_name(data, joint)} moved by {np.rad2deg(way):.0f} deg only: touch in poses "
            "where it turns further"
        )
    for name, tip in fit.tips.items():
        assumed = data.chains[name].mount[:3, 3]
        way = float(np.linalg.norm(tip - assumed))
        if assumed.any() and way > SLIPPED:
            yield f"the tip of {name} lies {MM * way:.0f} mm from where it was assumed"


def joint_name(data: SelfTouchData, column: int) -> str:
    """Name of a joint where recordings say it."""
    return data.joints[column] if data.joints else f"joint {column}"


def next_taxels(data: SelfTouchData, fit: SelfTouchFit) -> dict[str, list[int]]:
    """Channels of each patch to touch next: the least known of those never touched, far apart."""
    found = {}
    for name in fit.mounts:
        rows, places, _ = placed(data.chains[name], fit)
        gain = predicted(data.chains[name], fit) * np.where(touched(data, fit, name), 0.5, 1.0)
        chosen: list[int] = []
        for _ in range(min(NEXT, len(rows))):
            away = np.ones(len(rows))
            if chosen:
                gaps = np.linalg.norm(places[:, None] - places[chosen], axis=2).min(axis=1)
                away = gaps / max(float(gaps.max()), 1e-12)
            chosen.append(int(np.argmax(gain * away)))
        found[name] = [int(rows[k]) for k in chosen]
    return found


def probe_words(data: SelfTouchData, fit: SelfTouchFit) -> dict[str, Probe]:
    """What is known of each probe, for JSON."""
    found = {}
    for name, tip in fit.tips.items():
        chain = data.chains[name]
        assumed = chain.mount[:3, 3]
        found[name] = Probe(
            on=data.links.get(name, ""),
            tip_mm=(MM * tip).tolist(),
            assumed_tip_mm=(MM * assumed).tolist() if assumed.any() else None,
            radius_mm=MM * chain.radius if chain.radius else None,
        )
    return found
