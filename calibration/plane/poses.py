"""Poses that press a patch on a surface, and which of them would tell most.

A robot before a table: chains of its patches, what must stay off the table, where to press.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from calibration.mount.chains import Chain, robot_chain
from calibration.plane.model import Layout, Plane, PlaneContacts, PlaneProblem, PlaneState, weigh
from calibration.plane.solve import Solution
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import SkinError
from skinmap.geometry.rigid import motion_slopes, tangent_frames, transform_points
from skinmap.skin.robot import Robot, ancestors

TILT = np.deg2rad(25.0)  # at most between the pressed taxel's normal and the surface's
LEVER = 0.05  # a turn of a radian counts like so many metres when a pose is sought
ROUNDS, LAST_ROUNDS = 12, 6
CLOSE = 0.2e-3  # to the wanted depth [m]
INSIDE = np.deg2rad(1.0)  # kept from the joints' limits
CLEARANCE = 2e-3  # of everything but the skin above the surface [m]
TOLD = 1e-3  # readings of less information than this are left out


@dataclass(frozen=True, eq=False, slots=True)
class Obstacle:
    """A link that must stay above the surface: its chain, and corners (k, 3) of its hull."""

    chain: Chain
    corners: FloatArray

    def height(self, angles: FloatArray, plane: Plane) -> FloatArray:
        """(m,) of its lowest corner above the surface [m]."""
        T = self.chain.frames(angles)
        normal = T[:, :3, :3].transpose(0, 2, 1) @ plane.normal
        return np.asarray((normal @ self.corners.T).min(axis=1) + plane.height(T[:, :3, 3]))


def pressing_poses(
    chain: Chain,
    normals: FloatArray,
    plane: Plane,
    limits: FloatArray,
    *,
    depth: float,
    count: int,
    obstacles: Sequence[Obstacle] = (),
    rng: np.random.Generator,
) -> FloatArray:
    """Joint angles (k, joints) that press the patch on the plane, k <= count.

    A taxel is drawn; from random angles within the limits it is brought on the surface, facing it
    to 25 degrees; what leaves the limits or brings an obstacle near is left out.

    Parameters
    ----------
    chain : Chain
        With its mount as believed.
    normals : (n, 3) array of float
        Outward normals of its taxels, in the patch.
    plane : Plane
    limits : (joints, 2) array of float
        Of every column of the angles [rad, m]; columns that the chain does not use stay between.
    depth : float
        Of the lowest taxel below the surface [m].
    count : int
    obstacles : sequence of Obstacle
    rng : numpy.random.Generator
    """
    low, high = _within(limits)
    angles = rng.uniform(low, high, (count, len(low)))
    usable = np.flatnonzero(np.isfinite(chain.taxels).all(axis=1))
    taxel = usable[rng.integers(len(usable), size=count)]
    facing = normals[taxel] @ chain.mount[:3, :3].T
    wobble = rng.normal(0.0, TILT / 2.5, (count, 3))
    facing = facing + np.cross(wobble, facing)
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    own = transform_points(chain.mount, chain.taxels)
    for _ in range(ROUNDS):
        angles = _brought(chain, own[taxel], facing, plane, -depth, angles)
        angles = np.clip(angles, low, high)
    for _ in range(LAST_ROUNDS):
        s, T = _heights(chain, own, plane, angles)
        taxel = s.argmin(axis=1)
        angles = _brought(chain, own[taxel], None, plane, -depth, angles)
        angles = np.clip(angles, low, high)
    s, T = _heights(chain, own, plane, angles)
    lowest = s.argmin(axis=1)
    seen = np.einsum("mij,mj->mi", T[:, :3, :3], normals[lowest] @ chain.mount[:3, :3].T)
    good = (np.abs(s.min(axis=1) + depth) < CLOSE) & (seen @ plane.normal < -np.cos(TILT))
    for obstacle in obstacles:
        rows = np.flatnonzero(good)
        good[rows] &= obstacle.height(angles[rows], plane) > CLEARANCE
    return angles[good]


def _within(limits: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Limits with a margin; a turn that knows none goes half round either way."""
    bounded = np.where(np.isfinite(limits), limits, [[-np.pi, np.pi]])
    margin = np.minimum(INSIDE, 0.25 * np.ptp(bounded, axis=1))
    return bounded[:, 0] + margin, bounded[:, 1] - margin


def _heights(
    chain: Chain, own: FloatArray, plane: Plane, angles: FloatArray
) -> tuple[FloatArray, FloatArray]:
    T = chain.frames(angles)
    normal = T[:, :3, :3].transpose(0, 2, 1) @ plane.normal
    return normal @ own.T + plane.height(T[:, :3, 3])[:, None], T


def _brought(
    chain: Chain,
    points: FloatArray,
    facing: FloatArray | None,
    plane: Plane,
    height: float,
    angles: FloatArray,
) -> FloatArray:
    """Angles after a damped step that brings points to a height, facing the surface."""
    T, axes, origins = chain.motion(angles)
    x = np.einsum("mij,mj->mi", T[:, :3, :3], points) + T[:, :3, 3]
    slopes = chain.slopes(axes, origins, x) @ plane.normal  # (j, m)
    missed, rows = [height - plane.height(x)], [slopes.T]
    if facing is not None:
        seen = np.einsum("mij,mj->mi", T[:, :3, :3], facing)
        turns = np.where(chain.sliding[:, None, None], 0.0, np.cross(axes, seen))
        away = seen @ plane.normal > 0  # behind: any way round will do
        for tangent in tangent_frames(plane.normal):
            off = seen @ tangent
            missed.append(-LEVER * np.where(away, np.sign(off), off))
            rows.append(LEVER * (turns @ tangent).T)
    J, r = np.stack(rows, axis=1), np.stack(missed, axis=1)
    square = J @ J.transpose(0, 2, 1) + 1e-6 * np.eye(J.shape[1])
    step = (J.transpose(0, 2, 1) @ np.linalg.solve(square, r[..., None]))[..., 0]
    new = angles.copy()
    for k, column in enumerate(chain.joints.tolist()):
        new[:, column] += np.clip(step[:, k], -0.3, 0.3)
    return new


@dataclass(frozen=True, eq=False, slots=True)
class Proposal:
    """The next presses, best first.

    Attributes
    ----------
    rows : (k,) int
        Of the candidates.
    sd : (k,) float
        Root mean square predicted error of the taxels after each, and all before it [m].
    """

    rows: IntArray
    sd: FloatArray


def most_telling(
    problem: PlaneProblem,
    solution: Solution,
    candidates: PlaneContacts,
    *,
    count: int = 1,
    widening: float = 1.0,
) -> Proposal:
    """Which of candidate presses lower the trace of the taxels' covariance most.

    Greedy: after each choice the covariance is what it would then be. Of the candidates only the
    angles and the surface count; `widening` is what the covariance is multiplied by.
    """
    layout, state = solution.layout, solution.state
    kept = _persistent(layout)
    covariance = solution.covariance()
    C = covariance[np.ix_(kept, kept)]
    heights = {name: np.diag(covariance)[own] for name, own in layout.height.items()}
    told = [
        _information(problem, state, layout, row, surface, solution.spreads.depth, heights)
        for row, surface in zip(candidates.angles, candidates.surface.tolist(), strict=True)
    ]
    places = place_slopes(problem, state, layout)[:, :, kept]
    n = len(places)
    G = np.einsum("nki,nkj->ij", places, places)
    chosen, expected = list[int](), list[float]()
    # What a press would still tell falls with each one chosen: only the best need be asked again.
    bound = dict.fromkeys(range(len(told)), np.inf)
    for _ in range(min(count, len(told))):
        lowered = C @ G @ C
        fresh = set[int]()
        while True:
            best = max(bound, key=lambda one: bound[one])
            if best in fresh:
                break
            bound[best] = _gain(told[best], C, lowered)
            fresh.add(best)
        del bound[best]
        A, R = told[best]
        known = C @ A.T
        C = C - known @ np.linalg.solve(R + A @ known, known.T)
        chosen.append(best)
        expected.append(float(np.sqrt(widening * np.trace(G @ C) / n)))
    return Proposal(np.array(chosen, np.int64), np.array(expected))


def _gain(told: tuple[FloatArray, FloatArray], C: FloatArray, lowered: FloatArray) -> float:
    A, R = told
    return float(np.trace(np.linalg.solve(R + A @ C @ A.T, A @ lowered @ A.T)))


def _persistent(layout: Layout) -> IntArray:
    """Columns that a further contact tells of: the main ones and the modules' shifts."""
    shifts = (own.ravel() for own in layout.shift.values())
    return np.concatenate([np.arange(layout.main), *shifts])


def _information(
    problem: PlaneProblem,
    state: PlaneState,
    layout: Layout,
    angles: FloatArray,
    surface: int,
    spread: float,
    heights: dict[str, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Whitened slopes (r, kept) of one pose's readings, and their covariance (r, r)."""
    kept = _persistent(layout)
    parts, shared, alone = [], [], []
    for name, patch in problem.patches.items():
        contacts = PlaneContacts(
            angles[None], {name: np.zeros((1, len(patch.module)), np.bool_)}, np.array([surface])
        )
        single = PlaneProblem(contacts, {name: patch}, problem.joint_sigma, problem.tilting)
        own = state.copy()
        own.depths = np.zeros(1)
        z, J, k, u = single.rows(name, own, layout)
        information = weigh(z, np.zeros(z.shape, np.bool_))[0][0] * patch.usable
        rows = np.flatnonzero(information > TOLD)
        root = np.sqrt(information[rows])[:, None]
        A = np.zeros((len(rows), layout.count))
        A[:, : layout.main] = root * J[0, rows]
        at = layout.shift[name][patch.module[rows]]
        A[np.arange(len(rows))[:, None], at] = root * u[0]
        parts.append(A[:, kept])
        shared.append(root[:, 0] * float(k))
        alone.append((root[:, 0] * float(k)) ** 2 * heights[name][rows])
    a = np.concatenate(shared)
    R = np.diag(1.0 + np.concatenate(alone)) + spread**2 * np.outer(a, a)
    return np.concatenate(parts), R


def place_slopes(problem: PlaneProblem, state: PlaneState, layout: Layout) -> FloatArray:
    """(n, 3, count) of all taxels' places in their links to all unknowns."""
    every = []
    for name, patch in problem.patches.items():
        M = state.mounts[name]
        n = len(patch.module)
        arm = (patch.chain.taxels + state.shifts[name][patch.module]) @ M[:3, :3].T
        slopes = np.zeros((n, 3, layout.count))
        first = layout.mount[name]
        slopes[:, :, first : first + 6] = motion_slopes(arm)
        slopes[np.arange(n)[:, None], :, layout.shift[name][patch.module]] = M[:3, :3].T
        every.append(slopes)
    return np.concatenate(every)


SKIN = 25e-3  # of a link's mesh nearer to a taxel counts as skin [m]
STILL = 1e-3  # a joint that moved less in all presses is left where it was [rad, m]
DRAWN, DRAWS = 1500, 3  # poses drawn at once, and how often, for the candidates of one patch
ENOUGH = 300  # candidates
DEPTH = 2.5e-3  # of the lowest taxel in a proposed pose [m]


@dataclass(frozen=True, eq=False, slots=True)
class Pressing:
    """What it takes to propose presses.

    Attributes
    ----------
    chains : mapping of str to Chain
        By part; mounts as the manifest assumes.
    normals : mapping of str to (n, 3) float
    limits : (j, 2) float
        Of each column of the angles; joints that never moved stay.
    obstacles : tuple of Obstacle
        Links whose pose the angles tell.
    """

    chains: Mapping[str, Chain]
    normals: Mapping[str, FloatArray]
    limits: FloatArray
    obstacles: tuple[Obstacle, ...]


def part_chains(robot: Robot, parts: Sequence[str], joints: Sequence[str]) -> dict[str, Chain]:
    """The chain of each part from the body's root, its taxels where the manifest says.

    Joints before the first that is named are taken to have stood still, at zero (`stood_still`).

    Raises
    ------
    InvalidArrayError
        A joint between or behind those that are named has no angles.
    """
    chains = {}
    for part in parts:
        skin = robot.skin(part)
        held = dict.fromkeys(stood_still(robot, part, joints), 0.0)
        chains[part] = robot_chain(
            robot, skin.link, joints, held=held, name=part, taxels=skin.positions
        )
    return chains


def stood_still(robot: Robot, part: str, joints: Sequence[str]) -> tuple[str, ...]:
    """Joints of a part's chain before the first whose angles are told.

    To an unknown plane it is the same where they stood.
    """
    tree, way = robot.body.tree, ancestors(robot.body.tree, robot.part(part).link)
    passed = [tree[link].driver for link in reversed(way[:-1]) if tree[link].kind != "fixed"]
    still = []
    for joint in dict.fromkeys(filter(None, passed)):
        if joint in joints:
            break
        still.append(joint)
    return tuple(still)


def pressing(
    robot: Robot, parts: Sequence[str], joints: Sequence[str], contacts: PlaneContacts
) -> Pressing:
    """Chains, limits and obstacles of parts that were pressed in some poses."""
    chains = part_chains(robot, parts, joints)
    limits = np.array([robot.body.joints[joint] for joint in joints]).reshape(-1, 2)
    angles = contacts.angles
    still = np.ptp(angles, axis=0) < STILL
    limits[still] = angles.mean(axis=0)[still, None]
    normals = {part: robot.skin(part).normals for part in parts}
    return Pressing(chains, normals, limits, tuple(_obstacles(robot, parts, joints)))


def _obstacles(robot: Robot, parts: Sequence[str], joints: Sequence[str]) -> list[Obstacle]:
    """Links that move with a part's chain, above it or below it, without their skin."""
    tree = robot.body.tree
    own = {robot.part(part).link: part for part in parts}
    above = {link for one in own for link in ancestors(tree, one)}
    held = {joint: 0.0 for joint in robot.body.joints if joint not in joints}
    still = {joint: 0.0 for part in parts for joint in stood_still(robot, part, joints)}
    found = []
    for link in robot.body.visible_links:
        below = bool(own.keys() & set(ancestors(tree, link)))
        if link not in above and not below:
            continue
        points = robot.mesh(link).vertices
        if link in own:
            places = robot.skin(own[link]).positions
            points = points[cKDTree(places).query(points)[0] > SKIN]
        try:
            # Joints below the patch that no column tells (a hand's) are taken to stand at zero.
            chain = robot_chain(robot, link, joints, held=held if below else still)
            corners = points[ConvexHull(points).vertices]
        except (QhullError, SkinError, ValueError, IndexError):
            continue  # a link that nobody can follow, or that has no volume beside its skin
        if len(chain.joints):
            found.append(Obstacle(chain, corners))
    return found


def candidates(
    setup: Pressing,
    contacts: PlaneContacts,
    mounts: Mapping[str, FloatArray],
    planes: Sequence[Plane],
    rng: np.random.Generator,
) -> PlaneContacts:
    """Poses that press a part on a surface, within limits, the rest of the arm kept off it.

    What must stay off: each link that stayed off the surface in every press so far.
    """
    every, surfaces = [np.zeros((0, contacts.angles.shape[1]))], [np.zeros(0, np.int64)]
    for number, plane in enumerate(planes):
        seen = contacts.angles[contacts.surface == number]
        kept = [one for one in setup.obstacles if (one.height(seen, plane) > 0.0).all()]
        for name, chain in setup.chains.items():
            placed = replace(chain, mount=mounts[name])
            count = 0
            for _ in range(DRAWS):
                found = pressing_poses(
                    placed, setup.normals[name], plane, setup.limits,
                    depth=DEPTH, count=DRAWN, obstacles=kept, rng=rng,
                )  # fmt: skip
                every.append(found)
                surfaces.append(np.full(len(found), number))
                count += len(found)
                if count >= ENOUGH:
                    break
    return PlaneContacts(np.concatenate(every), {}, np.concatenate(surfaces))
