"""A robot before a table: chains of its patches, what must stay off the table, where to press."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from calibration.mount.chains import Chain
from calibration.mount.robot_chains import robot_chain
from calibration.plane.contacts import Plane, PlaneContacts
from calibration.plane.poses import Obstacle, pressing_poses
from skinmap.arrays import FloatArray
from skinmap.errors import SkinError
from skinmap.skin.joints import ancestors
from skinmap.skin.robot import Robot

SKIN = 25e-3  # of a link's mesh nearer to a taxel counts as skin [m]
STILL = 1e-3  # a joint that moved less in all presses is left where it was [rad, m]
DRAWN, ROUNDS = 1500, 3  # poses drawn at once, and how often, for the candidates of one patch
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
            for _ in range(ROUNDS):
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
