"""Touches planted on a skin, sample by sample: what contacts and identities are measured on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from skinmap.live.contacts.contact_tracker import ContactTracker
from skinmap.live.robot_skin import JoinedSkin

PRINT = 9e-3  # at this distance from its middle a finger's print has fallen to 1/e [m]
NOISE = 1.2  # counts, as `skinmap.touch.simulation.sensing` has it
APART = 0.03  # between two touches [m]


def finger(skin: JoinedSkin, part: str, place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shares (N,) of a finger's pressure on the taxels of a part, 1 in its middle."""
    rows = skin.slices[part]
    away = np.linalg.norm(skin.positions[rows] - place, axis=1)
    shares = np.zeros(len(skin))
    shares[rows] = np.exp(-((away / PRINT) ** 2))
    return shares


def read(
    loads: NDArray[np.float64], gains: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Counts (N,) as taxels send them: gains, noise, whole numbers of 0 to 255."""
    counts = loads * gains + rng.normal(0.0, NOISE, len(loads))
    return np.rint(np.clip(counts, 0.0, 255.0))


def pairs(skin: JoinedSkin, part: str, count: int, rng: np.random.Generator) -> Iterator[list[int]]:
    """Pairs of taxels on one sheet, 30 mm apart and facing the same way."""
    rows = skin.slices[part]
    points, normals = skin.positions[rows], skin.normals[rows]
    sheet = skin.patch_of[rows]
    found = 0
    for one in rng.permutation(len(points)).tolist():
        away = np.linalg.norm(points - points[one], axis=1)
        fits = (sheet == sheet[one]) & (normals @ normals[one] > 0.7)
        fits &= np.abs(away - APART) < 2e-3
        if not fits.any():
            continue
        yield [one, int(rng.choice(np.flatnonzero(fits)))]
        found += 1
        if found == count:
            return


def kept_share(
    skin: JoinedSkin,
    part: str,
    pair: list[int],
    *,
    samples: int,
    rng: np.random.Generator,
    rate: float = 50.0,
) -> float:
    """Share of samples in which two wandering fingers keep the numbers that they began with."""
    tracker = ContactTracker(skin)
    gains = np.clip(rng.normal(1.0, 0.15, len(skin)), 0.4, 1.6)
    middle = skin.positions[skin.slices[part]][pair]
    first: list[int] = []
    kept = 0
    landed = round(0.2 * rate)  # then both press in full
    for step in range(samples):
        time = step / rate
        turn = 2.0 * np.pi * (0.3 * time + np.array([0.0, 0.4]))
        sway = 3e-3 * np.column_stack([np.cos(turn), np.sin(turn), np.cos(2.0 * turn)])
        press = 120.0 * (1.0 + 0.1 * rng.standard_normal(2)) * min(1.0, (step + 1) / landed)
        loads = sum(press[k] * finger(skin, part, middle[k] + sway[k]) for k in range(2))
        tracker.update(time, read(loads, gains, rng))
        present = tracker.present
        if step < landed or len(present) < 2:
            continue
        centres = np.stack([track.centre for track in present])
        near = [
            int(np.linalg.norm(centres - middle[k] - sway[k], axis=1).argmin()) for k in range(2)
        ]
        numbers = [present[k].identity for k in near]
        first = first or numbers
        kept += numbers == first and numbers[0] != numbers[1]
    return kept / (samples - landed)
