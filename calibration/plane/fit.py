"""Calibration with a table: mounts of patches that were pressed on flat surfaces in many poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calibration.mount.chains import Chain
from calibration.patch.patch_calibration import Status
from calibration.patch.patch_status import weakest_motion
from calibration.plane.model import Patch, Plane, PlaneContacts, PlaneProblem, PlaneState, patch_of
from calibration.plane.poses import Proposal, most_telling, place_slopes
from calibration.plane.solve import (
    Solution,
    assumed,
    contradicting,
    first_states,
    judge,
    refine,
    rivals,
    second_place,
    solve,
)
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError, check_known
from skinmap.geometry.rigid import transform_points
from skinmap.summary import Summary, first_few, listed

FEWEST = 4  # contacts: fewer cannot even show that they are too few
JOINT_SIGMA = np.deg2rad(0.5)  # what zero positions of joints are off by
FAR = 0.3  # the felt taxels of every contact lie further from a given plane: it is another [m]
JOINTS_OFF = 1.5  # of what is assumed, that zeros of joints may be off by
SURELY, NEVER = 0.9, 0.02  # chances of taxels that are called dead, and stuck
MISSED_PRESSES = 3.0  # that a dead taxel should have felt


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class PlaneFit(Summary):
    """Mounts that explain which taxels felt a flat surface in which poses.

    Attributes
    ----------
    mounts : dict of str to (4, 4) float
        T_link_patch.
    covariances : dict of str to (6, 6) float
        Of each mount, ordered as in `MountFit`.
    places : dict of str to (n, 3) float
        Taxels in the frame of their link, each module shifted as the contacts say [m].
    place_covariances : dict of str to (n, 3, 3) float
        [m2], with what modules and zero positions of joints leave unknown.
    planes : tuple of Plane
        Where the skin begins to feel the surfaces, in the frame of the chains' base.
    joint_offsets, joint_sds : dict of int to float
        To be added to each column of the angles, and how well that is known [rad, m].
    depth_spread, shift_spread : float
        Spread of the press depths, and of the modules' shifts along each axis [m].
    inconsistent : tuple of int
        Contacts that contradict the others.
    dead, stuck : dict of str to tuple of int
        Taxels (rows) that were left out: never active where they were pressed, active in the air.
    touched : dict of str to (n,) int
        How often each taxel was active.
    widening : float
        What the covariances were multiplied by, because contacts differ more than their readings
        say.
    status : Status
    reasons : tuple of str
    assumed : tuple of str
        What no contact can tell and a prior had to decide.
    weakest : dict of str to str
        How each patch could still move most easily, in words.
    """

    mounts: dict[str, FloatArray]
    covariances: dict[str, FloatArray]
    places: dict[str, FloatArray]
    place_covariances: dict[str, FloatArray]
    planes: tuple[Plane, ...]
    joint_offsets: dict[int, float]
    joint_sds: dict[int, float]
    depth_spread: float
    shift_spread: float
    inconsistent: tuple[int, ...]
    dead: dict[str, tuple[int, ...]]
    stuck: dict[str, tuple[int, ...]]
    touched: dict[str, IntArray]
    widening: float
    status: Status
    reasons: tuple[str, ...]
    assumed: tuple[str, ...]
    weakest: dict[str, str]
    _problem: PlaneProblem
    _solution: Solution

    def predicted_sd(self, name: str) -> FloatArray:
        """(n,) square root of the trace of each taxel's covariance [m]."""
        return np.sqrt(np.einsum("nii->n", self.place_covariances[name]))

    def next_contacts(self, candidates: PlaneContacts, count: int = 1) -> Proposal:
        """Which of candidate poses to press next; of the candidates' taxels nothing is used."""
        return most_telling(
            self._problem, self._solution, candidates, count=count, widening=self.widening
        )

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "status": self.status.value,
            "mounts": listed(self.mounts),
            "contacts": len(self._problem.contacts),
            "inconsistent": len(self.inconsistent),
            "reasons": listed(self.reasons),
        }


def fit_plane(
    contacts: PlaneContacts,
    patches: Sequence[Chain],
    *,
    modules: Mapping[str, ArrayLike] | None = None,
    planes: Sequence[Plane] | None = None,
    joint_sigma: float = JOINT_SIGMA,
    joint_names: Sequence[str] | None = None,
    previous: PlaneFit | None = None,
) -> PlaneFit:
    """Fit mounts, planes and zero positions of joints to presses on flat surfaces.

    Parameters
    ----------
    contacts : PlaneContacts
        Joint angles (m, joints) [rad, m] and active taxels (m, n) of m presses.
    patches : sequence of Chain
        From one base; their mounts are where the search starts.
    modules : mapping of str to (n,) array-like of int, optional
        Module of each taxel of a patch: modules may stand off by a little. One by default.
    planes : sequence of Plane, optional
        Where the surfaces are, in the frame of the chains' base; unknown by default. Normals may
        point to either side.
    joint_sigma : float
        Standard deviation of a joint's zero position [rad, m].
    joint_names : sequence of str, optional
        Of the columns of the angles, for messages.
    previous : PlaneFit, optional
        Of the first of these contacts: the search starts there and nowhere else, which is quicker.

    Returns
    -------
    PlaneFit
        Mounts (4, 4), places (n, 3) [m] with their covariance, and whether they may be used.

    Raises
    ------
    InvalidArrayError
        Fewer than four contacts, a contact that no taxel felt, taxels or planes that do not
        match, a plane that no contact comes near.
    UnknownNameError
        Contacts of a patch that there is no chain of.

    Examples
    --------
    >>> import numpy as np, skinmap
    >>> from calibration import Plane, PlaneContacts, robot_chain
    >>> from calibration.plane.poses import pressing_poses
    >>> robot, rng = skinmap.load_robot("icub"), np.random.default_rng(0)
    >>> arm = "pitch", "roll", "yaw"
    >>> joints = [f"torso_{j}" for j in arm] + [f"r_shoulder_{j}" for j in arm] + ["r_elbow"]
    >>> skin, table = robot.skin("right_arm"), Plane([-0.2, 0.2, -0.05], [0.0, 0.0, 1.0])
    >>> arm = robot_chain(robot, skin.link, joints, name="right_arm", taxels=skin.positions)
    >>> limits = np.array([robot.body.joints[joint] for joint in joints])
    >>> poses = pressing_poses(arm, skin.normals, table, limits, depth=3e-3, count=200, rng=rng)
    >>> T = arm.frames(poses)
    >>> places = np.einsum("mij,nj->mni", T[:, :3, :3], skin.positions) + T[:, None, :3, 3]
    >>> felt = PlaneContacts(poses[:12], {"right_arm": table.height(places[:12]) < 0})
    >>> found = skinmap.fit_plane(felt, [arm])
    >>> bool(abs(found.places["right_arm"] - skin.positions).max() < 5e-3)
    True
    """
    problem = _checked(contacts, patches, modules, planes, joint_sigma)
    starts = first_states(problem, planes)
    if previous is None:
        found = sorted((solve(problem, one) for one in starts), key=lambda one: one.cost)
    else:
        state = _longer(previous._solution.state, len(contacts))
        found = [refine(problem, state, starts[0], previous._solution.spreads)]
    best, rival = found[0], second_place(problem, found)
    problem, best, dead, stuck = _without_faulty(problem, best, starts[0])
    odd = contradicting(problem, best)
    if rival is None:
        rival = second_place(problem, [best, *rivals(problem, best, starts[0])])
    names = range(contacts.angles.shape[1]) if joint_names is None else joint_names
    return _result(problem, best, odd, (dead, stuck), rival, [str(name) for name in names])


def _checked(
    contacts: PlaneContacts,
    patches: Sequence[Chain],
    modules: Mapping[str, ArrayLike] | None,
    planes: Sequence[Plane] | None,
    joint_sigma: float,
) -> PlaneProblem:
    if not (np.isfinite(joint_sigma) and joint_sigma > 0):
        raise InvalidArrayError(f"joint_sigma must be above 0 rad, got {joint_sigma}")
    chains = {one.name: one for one in patches}
    check_known("patch", contacts.active, chains)
    surfaces = int(contacts.surface.max(initial=0)) + 1
    missing = np.setdiff1d(np.arange(surfaces), contacts.surface)
    if len(contacts) and len(missing):
        raise InvalidArrayError(
            f"no contact on surface {missing[0]}, but on surface {surfaces - 1}: they count from 0"
        )
    if len(contacts) < FEWEST:
        raise InvalidArrayError(f"{len(contacts)} contacts, at least {FEWEST} are needed")
    used = {}
    for name, felt in contacts.active.items():
        chain = chains[name]
        if not np.isfinite(chain.taxels).all():
            raise InvalidArrayError(f"taxels of {name!r} must be finite")
        if felt.shape[1] != len(chain.taxels):
            raise InvalidArrayError(
                f"{felt.shape[1]} taxels in the contacts of {name!r}, which has {len(chain.taxels)}"
            )
        if len(chain.joints) == 0:
            raise InvalidArrayError(
                f"no joint moves {name!r}: presses on a table do not determine its mount"
            )
        if chain.joints.max(initial=-1) >= contacts.angles.shape[1]:
            raise InvalidArrayError(
                f"{contacts.angles.shape[1]} angles a pose, {name!r} needs column "
                f"{chain.joints.max()}"
            )
        used[name] = patch_of(chain, None if modules is None else np.asarray(modules[name]))
    felt_by = np.sum([felt.sum(axis=1) for felt in contacts.active.values()], axis=0)
    if silent := np.flatnonzero(felt_by == 0).tolist():
        raise InvalidArrayError(
            f"no taxel is active in {len(silent)} of {len(contacts)} contacts: "
            f"{first_few(silent, 8)} (counted from 0); leave them out"
        )
    problem = PlaneProblem(contacts, used, joint_sigma, planes is None, surfaces)
    if planes is not None:
        _check_planes(problem, planes)
    return problem


def _check_planes(problem: PlaneProblem, planes: Sequence[Plane]) -> None:
    count = problem.surfaces
    if len(planes) != count:
        raise InvalidArrayError(f"{len(planes)} planes for contacts on {count} surfaces")
    state = first_states(problem, planes)[0]
    nearest = np.full(len(problem.contacts), np.inf)
    for name, felt in problem.contacts.active.items():
        heights = np.abs(problem.signed(name, state))
        nearest = np.minimum(nearest, np.where(felt, heights, np.inf).min(axis=1))
    if nearest.min() > FAR:
        raise InvalidArrayError(
            f"no contact comes near the plane: the nearest active taxel lies {nearest.min():.3g} m "
            "from it; it is in metres, in the frame of the robot's base"
        )


def _longer(state: PlaneState, m: int) -> PlaneState:
    """The state of the first contacts with middling depths for those that came since."""
    return replace(state.copy(), depths=np.concatenate([state.depths, np.zeros(m)])[:m])


Faulty = dict[str, tuple[int, ...]]


def _without_faulty(
    problem: PlaneProblem, best: Solution, start: PlaneState
) -> tuple[PlaneProblem, Solution, Faulty, Faulty]:
    """The solution without taxels that are dead or stuck, and which these are."""
    dead, stuck, patches = Faulty(), Faulty(), dict[str, Patch]()
    for name, one in problem.patches.items():
        chance, felt = problem.chances(name, best.state), problem.contacts.active[name]
        expected = np.where(chance > SURELY, chance, 0.0).sum(axis=0)
        is_dead = ~felt.any(axis=0) & (expected >= MISSED_PRESSES)
        air = chance < NEVER
        is_stuck = (felt & air).sum(axis=0) > np.maximum(0.5 * air.sum(axis=0), MISSED_PRESSES)
        dead[name] = tuple(np.flatnonzero(is_dead).tolist())
        stuck[name] = tuple(np.flatnonzero(is_stuck).tolist())
        patches[name] = replace(one, usable=one.usable & ~is_dead & ~is_stuck)
    if any(dead.values()) or any(stuck.values()):
        problem = replace(problem, patches=patches)
        best = refine(problem, best.state, start, best.spreads)
    return problem, best, dead, stuck


def _widening(problem: PlaneProblem, best: Solution, slopes: FloatArray) -> float:
    """How much more contacts differ than their readings say, in variance; at least 1.

    The covariance holds where readings of a contact err independently but for its depth. From the
    contacts' own scores it comes out larger where something that they share is not as assumed
    (White, Econometrica 48, 1980); both are compared on the taxels' places.
    """
    layout, m = best.layout, len(problem.contacts)
    scores = problem.contact_scores(best.state, layout)
    prior = best.prior.copy()
    depths = layout.depth
    scores[np.arange(m), depths] -= prior[depths] * best.state.depths
    prior[depths] = 0.0
    C = best.covariance()
    fitted = float(np.sum(1.0 - best.prior[: layout.tau] * np.diag(C)[: layout.tau]))
    felt = slopes.reshape(-1, layout.count) @ C
    shown = np.sum((felt @ scores.T) ** 2) * m / max(1.0, m - fitted) + np.sum(prior * felt**2)
    stated = np.sum(felt * slopes.reshape(-1, layout.count))
    return max(1.0, float(shown / stated))


def _result(
    problem: PlaneProblem,
    best: Solution,
    odd: tuple[int, ...],
    faulty: tuple[Faulty, Faulty],
    rival: float | None,
    joint_names: Sequence[str],
) -> PlaneFit:
    state, layout = best.state, best.layout
    slopes = place_slopes(problem, state, layout)
    widening = _widening(problem, best, slopes)
    C = widening * best.covariance()
    every = np.einsum("nki,ij,nlj->nkl", slopes, C, slopes, optimize=True)
    places, own, covariances, weakest, first = {}, {}, {}, {}, 0
    for name, one in problem.patches.items():
        local = one.chain.taxels + state.shifts[name][one.module]
        places[name] = transform_points(state.mounts[name], local)
        own[name] = every[first : first + len(local)]
        first += len(local)
        column = layout.mount[name]
        covariances[name] = C[column : column + 6, column : column + 6]
        weakest[name] = weakest_motion(places[name], own[name])
    judged = judge(own, widening, best, odd, rival, len(problem.contacts), weakest)
    zeros = np.array([state.offsets[k] for k in layout.joint]) / problem.joint_sigma
    if (off := float(np.sqrt(zeros @ zeros / max(len(zeros), 1)))) > JOINTS_OFF:
        words = f"zeros of joints are off by {off:.1f} times as much as is assumed"
        judged.append((Status.AMBIGUOUS, f"{words}: calibrate the joints first"))
    return PlaneFit(
        mounts={name: state.mounts[name] for name in problem.patches},
        covariances=covariances,
        places=places,
        place_covariances=own,
        planes=tuple(state.plane(k) for k in range(len(state.normals))),
        joint_offsets={k: float(state.offsets[k]) for k in layout.joint},
        joint_sds={k: float(np.sqrt(C[at, at])) for k, at in layout.joint.items()},
        depth_spread=best.spreads.depth,
        shift_spread=best.spreads.shift,
        inconsistent=odd,
        dead=faulty[0],
        stuck=faulty[1],
        touched={name: felt.sum(axis=0) for name, felt in problem.contacts.active.items()},
        widening=widening,
        status=judged[0][0] if judged else Status.OK,
        reasons=tuple(reason for _, reason in judged),
        assumed=assumed(problem, joint_names),
        weakest=weakest,
        _problem=problem,
        _solution=best,
    )
