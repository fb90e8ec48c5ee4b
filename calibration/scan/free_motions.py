"""Motions that a shape leaves free: a cylinder slides along its axis and turns about it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.scan.icp import WIDTH, linearised
from skinmap.arrays import FloatArray

if TYPE_CHECKING:
    from calibration.scan.icp import Scene

NOISE = 0.5e-3  # the least that a scan strays by [m]
MOVED = 5e-3  # a motion is free if moving this far [m] ...
RAISED = 0.06  # ... raises the mean square of the distances by less than this share
PURE = 0.05  # of a motion's turning part: less is a shift
WORDS = ("long axis", "middle axis", "short axis")


def free_motions(scene: Scene, pose: FloatArray) -> tuple[tuple[str, ...], FloatArray]:
    """Free motions at a pose in words, and the covariance (6, 6) of the pose.

    The motions tried are the eigenvectors of the normal matrix, turns measured at the scan's
    radius; each is carried out, as normals of a mesh waver more than its places. One that is
    stopped on one side only (a scan at the rim of a tube) is free.
    """
    rows, high, weight, middle = linearised(scene, pose)
    points = scene.scan @ pose[:3, :3].T + pose[:3, 3]
    radius = float(np.sqrt(np.mean(np.sum((points - middle) ** 2, axis=1))))
    scale = np.repeat([1.0 / radius, 1.0], 3)
    scaled = rows * scale
    total = max(float(weight.sum()), 1.0)
    mean = (scaled * weight[:, None]).T @ scaled / total
    square = max(float(weight @ high**2) / total, NOISE**2)
    _, vectors = np.linalg.eigh(mean)
    covariance = square / total * np.linalg.inv(mean + 1e-9 * np.eye(6))
    covariance = covariance * np.outer(scale, scale)
    raised = [
        min(_square(scene, pose, middle, sign * MOVED * scale * vector) for sign in (-1, 1))
        for vector in vectors.T
    ]
    level = _square(scene, pose, middle, np.zeros(6))
    free = vectors[:, np.array(raised) - level < RAISED * square]
    return _named(free, middle, radius, scene.target.vertices), covariance


def _square(scene: Scene, pose: FloatArray, middle: FloatArray, step: FloatArray) -> float:
    """Mean square distance [m2] once a pose is moved by a turn [rad] and a shift [m]."""
    move = np.eye(4)
    move[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix()
    move[:3, 3] = middle + step[3:] - move[:3, :3] @ middle
    high = scene.heights(move @ pose)
    return float(np.minimum(high**2, WIDTH**2).mean())


def _named(
    free: FloatArray, middle: FloatArray, radius: float, link: FloatArray
) -> tuple[str, ...]:
    """Shifts and turns that span the free motions (6, k)."""
    if free.shape[1] == 0:
        return ()
    _, axes = np.linalg.eigh(np.cov(link.T))
    axes = axes.T[::-1]
    # Combinations of free motions by how much they turn: those that do not are shifts.
    _, turning, mix = np.linalg.svd(free[:3], full_matrices=True)
    amounts = np.zeros(free.shape[1])
    amounts[: len(turning)] = turning
    words = []
    for amount, motion in sorted(zip(amounts, (free @ mix.T).T, strict=True), key=lambda m: m[0]):
        if amount < PURE:
            words.append(f"slides along {_axis(motion[3:], axes)}")
        else:
            turn = motion[:3] / radius
            foot = middle + np.cross(turn, motion[3:]) / (turn @ turn)
            place = ", ".join(f"{1e3 * value:.0f}" for value in foot)
            words.append(f"turns about {_axis(turn, axes)} through ({place}) mm")
    return tuple(words)


def _axis(direction: FloatArray, axes: FloatArray) -> str:
    unit = direction / np.linalg.norm(direction)
    unit = unit * np.sign(unit[np.argmax(np.abs(unit))])
    cosine = np.abs(axes @ unit)
    numbers = ", ".join(f"{value + 0.0:.2f}" for value in np.round(unit, 2))
    if cosine.max() < 0.9:
        return f"({numbers})"
    return f"its {WORDS[int(np.argmax(cosine))]} ({numbers})"
