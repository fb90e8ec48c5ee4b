"""Self-touch: mounts of skin patches from a robot that touches itself in many poses.

Each event names the taxels that were active on both sides; where they met is not known. The
places that lie closest under the present mounts stand for the contact, mounts are fitted to
them, and pairs are chosen again, as in iterated closest points.

Whether recordings of self-touch agree, which of them contradicts the others, what none can tell.

Each recording is fitted alone first: what it misses by there is all that a fit to several may ask
of it. A fit to all with zeros of joints free must then miss each recording by little more. Where
it does not, recordings are left out in turn; the one without which the rest agree is the one that
contradicts them. A recording that cannot even explain itself needs no others to be told.

What self-touch cannot tell are zeros of joints that equal turns of mounts, and joint moves of
patches. The inverse covariance by the touches alone, without priors, says how well each unknown
would be known if nothing else were. A joint whose zero is lost there is compared with each mount
alone: the share of its effect on the touches that the mount can have just as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb

import numpy as np

from calibration.mount.chain_fit import (
    JOINT_SIGMA,
    ChainFit,
    ChainState,
    Contacts,
    Information,
    Unknowns,
    contacts_of,
    misses,
)
from calibration.mount.chains import Chain, TouchRecording
from calibration.mount.rigid_mount import point_covariance
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidArrayError, check_known
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.rigid import transform_points
from skinmap.summary import Summary, listed, millimetres

FOLDS = 5  # each event is held out once
FEWEST = 12  # events
MAX_OFF = 4.0 * JOINT_SIGMA  # of any: recordings that ask for more contradict the robot
BLAMED = 0.5  # pitches that a recording must be missed by at least to be blamed
ENOUGH = 150  # touches that tell poses in their order from others
ORDERS = 12  # seed of the poses' other orders, apart from the user's: they judge, no more


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class SelfTouchFit(Summary):
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
    agreement : Agreement
        Which recordings contradict the others.
    dropped : tuple of str
        Those of them that were left out.
    left_alone : tuple of str
        Chains that were to be calibrated, and whose recordings were all left out.
    covariances : dict of str to (6, 6) float
        Of each mount, ordered as in `MountFit`; widened to what the two halves show, because the
        errors of a real robot's kinematics are no noise, and by what zeros of joints that were
        not solved for are off by.
    unobserved : Unobserved
        What these touches cannot tell.
    """

    mounts: dict[str, FloatArray]
    tips: dict[str, FloatArray]
    joint_offsets: dict[int, float]
    rms_before: float
    rms_after: float
    held_out: float
    split_shift: float
    medians: dict[str, float]
    agreement: Agreement
    dropped: tuple[str, ...]
    left_alone: tuple[str, ...]
    covariances: dict[str, FloatArray]
    unobserved: Unobserved

    @property
    def inconsistent(self) -> tuple[str, ...]:
        """Recordings that contradict the others."""
        return self.agreement.inconsistent

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "mounts": listed(self.mounts),
            "rms_before": millimetres(self.rms_before),
            "rms_after": millimetres(self.rms_after),
            "held_out": millimetres(self.held_out),
            "dropped": listed(self.dropped),
        }


def self_touch(
    recordings: Sequence[TouchRecording],
    chains: Mapping[str, Chain],
    *,
    calibrate: Sequence[str],
    joint_offsets: bool = False,
    rng: np.random.Generator | int,
) -> SelfTouchFit:
    """Fit the mounts of the named chains to recordings of self-touch.

    Parameters
    ----------
    recordings : sequence of TouchRecording
        Joint angles (m, joints) [rad] of each event and the taxels that felt it.
    chains : mapping of str to Chain
        What touches what, by name: kinematics, and taxels (n, 3) [m] or a probe.
    calibrate : sequence of str
        Chains whose mount is unknown; the others hold the world still. Tips of probes are found
        as well.
    joint_offsets : bool
        Whether the zero positions of all joints that take part are unknown too.
    rng : numpy.random.Generator or int
        Draws the held-out events and the halves; a number is its seed.

    Returns
    -------
    SelfTouchFit
        Mounts (4, 4), what the touches cannot tell, and recordings that contradict the others.

    Raises
    ------
    UnknownNameError
        A chain that does not exist.
    InvalidArrayError
        Too few events, a taxel that a chain lacks, angles that a chain needs and a recording
        lacks, recordings whose numbers of angles differ or whose names do not.

    Examples
    --------
    A finger on three slides pokes a belly that is known and a chest 10 mm from where it should be.

    >>> import numpy as np, skinmap
    >>> from calibration import Chain, TouchRecording
    >>> board = 0.01 * np.stack(np.meshgrid(range(5), range(4), [0]), -1).reshape(-1, 3)
    >>> slides = np.tile(np.eye(4), (3, 1, 1)), np.eye(3), [True] * 3, range(3), np.ones(3)
    >>> chains = {
    ...     "finger": Chain("finger", *slides, np.zeros(3)),
    ...     "belly": Chain("belly", taxels=board),
    ...     "chest": Chain("chest", taxels=board + [0, 0.19, 0.05]),
    ... }
    >>> felt = None, [[row] for row in range(20)]
    >>> pokes = [
    ...     TouchRecording("belly", ("finger", "belly"), board, felt),
    ...     TouchRecording("chest", ("finger", "chest"), board + [0, 0.2, 0.05], felt),
    ... ]
    >>> found = skinmap.self_touch(pokes, chains, calibrate=["chest"], rng=0)
    >>> [round(1e3 * float(x)) for x in found.mounts["chest"][:3, 3]]
    [0, 10, 0]
    """
    rng = np.random.default_rng(rng)
    given = [_check(recording, chains) for recording in recordings]
    _check_all(given, chains, calibrate)
    every = [contacts_of(one, *(chains[name] for name in one.chains)) for one in given]
    problem = _Problem(chains, tuple(calibrate), joint_offsets)
    agreement = problem.jury(every).agreement(every)
    dropped = agreement.inconsistent if agreement.told else ()
    used = [one for one in every if one.recording.name not in dropped]
    state = problem.fit(used)
    told = problem.unknowns(used)
    halves = [rng.permutation(len(one)) < len(one) / 2 for one in used]
    one, other = (problem.fit(_masked(used, halves, keep=keep)) for keep in (True, False))
    known = ChainFit(used, chains, told).information(state)
    shift = problem.shift(told.mounts, one, other)
    distances = {each.recording.name: _distances(each, chains, state) for each in used}
    before = _every_distance(used, chains, problem.start(used))
    after = np.concatenate(list(distances.values()))
    covariances = _covariances(chains, known, told.mounts, state, shift)
    return SelfTouchFit(
        {name: state.mounts[name] for name in told.mounts},
        {name: state.mounts[name][:3, 3] for name in told.tips},
        {joint: float(state.offsets[joint]) for joint in told.joints},
        _root_mean_square(before),
        _root_mean_square(after),
        problem.held_out(used, rng),
        shift,
        problem.medians(every, problem.fit(every))
        | {name: float(np.median(own)) for name, own in distances.items()},
        agreement,
        dropped,
        tuple(name for name in calibrate if name not in told.mounts),
        covariances,
        unobserved(used, known, told),
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Problem:
    """What stays the same from one fit to the next."""

    chains: Mapping[str, Chain]
    calibrate: tuple[str, ...]
    joint_offsets: bool

    def unknowns(self, contacts: Sequence[Contacts], *, mounts: bool = True) -> Unknowns:
        """What may move: chains that no recording touches may not."""
        present = dict.fromkeys(name for one in contacts for name in one.recording.chains)
        probes = tuple(name for name in present if self.chains[name].is_probe)
        moving = sorted({int(j) for name in present for j in self.chains[name].joints})
        if not mounts:
            unknown = tuple(name for name in probes if not self.chains[name].mount[:3, 3].any())
            return Unknowns((), unknown, ())
        return Unknowns(
            tuple(name for name in self.calibrate if name in present),
            probes,
            tuple(moving) if self.joint_offsets else (),
            {
                one.recording.name: sum(self.chains[name].radius for name in one.recording.chains)
                for one in contacts
                if one.stands_apart
            },
        )

    def start(self, contacts: Sequence[Contacts]) -> ChainState:
        """Mounts as they came, with the tips that fit them best where none was assumed."""
        width = contacts[0].recording.angles.shape[1]
        state = ChainState({name: c.mount for name, c in self.chains.items()}, np.zeros(width))
        unknowns = self.unknowns(contacts, mounts=False)
        return ChainFit(contacts, self.chains, unknowns).from_start(state)

    def fit(self, contacts: Sequence[Contacts]) -> ChainState:
        unknowns, start = self.unknowns(contacts), self.start(contacts)
        start.standoffs = dict(unknowns.standoffs)
        return ChainFit(contacts, self.chains, unknowns).from_start(start)

    def medians(self, contacts: Sequence[Contacts], state: ChainState) -> dict[str, float]:
        return {
            one.recording.name: float(np.median(_distances(one, self.chains, state)))
            for one in contacts
        }

    def jury(self, contacts: Sequence[Contacts]) -> Jury:
        """Who judges whether recordings agree: zeros of joints are no contradiction."""
        freely = replace(self, joint_offsets=True)
        rng = np.random.default_rng(ORDERS)

        def shuffled(one: Contacts) -> float:
            some = one.subset(rng.permutation(len(one)) < ENOUGH)
            other = some.reordered(rng.permutation(len(some)))
            return freely.medians([other], freely.fit([other]))[one.recording.name]

        def missed(some: Sequence[Contacts]) -> tuple[dict[str, float], float]:
            state = freely.fit(some)
            return freely.medians(some, state), float(np.abs(state.offsets).max() / MAX_OFF)

        def shared(one: Contacts, other: Contacts) -> int:
            probes = {name for name, chain in self.chains.items() if chain.is_probe}
            both = {*one.recording.chains} & {*other.recording.chains}
            return len(both & {*self.calibrate, *probes})

        floors = {one.recording.name: BLAMED * self._pitch(one.recording) for one in contacts}
        return Jury(missed, shuffled, shared, floors)

    def _pitch(self, recording: TouchRecording) -> float:
        """The coarser pitch of the two sides [m]."""
        skins = [self.chains[name].taxels for name in recording.chains]
        return max(pitch_of(taxels) for taxels in skins if len(taxels))

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

    def shift(self, calibrated: Sequence[str], one: ChainState, other: ChainState) -> float:
        """Root mean square move of the calibrated taxels between two states [m]."""
        moved = []
        for name in calibrated:
            known = known_taxels(self.chains[name])
            places = [transform_points(state.mounts[name], known) for state in (one, other)]
            moved.append(places[0] - places[1])
        return float(np.sqrt(np.mean(np.sum(np.concatenate(moved) ** 2, axis=1))))


def _covariances(
    chains: Mapping[str, Chain],
    known: Information,
    calibrated: Sequence[str],
    state: ChainState,
    shift: float,
) -> dict[str, FloatArray]:
    """(6, 6) of each mount: noise, widened to what two halves show, and zeros of joints."""
    parts = {name: known.mount(name) for name in calibrated}
    spread = [
        np.einsum("nii->n", taxel_covariance(chains[name], state.mounts[name], noise))
        for name, (noise, _) in parts.items()
    ]
    # Fits to halves differ by twice the error of the fit to all.
    seen = (0.5 * shift) ** 2 / max(float(np.concatenate(spread).mean()), 1e-18)
    return {name: max(1.0, seen) * noise + joints for name, (noise, joints) in parts.items()}


def known_taxels(chain: Chain) -> FloatArray:
    """Positions (n, 3) of the taxels that there are [m]."""
    return chain.taxels[np.isfinite(chain.taxels).all(axis=1)]


def pitch_of(taxels: FloatArray) -> float:
    """Median spacing of the taxels that there are [m]."""
    return median_spacing(taxels[np.isfinite(taxels).all(axis=1)])


def taxel_covariance(chain: Chain, mount: FloatArray, covariance: FloatArray) -> FloatArray:
    """(n, 3, 3) of the taxels of a chain [m2], from that of its mount (6, 6)."""
    return point_covariance(mount, known_taxels(chain), covariance)


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
    if not calibrate:
        raise InvalidArrayError("no chain to calibrate")
    touched = {name for one in recordings for name in one.chains}
    check_known("chain", calibrate, chains)
    for name in calibrate:
        if chains[name].is_probe:
            raise InvalidArrayError(f"{name!r} is a probe: its tip is always found")
        if name not in touched:
            raise InvalidArrayError(f"no recording touches {name!r}")
    names = [one.name for one in recordings]
    for name in names:
        if names.count(name) > 1:
            raise InvalidArrayError(f"two recordings are called {name!r}")
    events = sum(map(len, recordings))
    if events < FEWEST:
        raise InvalidArrayError(f"{events} touches, at least {FEWEST} are needed")
    for one in recordings:
        if len(one) < 2:
            raise InvalidArrayError(f"{one.name!r} has {len(one)} touches that both sides felt")
    widths = {one.name: one.angles.shape[1] for one in recordings}
    if len(set(widths.values())) > 1:
        words = ", ".join(f"{name!r} {width}" for name, width in widths.items())
        raise InvalidArrayError(f"recordings differ in their number of angles: {words}")


def _check(recording: TouchRecording, chains: Mapping[str, Chain]) -> TouchRecording:
    """The recording without events that name no taxel on one of the sides."""
    keep = np.ones(len(recording), np.bool_)
    for name, touched in zip(recording.chains, recording.touched, strict=True):
        check_known(f"chain (recording {recording.name!r})", [name], chains)
        joints = chains[name].joints
        if len(joints) and joints.max() >= recording.angles.shape[1]:
            raise InvalidArrayError(
                f"{recording.name!r} has {recording.angles.shape[1]} angles a pose, "
                f"{name!r} needs column {joints.max()}"
            )
        if touched is None and not chains[name].is_probe:
            raise InvalidArrayError(f"{recording.name!r} does not name the taxels of {name!r}")
        if touched is not None and chains[name].is_probe:
            raise InvalidArrayError(f"{recording.name!r} names taxels of {name!r}, which has none")
        if touched is None:
            continue
        known: BoolArray = np.asarray(np.isfinite(chains[name].taxels).all(axis=1))
        for row in range(len(recording)):
            active: IntArray = np.asarray(touched[row], np.int64)
            if len(active) and not 0 <= active.min() <= active.max() < len(known):
                wrong = active.min() if active.min() < 0 else active.max()
                raise InvalidArrayError(
                    f"{recording.name!r}, event {row}: taxel {wrong} of {name!r}, which "
                    f"has 0..{len(known) - 1}"
                )
            keep[row] &= bool(known[active].any())
    if all(touched is None for touched in recording.touched):
        raise InvalidArrayError(f"{recording.name!r}: neither side has taxels")
    return recording.subset(keep)


# Recordings that agree are missed together by 0.93 to 1.1 times what they are missed by alone (a
# simulated iCub, 3 to 6 recordings of 40 to 150 touches; 1.0 on a real robot), wrong
# ones by 3 to 30 times.
RATIO = 2.0
OTHERS = 2.0  # times what others are missed by alone: more, and the recording contradicts itself
MAX_TRIES = 60  # sets of recordings that are left out in turn, each a fit
SHUFFLED = 0.6  # of what it is missed by with poses in another order: more, and they say nothing
UNTOLD = np.deg2rad(1.0)  # half the prior: a zero known no better comes from the prior
SAME = 0.9  # share of a joint's effect that another unknown has too
BARELY = 1e-9  # of the diagonal: keeps what no touch tells finite, and large
MOVED = np.deg2rad(10.0)  # range of a joint (5 to 95 %) below which more is asked of it


@dataclass(frozen=True, slots=True)
class Agreement:
    """What was found.

    Attributes
    ----------
    inconsistent : tuple of str
        Recordings that contradict the others, the worst first; all that may be the wrong one
        where that cannot be told; empty where all agree.
    told : bool
        Whether leaving these out makes the rest agree, and nothing else does as well.
    senseless : tuple of str
        Those that contradict themselves: their poses and touches do not belong together.
    strained : tuple of str
        Those that agree with the links and with mounts that were not to be calibrated only if
        zeros of joints were off by more than joints are.
    alone : dict of str to float
        Median distance of each recording under a fit to itself [m].
    """

    inconsistent: tuple[str, ...]
    told: bool
    senseless: tuple[str, ...]
    strained: tuple[str, ...]
    alone: dict[str, float]


@dataclass(frozen=True, eq=False, slots=True)
class Jury:
    """Fits and recordings that are asked.

    Attributes
    ----------
    missed : callable
        Median distance [m] of each of some recordings under one fit to them, and how far the zero
        of any joint is off there, over what it may be.
    shuffled : callable
        Median distance [m] of one recording under a fit to it with its poses in another order.
    shared : callable
        How many unknown mounts and tips two recordings share.
    floor : mapping of str to float
        Misses below which no recording is blamed [m].
    """

    missed: Callable[[Sequence[Contacts]], tuple[dict[str, float], float]]
    shuffled: Callable[[Contacts], float]
    shared: Callable[[Contacts, Contacts], int]
    floor: Mapping[str, float]

    def agreement(self, contacts: Sequence[Contacts]) -> Agreement:
        """Judge some recordings."""
        fits = {_name(one): self.missed([one]) for one in contacts}
        alone = {name: medians[name] for name, (medians, _) in fits.items()}
        strained = tuple(name for name, (_, off) in fits.items() if off > 1.0)
        senseless = tuple(
            _name(one) for one in contacts if alone[_name(one)] > SHUFFLED * self.shuffled(one)
        )
        bounds = {name: self._bound(name, alone) for name in alone}
        wrong = {*senseless, *strained, *(name for name in alone if alone[name] > bounds[name])}
        first = sorted(wrong, key=lambda name: alone[name], reverse=True)
        if len(contacts) > 2:
            named, told = self._blamed(contacts, bounds, first)
        elif first or self._excess(contacts, bounds) > 0.0:
            named, told = tuple(alone), False  # of two, which one is wrong cannot be told
        else:
            named, told = (), True
        return Agreement(named, told, senseless, strained, alone)

    def _blamed(
        self, contacts: Sequence[Contacts], bounds: Mapping[str, float], wrong: list[str]
    ) -> tuple[tuple[str, ...], bool]:
        """Who must go until the rest agree, `wrong` first of all, and whether that is certain.

        The fewest that heal all are taken, and never half of those that are left.
        """
        kept = [one for one in contacts if _name(one) not in wrong]
        if len(kept) < 2:
            return tuple(wrong), False
        if self._excess(kept, bounds) == 0.0:
            return tuple(wrong), True
        for count in range(1, (len(kept) + 1) // 2):
            if comb(len(kept), count) > MAX_TRIES:
                break
            healed = [
                some
                for some in combinations(kept, count)
                if self._excess([one for one in kept if one not in some], bounds) == 0.0
            ]
            if healed:
                likely = self._uncorroborated(kept, healed)
                named = dict.fromkeys(_name(one) for some in likely for one in some)
                return (*wrong, *named), len(likely) == 1
        return (*wrong, *map(_name, kept)), False

    def _uncorroborated(
        self, contacts: Sequence[Contacts], healed: Sequence[Sequence[Contacts]]
    ) -> list[Sequence[Contacts]]:
        """Of several without each of which the rest agree, those that leave most agreement.

        Recordings agree about the unknowns that they share; where they share none, that they do
        not contradict each other says nothing.
        """
        left = []
        for some in healed:
            rest = [one for one in contacts if one not in some]
            left.append(sum(self.shared(one, other) for one, other in combinations(rest, 2)))
        return [some for some, count in zip(healed, left, strict=True) if count == max(left)]

    def _bound(self, name: str, alone: Mapping[str, float]) -> float:
        """What a recording may be missed by [m]."""
        others = [missed for other, missed in alone.items() if other != name]
        own = alone[name]
        if others:
            own = min(own, OTHERS * float(np.median(others)))
        return max(RATIO * own, self.floor[name])

    def _excess(self, contacts: Sequence[Contacts], bounds: Mapping[str, float]) -> float:
        """By how much a fit to some recordings misses more than it may, summed in bounds."""
        missed, off = self.missed(contacts)
        over = [own / bounds[name] - 1.0 for name, own in missed.items()]
        return sum(max(0.0, one) for one in (*over, off - 1.0))


def _name(one: Contacts) -> str:
    return one.recording.name


@dataclass(frozen=True, eq=False, slots=True)
class Unobserved:
    """What the touches do not tell.

    Attributes
    ----------
    joints : dict of int to str
        Columns of joints whose zero is not told, and the chain whose mount (or tip) can have the
        same effect; "" where several together do.
    still : dict of int to float
        Columns of joints that hardly moved, and their range [rad].
    """

    joints: dict[int, str]
    still: dict[int, float]


def unobserved(
    contacts: Sequence[Contacts],
    known: Information,
    unknowns: Unknowns,
) -> Unobserved:
    """What the touches of a fit do not tell."""
    columns, evidence = known.columns, known.evidence
    diagonal = np.diag(evidence)
    scale = np.sqrt(np.maximum(diagonal, 1e-12))
    scaled = evidence / np.outer(scale, scale) + BARELY * np.eye(len(scale))
    sd = np.sqrt(np.abs(np.diag(np.linalg.inv(scaled)))) / scale
    joints = {
        joint: _same_effect(evidence, known, unknowns, column)
        for joint, column in columns.joints.items()
        if sd[column] > UNTOLD
    }
    return Unobserved(joints, _still(contacts, columns.joints))


def _same_effect(evidence: FloatArray, known: Information, unknowns: Unknowns, column: int) -> str:
    """The chain whose mount or tip alone can do nearly all that one unknown does."""
    best, share = "", SAME
    for name, first in known.columns.chains.items():
        own = np.arange(first, first + (6 if name in unknowns.mounts else 3))
        cross = evidence[own, column]
        if not evidence[column, column] > 0.0:
            continue
        has = cross @ np.linalg.pinv(evidence[np.ix_(own, own)]) @ cross / evidence[column, column]
        if has > share:
            best, share = name, float(has)
    return best


def _still(contacts: Sequence[Contacts], joints: Mapping[int, int]) -> dict[int, float]:
    """Joints that hardly moved over all recordings."""
    angles = np.concatenate([one.recording.angles for one in contacts])
    low, high = np.percentile(angles, [5, 95], axis=0)
    return {k: float(high[k] - low[k]) for k in joints if high[k] - low[k] < MOVED}
