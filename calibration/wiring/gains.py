"""Gains of taxels beside their neighbours, from the course of single touches.

A finger of unknown shape and force passes on an unknown track. Its load on a taxel is its force at
that moment times a profile that falls with the distance times the gain of the taxel: force, track,
profile and gains are fitted together. The gains alone then have a normal distribution, whose
precisions add up over touches and check-ups.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from calibration.wiring.boards import Boards
from calibration.wiring.touches import THRESHOLD, Touch
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.log_maps import log_map
from skinmap.geometry.proximity import bridged_graph

MM = 1e3
FULL = 250.0  # counts above which an answer is cut off
KNOTS = np.array([0.0, 3.0, 5.5, 8.0, 11.0, 15.0, 40.0])  # of the profile [mm]
FLAT, STRAIGHT = (1, np.zeros(len(KNOTS))), (2, np.zeros(len(KNOTS)))  # its ends
PROFILE = CubicSpline(KNOTS, np.eye(len(KNOTS)), bc_type=(FLAT, STRAIGHT))
SLOPE = PROFILE.derivative()
WIDTH, LOWEST = 6.0, -6.0  # of the profile that the fit begins with [mm], its least logarithm
SPREAD = 0.3  # of gains, before anything is known [log]
BEND, SURGE = 1.0, 0.3  # of the track [mm] and of the force [log], second differences of samples
OVAL = 0.4  # of the metric in which the finger is round
ROUGH, SHARE = 2.0, 0.06  # error of an answer [counts], and of the model
LARGE = 2.0  # errors above count less [standard deviations]
ASIDE, REACH = 22.0, 0.13  # from the path [mm]; of the plane that a touch is laid in [m]
FEWEST, FELT = 6, 8.0  # taxels of a touch, and what they answer at least [counts]
SHORTEST, TOGETHER = 5, 3  # samples of a touch, and taxels that answer in each
STEPS, TRIES, DONE = 14, 4, 1e-3  # of the fit


class Told(NamedTuple):
    """Evidence of one touch on the logarithms of gains, for the rows (k,) of the table that it met.

    `precision` (k, k), and `pull` (k,): the precision times the likeliest gains.
    """

    rows: IntArray
    precision: FloatArray
    pull: FloatArray


def gains_told(boards: Boards, touch: Touch, trusted: BoolArray) -> Told | None:
    """Fit one touch.

    Parameters
    ----------
    boards : Boards
        Of a part with n taxels.
    touch : Touch
        With its samples and path.
    trusted : (n,) bool
        Rows of the table that may be judged.

    Returns
    -------
    Told or None
        None of a touch that is too short, too small, or has no path.
    """
    if touch.samples is None:
        return None
    samples, positions = touch.samples, boards.table.positions
    held = np.minimum(samples[1:-1], np.maximum(samples[:-2], samples[2:]))
    busy = np.flatnonzero((held > THRESHOLD).sum(axis=1) >= TOGETHER) + 1
    if len(busy) < SHORTEST:
        return None
    middle = touch.path[len(touch.path) // 2]
    source = int(np.linalg.norm(positions - middle, axis=1).argmin())
    graph = bridged_graph(positions, 10, 2.5 * boards.pitch)
    plane = MM * log_map(positions, boards.normals, graph, source, REACH)[0]
    aside = MM * np.linalg.norm(positions[:, None] - touch.path, axis=2).min(axis=1)
    peak = np.sort(samples, axis=0)[-2]  # a spike is in one sample
    met = trusted & (aside < ASIDE) & np.isfinite(plane[:, 0]) & (peak > FELT)
    if met.sum() < FEWEST:
        return None
    values = np.maximum(samples[busy[0] : busy[-1] + 1, met], 0.0)
    return Told(np.flatnonzero(met), *_Passage(plane[met], values).gains())


class _State(NamedTuple):
    """Where a fit stands: unknowns, and what follows from them for each sample and taxel."""

    unknowns: FloatArray
    away: FloatArray  # (t, k, 2) from the finger [mm]
    pull: FloatArray  # (t, k, 2) half the slope of the squared radius
    radius: FloatArray
    load: FloatArray
    error: FloatArray
    cost: float


class _Passage:
    """A finger over taxels at (k, 2) [mm] that answered (t, k) [counts].

    The unknowns are the logarithm of the force (t), the track (2 t) [mm], the logarithm of the
    profile at its knots but the first, how much longer than wide the finger is along the first axis
    and the diagonal, and the logarithms of the gains (k).
    """

    def __init__(self, places: FloatArray, values: FloatArray) -> None:
        self.places, self.values = places, values
        (t, k), knots = values.shape, len(KNOTS) - 1
        self.size = t
        self.known, self.full = _even(values), values >= FULL
        curved = np.diff(np.eye(t), 2, axis=0)
        smooth = curved.T @ curved
        profile = np.maximum(-0.5 * (KNOTS[1:] / WIDTH) ** 2, LOWEST)
        weight = np.where(values > FELT, values, 0.0) ** 1.5
        total = weight.sum(axis=1)
        ticks, some = np.arange(t), total > 0
        rough = [np.interp(ticks, ticks[some], (weight @ own)[some] / total[some])
                 for own in places.T]  # fmt: skip
        track = np.linalg.solve(np.eye(t) + 4.0 * smooth, np.array(rough).T)
        force = np.log(np.maximum(values.max(axis=1), 5.0))
        self.first = np.concatenate([force, *track.T, profile, np.zeros(2 + k)])
        self.others = 3 * t + knots + 2
        self.expected = np.concatenate([np.zeros(3 * t), profile, np.zeros(2 + k)])
        self.prior = 1e-6 * np.eye(len(self.first))
        for number, size in enumerate((SURGE, BEND, BEND)):
            own = slice(number * t, (number + 1) * t)
            self.prior[own, own] += smooth / size**2
        rows = np.arange(3 * t, self.others)
        self.prior[rows, rows] += np.repeat([1.0 / 9.0, 1.0 / OVAL**2], [knots, 2])
        rows = np.arange(self.others, len(self.first))
        self.prior[rows, rows] += 1.0 / SPREAD**2

    def state(self, unknowns: FloatArray) -> _State:
        """The expected answers and their errors for these unknowns."""
        t = self.size
        track, profile = unknowns[t : 3 * t].reshape(2, t).T, unknowns[3 * t : self.others - 2]
        away = self.places - track[:, None]
        pull = away @ _oval(*unknowns[self.others - 2 : self.others])
        radius = np.sqrt(np.maximum((away * pull).sum(axis=2), 0.0) + 0.01)
        fallen = PROFILE(np.minimum(radius, KNOTS[-1]))[..., 1:] @ profile
        load = np.exp(np.minimum(unknowns[:t, None] + unknowns[self.others :] + fallen, 8.0))
        error = _even(load) - self.known
        error = np.where(self.full, np.minimum(_even(load) - _even(FULL), 0.0), error)
        off = unknowns - self.expected
        cost = 2.0 * LARGE**2 * (np.hypot(1.0, error / LARGE) - 1.0).sum() + off @ self.prior @ off
        return _State(unknowns, away, pull, radius, load, error, float(cost))

    def normal_equations(self, at: _State) -> tuple[FloatArray, FloatArray]:
        """Matrix and slope of the answers alone."""
        t = self.size
        steep = at.load / np.hypot(ROUGH, SHARE * at.load)
        steep[self.full & (at.load > FULL)] = 0.0
        when, which = np.nonzero((steep > 0.3) | (np.abs(at.error) > 1.0))
        one = np.arange(len(when))
        steep, radius = steep[when, which], np.minimum(at.radius[when, which], KNOTS[-1])
        falls = SLOPE(radius)[:, 1:] @ at.unknowns[3 * t : self.others - 2]
        falls = falls / at.radius[when, which]
        jacobian = np.zeros((len(when), len(self.first)))
        jacobian[one, when] = 1.0
        for axis in (0, 1):
            jacobian[one, (1 + axis) * t + when] = -falls * at.pull[when, which, axis]
        jacobian[:, 3 * t : self.others - 2] = PROFILE(radius)[:, 1:]
        x, y = at.away[when, which].T
        jacobian[:, self.others - 2] = 0.5 * falls * (y**2 - x**2)
        jacobian[:, self.others - 1] = falls * x * y
        jacobian[one, self.others + which] = 1.0
        jacobian *= steep[:, None]
        error = at.error[when, which]
        scaled = jacobian / np.hypot(1.0, error / LARGE)[:, None]
        return scaled.T @ jacobian, scaled.T @ error

    def gains(self) -> tuple[FloatArray, FloatArray]:
        """Precision (k, k) and pull (k,) of the gains, by Levenberg's method."""
        at, damping = self.state(self.first), 1e-2
        for _ in range(STEPS):
            matrix, slope = self.normal_equations(at)
            slope = slope + self.prior @ (at.unknowns - self.expected)
            for _ in range(TRIES):
                damped = matrix + self.prior + damping * np.diag(matrix.diagonal() + 1e-6)
                new = self.state(at.unknowns - np.linalg.solve(damped, slope))
                if new.cost < at.cost:
                    break
                damping *= 8.0
            else:
                break
            settled = at.cost - new.cost < DONE * at.cost
            at, damping = new, max(damping / 5.0, 1e-6)
            if settled:
                break
        matrix, _ = self.normal_equations(at)
        matrix = matrix + self.prior
        rest, gain = slice(0, self.others), slice(self.others, None)
        told = np.linalg.solve(matrix[rest, rest], matrix[rest, gain])
        known = matrix[gain, gain] - matrix[gain, rest] @ told  # with the spread of gains
        size = 1.4826 * np.median(np.abs(at.error[at.load > 20.0])) if (at.load > 20).any() else 1.0
        trust = 1.0 / max(size, 0.3) ** 2
        alone = known - np.eye(len(known)) / SPREAD**2
        return trust * alone, trust * (known @ at.unknowns[gain])


def _oval(along: float, across: float) -> FloatArray:
    """Metric (2, 2) in which the outline of a finger is a circle."""
    return np.array([[1.0 - along, across], [across, 1.0 + along]])


def _even(values: FloatArray | float) -> FloatArray:
    """Answers on a scale on which the errors of all are 1."""
    return np.asarray(np.arcsinh(SHARE / ROUGH * np.asarray(values)) / SHARE)
