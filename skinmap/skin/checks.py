"""Checks of a skin against what else is known: module layout, module frames, the mirror image."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray
from skinmap.disk_cache import cached
from skinmap.geometry.proximity import median_spacing, nearest
from skinmap.geometry.rigid import rigid_fit, transform_points
from skinmap.skin.modules import ModuleLayout, ModulePose, fit_modules, shared_places, slots_of
from skinmap.skin.repair import MISFIT
from skinmap.skin.skin import Skin
from skinmap.skin.taxels import TaxelTable

TURNED = np.radians(45.0)  # from the usual angle of a part: boards turn by thirds of a circle
MIRROR_STEPS = 15  # of the nearest-neighbour fit: steps below 0.01 mm by then
TWIN = 0.25  # of the taxels' spacing: median distance of parts of one shape
OFF_SCALE = 0.15  # boards are cut and bent, but not by so much of the layout's size
NEAR = 0.5  # of a module's side: a frame this near to a module is that module's


class ModuleCheck:
    """What is odd about the modules of a part, beside their layout and frames from the body.

    Parameters
    ----------
    table : TaxelTable
        In the frame of its link.
    skin : Skin
        The same taxels with repaired normals.
    layout : ModuleLayout
    frames : mapping of int to (4, 4) array
        T_link_module; empty where the body has none.

    Attributes
    ----------
    missing : tuple of int
        Modules that the body has frames for and the table has no taxels of.
    swapped : dict of int to int
        Modules that stand where the body has another one's frame.
    rotated, mirrored : tuple of int
        Modules turned in their plane against the others, or laid out as a mirror image.
    misfit : tuple of int
        Modules whose taxels do not lie at the slots of the layout, or are more than those.
    modules : int
        How many were compared.
    scale : float
        Size of the modules beside the layout's, median; NaN where unknown.
    pitch, side : float
        Median distance of neighbours inside modules, and side of the boards as the distance of
        neighbouring modules tells it [m]; NaN where unknown.
    """

    def __init__(
        self, table: TaxelTable, skin: Skin, layout: ModuleLayout, frames: Mapping[int, FloatArray]
    ) -> None:
        poses = {m: pose for m, pose in fit_modules(table, layout).items() if pose.sure}
        scales = {module: _scale(table, layout, module) for module in poses}
        self.missing = tuple(sorted(set(frames) - set(table.modules.tolist())))
        self.swapped = _swapped(poses, frames, layout)
        self.rotated = _rotated(poses, frames, self.swapped)
        self.mirrored = _mirrored(skin, poses)
        self.misfit = tuple(
            module
            for module, pose in poses.items()
            if pose.residual > MISFIT * layout.pitch
            or abs(scales[module] - 1.0) > OFF_SCALE
            or (table.modules == module).sum() > len(layout)
        )
        self.modules = len(poses)
        self.scale = float(np.median(list(scales.values()) or [np.nan]))
        self.pitch, self.side = _pitch(table), _side(poses)


def mirror_distance(points: FloatArray, others: FloatArray) -> float:
    """Median distance [m] from points (n, 3) to the mirror image of others (m, 3), best laid.

    Channels of left and right parts are wired differently, so only the shape is compared: the
    image is laid over the points by its principal axes in each of their four proper ways and
    moved to its nearest neighbours from there. Kept between runs.
    """

    def lay() -> dict[str, FloatArray]:
        return {"distance": np.array(_mirror_distance(points, others))}

    return float(cached("mirror_distance", [points, others, MIRROR_STEPS], lay)["distance"])


def twin_parts(skins: Mapping[str, Skin]) -> dict[str, str]:
    """The first part of each one's shape: itself, or the part that it is the mirror image of.

    Parts of one shape, reflected or not, are touched alike: what learnt on one has seen the other.
    More than half of the taxels of each must lie on the other, so that a missing module parts no
    pair. How many taxels there are decides nothing.

    Parameters
    ----------
    skins : mapping of str to Skin
        By part.

    Returns
    -------
    dict of str to str
        For each part the first of `skins` that has its shape.
    """
    firsts: dict[str, str] = {}
    for part, skin in skins.items():
        known = (one for one in dict.fromkeys(firsts.values()) if _twins(skin, skins[one]))
        firsts[part] = next(known, part)
    return firsts


def _twins(one: Skin, other: Skin) -> bool:
    near = TWIN * median_spacing(one.positions)
    few, many = sorted((len(one), len(other)))
    return 2 * few > many and any(
        max(mirror_distance(one.positions, image), mirror_distance(image, one.positions)) < near
        for image in (other.positions, other.positions * [-1.0, 1.0, 1.0])
    )


def _mirror_distance(points: FloatArray, others: FloatArray) -> float:
    image = others * [-1.0, 1.0, 1.0]
    tree = cKDTree(points)
    here, there = _principal_axes(points), _principal_axes(image)
    best = np.inf
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        turn = here @ np.diag([signs[0], signs[1], signs[0] * signs[1]]) @ there.T
        laid = (image - image.mean(axis=0)) @ turn.T + points.mean(axis=0)
        for _ in range(MIRROR_STEPS):
            _, index = tree.query(laid)
            laid = transform_points(rigid_fit(laid, points[index], np.ones(len(laid))), laid)
        best = min(best, float(np.median(tree.query(laid)[0])))
    return best


def _principal_axes(points: FloatArray) -> FloatArray:
    """Right-handed principal axes (3, 3) of points, as columns."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    axes[2] = np.cross(axes[0], axes[1])
    return np.asarray(axes.T)


def _swapped(
    poses: Mapping[int, ModulePose], frames: Mapping[int, FloatArray], layout: ModuleLayout
) -> dict[int, int]:
    if not frames:
        return {}
    names = np.array(list(frames))
    origins = np.array([frames[name][:3, 3] for name in frames])
    reach = NEAR * (layout.side or 4.0 * layout.pitch)
    found = {}
    for module, pose in poses.items():
        gap = np.linalg.norm(origins - pose.T_link_module[:3, 3], axis=1)
        there = int(names[np.argmin(gap)])
        if gap.min() <= reach and there != module:
            found[module] = there
    return found


def _rotated(
    poses: Mapping[int, ModulePose], frames: Mapping[int, FloatArray], swapped: Mapping[int, int]
) -> tuple[int, ...]:
    """Modules whose angle against their frame differs from the part's usual one.

    Where most angles disagree with each other the frames follow no convention to compare with.
    """
    angles = {}
    for module, pose in poses.items():
        name = swapped.get(module, module)
        if name in frames:
            x = pose.T_link_module[:3, :3].T @ frames[name][:3, 0]
            angles[module] = np.arctan2(x[1], x[0])
    if len(angles) < 3:
        return ()
    values = np.array(list(angles.values()))
    apart = np.abs(np.angle(np.exp(1j * (values[:, None] - values[None]))))
    usual = int(np.argmax((apart < TURNED).sum(axis=1)))
    if (apart[usual] < TURNED).mean() < 0.5:
        return ()
    return tuple(m for m, gap in zip(angles, apart[usual], strict=True) if gap >= TURNED)


def _mirrored(skin: Skin, poses: Mapping[int, ModulePose]) -> tuple[int, ...]:
    """Modules whose order of slots turns against the outside.

    A flat board fits its mirror image just as well, turned over: only the normal tells.
    """
    outward = {module: skin.normals[skin.modules == module].sum(axis=0) for module in poses}
    return tuple(m for m, pose in poses.items() if pose.T_link_module[:3, 2] @ outward[m] < 0)


def _scale(table: TaxelTable, layout: ModuleLayout, module: int) -> float:
    """Size of a module's taxels about their middle beside that of their slots in the layout."""
    slots = slots_of(table, layout)
    rows = (table.modules == module) & ~layout.thermal[slots] & ~shared_places(table)
    places, points = layout.xy[slots[rows]], table.positions[rows]
    size = np.linalg.norm(places - places.mean(axis=0))
    return float(np.linalg.norm(points - points.mean(axis=0)) / size) if size else 1.0


def _pitch(table: TaxelTable) -> float:
    several = (table.positions[table.modules == module] for module in np.unique(table.modules))
    gaps = [nearest(points, 1)[0][:, 0] for points in several if len(points) > 1]
    return float(np.median(np.concatenate(gaps))) if gaps else float("nan")


def _side(poses: Mapping[int, ModulePose]) -> float:
    """Side of triangular boards: neighbouring centres are side / sqrt(3) apart."""
    if len(poses) < 2:
        return float("nan")
    centres = np.array([pose.T_link_module[:3, 3] for pose in poses.values()])
    return float(np.sqrt(3.0) * np.median(nearest(centres, 1)[0]))
