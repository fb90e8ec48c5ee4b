"""Where taxels are, from touches with a known probe: wrong touches and dead taxels do no harm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import pdist

from calibration.patch.diagnosis import FEWEST, lay
from calibration.patch.patch_calibration import PatchCalibration
from calibration.patch.patch_evidence import Link, check_anchors, check_spread
from calibration.patch.sheet_model import Evidence
from skinmap.arrays import FloatArray, IntArray, check_finite, freeze
from skinmap.errors import InvalidArrayError
from skinmap.geometry.proximity import closest_on_mesh, median_spacing

FAR = 0.05  # a touch further than this from the link cannot have touched it [m]
PLACE = 0.15  # of the pitch: how well the centre of activated taxels tells the place of a touch


@dataclass(frozen=True, eq=False, slots=True)
class Touch:
    """A probe that touched the skin, and what was felt.

    Attributes
    ----------
    point : (3,) float
        Where the probe touched, in the frame of the mesh [m].
    sigma : float
        Standard deviation of each of its coordinates [m].
    channels : (k,) int
        Rows of the layout that felt it.
    values : (k,) float
        How much, in any unit; not negative.
    """

    point: FloatArray
    sigma: float
    channels: IntArray
    values: FloatArray

    def __post_init__(self) -> None:
        freeze(
            self,
            point=np.asarray(self.point, np.float64),
            channels=np.asarray(self.channels),
            values=np.asarray(self.values, np.float64),
        )


def locate_by_touch(
    layout: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    touches: Sequence[Touch],
    *,
    anchors: tuple[ArrayLike, ArrayLike] | None = None,
    anchor_sigma: ArrayLike = 1e-3,
    modules: ArrayLike | None = None,
    channels: ArrayLike | None = None,
    mirror: bool = False,
    rng: np.random.Generator | int,
) -> PatchCalibration:
    """Lay a flat board on a link by touches, with anchors or without.

    Touches whose distances along the link contradict those on the board are left out of the
    starts; in the solution every touch counts, by Cauchy's loss.

    Parameters
    ----------
    layout : (n, 2) array-like of float
        Taxels on the flat board, seen from outside [m].
    vertices, faces : (v, 3) array-like of float, (f, 3) array-like of int
        The link's mesh [m].
    touches : sequence of Touch
        At least three; `ok` needs eight, all over the patch.
    anchors : tuple of (k,) and (k, 3) array-like, optional
        Taxels whose place is known, and where they are [m].
    anchor_sigma : float
        Standard deviation of each coordinate of an anchor [m].
    modules : (n,) array-like of int, optional
        Rigid module of each taxel; without them the board is one flexible sheet.
    channels : (n,) array-like of int, optional
        What the taxels are called in messages; their rows by default.
    mirror : bool
        Whether the layout shows the board from its other side.
    rng : numpy.random.Generator or int
        Where the starts are taken; a number is its seed.

    Returns
    -------
    PatchCalibration
        With residuals of `touches`; `next_taxels` says where to touch next.

    Raises
    ------
    InvalidArrayError
        Too few touches, a channel that the layout lacks, NaN, other units (names the row).
    InvalidMeshError
        An empty mesh, or one that the anchors are far from.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> skin = robot.skin("left_hand")
    >>> link, board = robot.mesh(skin.link), skinmap.flatten(skinmap.build_surface(skin)).uv
    >>> touches = [
    ...     skinmap.Touch(skin.positions[row], 1e-3, channels=[row], values=[1.0])
    ...     for row in range(0, 144, 4)
    ... ]
    >>> skinmap.locate_by_touch(board, link.vertices, link.faces, touches, rng=0).status.value
    'ok'
    """

    def gather(flat: FloatArray, link: Link, names: IntArray) -> Evidence:
        felt = check_touches(flat, link, touches)
        if anchors is None:
            return felt
        return _joined(felt, check_anchors(flat, link, *anchors, anchor_sigma, names))

    return lay(
        layout, (vertices, faces), gather,
        modules=modules, channels=channels, mirror=mirror, rng=rng,
    )  # fmt: skip


def check_touches(layout: FloatArray, link: Link, touches: Sequence[Touch]) -> Evidence:
    """Touches as evidence: the centre of what was felt is where the probe was."""
    if len(touches) < FEWEST:
        raise InvalidArrayError(f"a patch needs at least {FEWEST} touches, got {len(touches)}")
    blend = np.zeros((len(touches), len(layout)))
    for row, touch in enumerate(touches):
        blend[row] = _shares(touch, row, len(layout))
    points = np.array([touch.point for touch in touches])
    sigma = np.array([touch.sigma for touch in touches])
    places = blend @ layout
    if np.median(pdist(places)) > 2.0 * median_spacing(layout):
        check_spread(places, points, "touches")
    distance, _, _ = closest_on_mesh(points, *link)
    far = np.flatnonzero(distance > FAR)
    if len(far) > len(touches) / 2:
        raise InvalidArrayError(
            f"touches {far.tolist()} lie up to {distance.max():.3g} m from the mesh: another "
            "link, frame or unit?"
        )
    spread = np.hypot(sigma, PLACE * median_spacing(layout))
    return Evidence(blend, points, spread, np.ones(len(touches), bool))


def _shares(touch: Touch, row: int, count: int) -> FloatArray:
    name = f"touch {row}"
    check_finite(touch.point, f"the point of {name}", (3,))
    values = check_finite(touch.values, f"the values of {name}", (None,))
    if not (np.isfinite(touch.sigma) and touch.sigma > 0):
        raise InvalidArrayError(f"the sigma of {name} must be above 0 m, got {touch.sigma}")
    if touch.channels.shape != values.shape or touch.channels.dtype.kind not in "iu":
        raise InvalidArrayError(
            f"{name} has {len(values)} values for channels of {touch.channels.dtype} "
            f"{touch.channels.shape}"
        )
    wrong = (touch.channels < 0) | (touch.channels >= count)
    if wrong.any():
        raise InvalidArrayError(
            f"{name} has taxel {touch.channels[wrong][0]}, the layout has 0..{count - 1}"
        )
    if (values < 0).any() or values.sum() <= 0:
        raise InvalidArrayError(f"{name} has no value above 0, or one below it")
    shares = np.bincount(touch.channels, values, minlength=count)
    return np.asarray(shares / shares.sum())


def _joined(one: Evidence, other: Evidence) -> Evidence:
    return Evidence(
        np.concatenate([one.blend, other.blend]),
        np.concatenate([one.points, other.points]),
        np.concatenate([one.sigma, other.sigma]),
        np.concatenate([one.doubted, other.doubted]),
    )
