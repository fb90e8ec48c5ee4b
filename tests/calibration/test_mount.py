"""Mounts from pairs: planted poses come back, within what the covariance predicts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calibration import fit_mount
from calibration.mount.rigid_mount import point_covariance
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.geometry.rigid import transform_points


def pose(rotvec, translation) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rotvec).as_matrix()
    T[:3, 3] = translation
    return T


MOUNT = pose([1.0, 0.5, -2.0], [0.1, 0.2, 0.3])


def pairs(rng, m=700, *, noise=1e-3, outliers=0.0, mount=MOUNT):
    """Points of a patch, frames of its link, and where the points were met in the world."""
    points = rng.normal(0, 0.05, (m, 3))
    frames = np.tile(np.eye(4), (m, 1, 1))
    frames[:, :3, :3] = Rotation.random(m, rng=rng).as_matrix()
    frames[:, :3, 3] = rng.normal(0, 0.2, (m, 3))
    T = frames @ mount
    targets = np.einsum("mij,mj->mi", T[:, :3, :3], points) + T[:, :3, 3]
    targets += rng.normal(0, noise, (m, 3))
    wild = rng.random(m) < outliers
    targets[wild] += rng.normal(0, 0.05, (wild.sum(), 3))
    return points, frames, targets


def error_of(fit) -> np.ndarray:
    """Left rotation vector and translation from the planted mount to the fitted one."""
    turn = Rotation.from_matrix(fit.mount[:3, :3] @ MOUNT[:3, :3].T).as_rotvec()
    return np.concatenate([turn, fit.mount[:3, 3] - MOUNT[:3, 3]])


@pytest.mark.parametrize("loss", ["linear", "cauchy"])
def test_fit_mount_finds_an_exact_mount(rng, loss):
    points, frames, targets = pairs(rng, 30, noise=0.0)
    fit = fit_mount(points, frames, targets, loss=loss)
    np.testing.assert_allclose(fit.mount, MOUNT, rtol=0, atol=1e-12)  # rounding
    assert fit.rms < 1e-12


@given(st.integers(0, 2**32 - 1))
def test_fit_mount_follows_a_rotation_of_the_world(seed):
    """A law: carrying frames and targets along changes nothing in the link."""
    rng = np.random.default_rng(seed)
    points, frames, targets = pairs(rng, 40)
    T = pose(rng.normal(size=3), rng.normal(size=3))
    moved = targets @ T[:3, :3].T + T[:3, 3]
    one, other = fit_mount(points, frames, targets), fit_mount(points, T @ frames, moved)
    np.testing.assert_allclose(one.mount, other.mount, rtol=0, atol=1e-12)  # rounding


@pytest.mark.parametrize(("loss", "outliers"), [("linear", 0.0), ("cauchy", 0.0), ("cauchy", 0.3)])
def test_covariance_predicts_the_error(rng, loss, outliers):
    squares = []
    for _ in range(60):
        fit = fit_mount(*pairs(rng, 200, outliers=outliers), loss=loss)
        squares.append(error_of(fit) @ np.linalg.solve(fit.covariance, error_of(fit)) / 6)
    # The mean of 60 chi squares of 6 has a deviation of 0.075; the issue asks for 0.5 to 2.
    assert 0.7 < np.mean(squares) < 1.4


def test_cauchy_ignores_what_pulls_squares(rng):
    data = pairs(rng, outliers=0.3)
    plain, robust = (np.linalg.norm(error_of(fit_mount(*data, loss=loss))[3:])
                     for loss in ("linear", "cauchy"))  # fmt: skip
    # 30 % of outliers at 50 mm: a mean is off by some mm, a robust one by 1 mm / sqrt(490) each.
    assert robust < 2e-4 < plain


def test_fit_mount_never_returns_a_reflection(rng):
    points = rng.normal(0, 0.05, (40, 3))
    frames = np.tile(np.eye(4), (40, 1, 1))
    fit = fit_mount(points, frames, points * [1, 1, -1])
    np.testing.assert_allclose(np.linalg.det(fit.mount[:3, :3]), 1.0, rtol=0, atol=1e-12)


def test_bad_input_is_named(rng):
    points, frames, targets = pairs(rng, 10)
    with pytest.raises(InvalidArrayError, match="at least 3 pairs, got 2"):
        fit_mount(points[:2], frames[:2], targets[:2])
    bent = frames.copy()
    bent[[2, 5], 0, 0] += 0.01
    with pytest.raises(InvalidArrayError, match="2 frames are not rigid: rows 2, 5"):
        fit_mount(points, bent, targets)
    mirrored = frames.copy()
    mirrored[7, :3, 0] *= -1
    with pytest.raises(InvalidArrayError, match="rows 7"):
        fit_mount(points, mirrored, targets)
    holed = targets.copy()
    holed[4, 1] = np.nan
    with pytest.raises(InvalidArrayError, match="targets holds NaN or infinity, first in row 4"):
        fit_mount(points, frames, holed)
    with pytest.raises(InvalidArrayError, match="targets must have shape"):
        fit_mount(points, frames, targets[:9])
    with pytest.raises(InvalidArrayError, match="all points lie in a row"):
        fit_mount(np.outer(np.arange(10), [1, 2, 3]), frames, targets)
    with pytest.raises(UnknownNameError, match="linear, cauchy"):
        fit_mount(points, frames, targets, loss="huber")


@pytest.mark.parametrize(
    ("pairs", "loss", "least"),
    [
        (3, "linear", 0.9),
        (4, "linear", 0.9),
        (8, "linear", 0.9),
        (20, "linear", 0.9),
        (3, "cauchy", 0.82),
        (5, "cauchy", 0.82),
        (8, "cauchy", 0.87),
        (20, "cauchy", 0.9),
    ],
)
def test_areas_of_95_percent_hold_as_much_with_few_pairs(pairs, loss, least):
    """Without Student's distribution three pairs hold 75 %, by Cauchy's loss 46 %."""
    rng, held = np.random.default_rng(pairs), []
    for _ in range(200):
        points = rng.uniform(-0.05, 0.05, (pairs, 3))
        seen = points + rng.normal(0.0, 1e-3, (pairs, 3))
        fit = fit_mount(points, np.tile(np.eye(4), (pairs, 1, 1)), seen, loss=loss)
        place = points.mean(axis=0, keepdims=True) + 0.03
        missed = transform_points(fit.mount, place)[0] - place[0]
        area = point_covariance(fit.mount, place, fit.covariance)[0]
        held.append(missed @ np.linalg.solve(area, missed) < 7.815)  # chi2 of 3 at 95 %
    assert least <= np.mean(held) <= 0.99


def test_point_covariance_is_what_draws_of_the_mount_show(rng):
    """Two ways: the linear law against 4000 poses drawn from the covariance."""
    fit = fit_mount(*pairs(rng, 60))
    points = rng.normal(0, 0.1, (5, 3))
    moves = rng.multivariate_normal(np.zeros(6), fit.covariance, size=4000)
    turns = Rotation.from_rotvec(moves[:, :3]).as_matrix()
    drawn = np.einsum("sij,nj->sni", turns, points @ fit.mount[:3, :3].T) + moves[:, None, 3:]
    for k, wanted in enumerate(point_covariance(fit.mount, points, fit.covariance)):
        # Entries of a covariance of 4000 draws have a deviation of about 2.2 %.
        np.testing.assert_allclose(
            np.cov(drawn[:, k].T), wanted, rtol=0, atol=0.12 * np.abs(wanted).max()
        )
