"""Joints of a body: how each link hangs on its parent, and the path between two links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from skinmap.arrays import FloatArray, check_finite, freeze
from skinmap.errors import InvalidArrayError, check_known
from skinmap.geometry.rigid import check_transform

Kind = Literal["fixed", "turns", "slides"]


@dataclass(frozen=True, eq=False, slots=True)
class Joint:
    """What holds a link to its parent.

    Attributes
    ----------
    name : str
    parent : str
        Link that it hangs on.
    kind : {"fixed", "turns", "slides"}
    T_parent_joint : (4, 4) float
        Where the link is while the joint is at zero [m].
    axis : (3,) float
        In the joint's frame. A turning joint's length does not matter; a sliding joint goes its
        axis' length a metre.
    driver : str
        Joint whose angle moves this one: itself, or the one that it mimics; "" where nothing does.
    factor, offset : float
        Its own angle is factor * angle of the driver + offset.
    """

    name: str
    parent: str
    kind: Kind
    T_parent_joint: FloatArray
    axis: FloatArray
    driver: str
    factor: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        axis = check_finite(self.axis, f"axis of joint {self.name!r}", (3,))
        if self.kind != "fixed" and not axis.any():
            raise InvalidArrayError(f"the axis of joint {self.name!r} has no length")
        origin = check_transform(self.T_parent_joint, f"origin of joint {self.name!r}")
        freeze(self, axis=axis, T_parent_joint=origin)


def joint_transform(joint: Joint, angle: float) -> FloatArray:
    """T_parent_link (4, 4) at a joint's own angle [rad or m]."""
    move = np.eye(4)
    if joint.kind == "slides":
        move[:3, 3] = angle * joint.axis
    elif joint.kind == "turns":
        x, y, z = joint.axis / np.linalg.norm(joint.axis)
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        # Rodrigues' formula.
        move[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    return np.asarray(joint.T_parent_joint @ move)


Tree = Mapping[str, Joint]  # the joint above each link but the root


def ancestors(tree: Tree, link: str) -> list[str]:
    """The link itself, its parent, and so on to the root."""
    way = [link]
    while way[-1] in tree:
        way.append(tree[way[-1]].parent)
    return way


def common_ancestor(tree: Tree, links: Sequence[str]) -> str:
    """The deepest link that all of `links` hang on; one of them may be it.

    Raises
    ------
    InvalidArrayError
        No link was named.
    """
    if not links:
        raise InvalidArrayError("a common link of no links does not exist")
    shared = ancestors(tree, links[0])
    for link in links[1:]:
        own = set(ancestors(tree, link))
        shared = [one for one in shared if one in own]
    return shared[0]


def check_link(links: Sequence[str], link: str) -> str:
    """The link, if the body has it.

    Raises
    ------
    UnknownNameError
        It has not (names those that exist).
    """
    check_known("link", [link], links)
    return link
