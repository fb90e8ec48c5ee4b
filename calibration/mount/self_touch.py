"""Self-touch: mounts of skin patches from a robot that touches itself in many poses.

Each event names the taxels that were active on both sides; where they met is not known. The
places that lie closest under the present mounts stand for the contact, mounts are fitted to
them, and pairs are chosen again, as in iterated closest points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.mount.chain_fit import fit_chains, misses, mount_covariances
from calibration.mount.chains import Chain, TouchRecording
from calibration.mount.pairing import Contacts, contacts_of
from calibration.mount.rigid_mount import Loss, point_covariance
from calibration.mount.unknowns import ChainState, Unknowns
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.geometry.rigid import transform_points

FOLDS = 5  # each event is held out once
INCONSISTENT = 2.5  # a recording whose median is so many times that of the others
FEWEST = 12  # events
JOINT_SIGMA = np.deg2rad(2.0)  # what zero positions of joints are off by


@dataclass(frozen=True, eq=False, slots=True)
class SelfTouchFit:
    """Mounts that explain the touches, and how well.

    Attributes
    ----------
    mounts : dict of str to (4, 4) float
        T_link_patch of every chain that was calibrated.
    tips : dict of str to (3,) float
        Tip of each probe in its link [m].
    joint_offsets : dict of int to float
        To be added to each column of the angles [rad]; empty where none were asked for.
    rms_before, rms_after, held_out : float
        Distance of the places that met, root mean square over events [m]: with the mounts
        as they came, after the fit, and of events that a fit to the others never saw.
    split_shift : float
        How far taxels move between fits to two halves of the events, root mean square [m]: what
        the distances alone cannot tell.
    medians : dict of str to float
        Median distance of each recording [m].
    inconsistent, dropped : tuple of str
        Recordings that contradict the others, and those of them that were left out.
    covariances : dict of str to (6, 6) float
        Of each mount, ordered as in `MountFit`; widened to what the two halves show, because the
        errors of a real robot's kinematics are no noise.
    distances_before, distances : (m,) float
        Of every event that was fitted to [m].
    """

    mounts: dict[str, FloatArray]
    tips: dict[str, FloatArray]
    joint_offsets: dict[int, float]
    rms_before: float
    rms_after: float
    held_out: float
    split_shift: float
    medians: dict[str, float]
    inconsistent: tuple[str, ...]
    dropped: tuple[str, ...]
    covariances: dict[str, FloatArray]
    distances_before: FloatArray
    distances: FloatArray


def self_touch(
    recordings: Sequence[TouchRecording],
    chains: Mapping[str, Chain],
    *,
    calibrate: Sequence[str],
    joint_offsets: bool = False,
    joint_sigma: float = JOINT_SIGMA,
    loss: Loss = "cauchy",
    drop_inconsistent: bool = False,
    rng: np.random.Generator,
) -> SelfTouchFit:
    """Fit the mounts of the named chains to recordings of self-touch.

    Parameters
    ----------
    recordings : sequence of TouchRecording
    chains : mapping of str to Chain
    calibrate : sequence of str
        Chains whose mount is unknown; the others hold the world still. Tips of probes are found
        as well.
    joint_offsets : bool
        Whether the zero positions of all joints that take part are unknown too.
    joint_sigma : float
        Prior standard deviation of such an offset [rad].
    loss : {"linear", "cauchy"}
    drop_inconsistent : bool
        Leave out recordings whose median distance is 2.5 times that of the others; of two,
        which one contradicts the other cannot be told, and both stay.
    rng : numpy.random.Generator
        Draws the held-out events and the halves.

    Raises
    ------
    UnknownNameError
        A chain that does not exist.
    InvalidArrayError
        Too few events, a taxel that a chain lacks, angles that a chain needs and a recording
        lacks, recordings whose numbers of angles differ.
    """
    given = [_check(recording, chains) for recording in recordings]
    _check_all(given, chains, calibrate)
    used = [contacts_of(one, *(chains[name] for name in one.chains)) for one in given]
    problem = _Problem(chains, tuple(calibrate), joint_offsets, joint_sigma, loss)
    state = problem.fit(used)
    medians = problem.medians(used, state)
    consistent, inconsistent = problem.consistent(used, medians)
    if drop_inconsistent and inconsistent:
        used = consistent
        state = problem.fit(used)
    halves = [rng.permutation(len(one)) < len(one) / 2 for one in used]
    one, other = (problem.fit(_masked(used, halves, keep=keep)) for keep in (True, False))
    before = _every_distance(used, chains, problem.start(used))
    after = _every_distance(used, chains, state)
    return SelfTouchFit(
        {name: state.mounts[name] for name in calibrate},
        {name: state.mounts[name][:3, 3] for name in problem.unknowns(used).tips},
        {joint: float(state.offsets[joint]) for joint in problem.unknowns(used).joints},
        _root_mean_square(before),
        _root_mean_square(after),
        problem.held_out(used, rng),
        problem.shift(one, other),
        medians | problem.medians(used, state),
        inconsistent,
        inconsistent if drop_inconsistent else (),
        problem.covariances(used, state, problem.shift(one, other)),
        before,
        after,
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Problem:
    """What stays the same from one fit to the next."""

    chains: Mapping[str, Chain]
    calibrate: tuple[str, ...]
    joint_offsets: bool
    joint_sigma: float
    loss: Loss

    def unknowns(self, contacts: Sequence[Contacts], *, mounts: bool = True) -> Unknowns:
        present = dict.fromkeys(name for one in contacts for name in one.recording.chains)
        probes = tuple(name for name in present if self.chains[name].is_probe)
        moving = sorted({int(j) for name in present for j in self.chains[name].joints})
        joints = tuple(moving) if self.joint_offsets and mounts else ()
        apart = {one.recording.name: 0.0 for one in contacts if one.stands_apart and mounts}
        return Unknowns(self.calibrate if mounts else (), probes, joints, self.joint_sigma, apart)

    def start(self, contacts: Sequence[Contacts]) -> ChainState:
        """Mounts as they came, with the tips that fit them best."""
        width = contacts[0].recording.angles.shape[1]
        state = ChainState({name: c.mount for name, c in self.chains.items()}, np.zeros(width))
        unknowns = self.unknowns(contacts, mounts=False)
        return fit_chains(contacts, self.chains, unknowns, state, self.loss)

    def fit(self, contacts: Sequence[Contacts]) -> ChainState:
        start = self.start(contacts)
        return fit_chains(contacts, self.chains, self.unknowns(contacts), start, self.loss)

    def medians(self, contacts: Sequence[Contacts], state: ChainState) -> dict[str, float]:
        return {
            one.recording.name: float(np.median(_distances(one, self.chains, state)))
            for one in contacts
        }

    def consistent(
        self, contacts: Sequence[Contacts], medians: Mapping[str, float]
    ) -> tuple[list[Contacts], tuple[str, ...]]:
        """Recordings that agree, and names of those that contradict them, the worst first.

        After each that is left out the mounts are fitted again: what a bad one had dragged along
        is judged without it.
        """
        kept, found = list(contacts), list[str]()
        while len(kept) > 2:
            worst = max((one.recording.name for one in kept), key=medians.__getitem__)
            rest = [one for one in kept if one.recording.name != worst]
            others = [medians[one.recording.name] for one in rest]
            if medians[worst] <= INCONSISTENT * float(np.median(others)):
                break
            kept, found = rest, [*found, worst]
            medians = self.medians(kept, self.fit(kept))
        return kept, tuple(found)

    def held_out(self, contacts: Sequence[Contacts], rng: np.random.Generator) -> float:
        """Root mean square distance of events under fits that never saw them [m]."""
        folds = [rng.permutation(len(one)) % FOLDS for one in contacts]
        squares, events = 0.0, 0
        for fold in range(FOLDS):
            masks = [own == fold for own in folds]
            state = self.fit(_masked(contacts, masks, keep=False))
            unseen = _masked(contacts, masks, keep=True)
            squares += float(np.sum(_every_distance(unseen, self.chains, state) ** 2))
            events += sum(map(len, unseen))
        return float(np.sqrt(squares / events))

    def covariances(
        self, contacts: Sequence[Contacts], state: ChainState, shift: float
    ) -> dict[str, FloatArray]:
        unknowns = self.unknowns(contacts)
        noise, joints = mount_covariances(contacts, self.chains, unknowns, state, self.loss)
        spread = [
            np.einsum("nii->n", taxel_covariance(self.chains[name], state.mounts[name], own))
            for name, own in noise.items()
        ]
        # Fits to halves differ by twice the error of the fit to all.
        seen = (0.5 * shift) ** 2 / max(float(np.concatenate(spread).mean()), 1e-18)
        return {name: max(1.0, seen) * own + joints[name] for name, own in noise.items()}

    def shift(self, one: ChainState, other: ChainState) -> float:
        """Root mean square move of the calibrated taxels between two states [m]."""
        moved = []
        for name in self.calibrate:
            taxels = self.chains[name].taxels
            known = taxels[np.isfinite(taxels).all(axis=1)]
            places = [transform_points(state.mounts[name], known) for state in (one, other)]
            moved.append(places[0] - places[1])
        return float(np.sqrt(np.mean(np.sum(np.concatenate(moved) ** 2, axis=1))))


def taxel_covariance(chain: Chain, mount: FloatArray, covariance: FloatArray) -> FloatArray:
    """(n, 3, 3) of the taxels of a chain [m2], from that of its mount (6, 6)."""
    taxels = chain.taxels[np.isfinite(chain.taxels).all(axis=1)]
    return point_covariance(mount, taxels, covariance)


def _masked(
    contacts: Sequence[Contacts], masks: Sequence[BoolArray], *, keep: bool
) -> list[Contacts]:
    return [one.subset(mask == keep) for one, mask in zip(contacts, masks, strict=True)]


def _distances(one: Contacts, chains: Mapping[str, Chain], state: ChainState) -> FloatArray:
    return np.asarray(np.linalg.norm(misses(one, chains, state), axis=1))


def _every_distance(
    contacts: Sequence[Contacts], chains: Mapping[str, Chain], state: ChainState
) -> FloatArray:
    return np.concatenate([_distances(one, chains, state) for one in contacts])


def _root_mean_square(distances: FloatArray) -> float:
    return float(np.sqrt(np.mean(distances**2)))


def _check_all(
    recordings: Sequence[TouchRecording], chains: Mapping[str, Chain], calibrate: Sequence[str]
) -> None:
    for name in calibrate:
        if name not in chains:
            raise UnknownNameError("chain", name, chains)
        if chains[name].is_probe:
            raise InvalidArrayError(f"{name!r} is a probe: its tip is always found")
    if not calibrate:
        raise InvalidArrayError("no chain to calibrate")
    events = sum(map(len, recordings))
    if events < FEWEST:
        raise InvalidArrayError(f"{events} touches, at least {FEWEST} are needed")
    widths = {one.name: one.angles.shape[1] for one in recordings}
    if len(set(widths.values())) > 1:
        words = ", ".join(f"{name!r} {width}" for name, width in widths.items())
        raise InvalidArrayError(f"recordings differ in their number of angles: {words}")


def _check(recording: TouchRecording, chains: Mapping[str, Chain]) -> TouchRecording:
    """The recording without events that name no taxel on one of the sides."""
    keep = np.ones(len(recording), np.bool_)
    for name, touched in zip(recording.chains, recording.touched, strict=True):
        if name not in chains:
            raise UnknownNameError(f"chain (recording {recording.name!r})", name, chains)
        joints = chains[name].joints
        if len(joints) and joints.max() >= recording.angles.shape[1]:
            raise InvalidArrayError(
                f"{recording.name!r} has {recording.angles.shape[1]} angles a pose, "
                f"{name!r} needs column {joints.max()}"
            )
        if touched is None and not chains[name].is_probe:
            raise InvalidArrayError(f"{recording.name!r} does not say which taxels of {name!r}")
        if touched is not None and chains[name].is_probe:
            raise InvalidArrayError(f"{recording.name!r} names taxels of {name!r}, which has none")
        if touched is None:
            continue
        known: BoolArray = np.asarray(np.isfinite(chains[name].taxels).all(axis=1))
        for row in range(len(recording)):
            active: IntArray = np.asarray(touched[row], np.int64)
            if len(active) and not 0 <= active.min() <= active.max() < len(known):
                raise InvalidArrayError(
                    f"{recording.name!r}, event {row}: taxel {active.max()} of {name!r}, which "
                    f"has 0..{len(known) - 1}"
                )
            keep[row] &= bool(known[active].any())
    return recording.subset(keep)
