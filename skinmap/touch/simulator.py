"""Simulated touches on an imported skin: what the classifiers are trained and shown on.

A touch is a set of pads (see `gestures`) laid on the skin around a point: the pads live in the
log map of that point, so fingers follow the body and cross the gaps between patches. Pressure
inside a pad falls off like Hertz contact, spreads through the foam as a Gaussian, is scaled by
each taxel's gain, saturates, gets noise and is rounded to 8 bits. The hand presses, holds with
a tremor, and lets go.

Limits: pads bend with the skin as if they were soft, however sharp the bend; the body between
the patches carries no load; taxels answer at once and without hysteresis. Accuracy on such
touches is simulated accuracy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray
from skinmap.errors import UnknownNameError
from skinmap.geometry.distances import bridged_graph
from skinmap.geometry.log_map import log_map
from skinmap.geometry.proximity import median_spacing
from skinmap.skin.skin import Skin
from skinmap.touch.gestures import GESTURES, Pad
from skinmap.touch.recording import Recording

RATE = 50.0  # samples a second, as the iCub sends
FULL_SCALE = 160.0  # counts at the middle of a pad of strength 1
FOAM = 2.5e-3  # spread of the pressure through the foam (standard deviation) [m]
NOISE = 1.2  # counts
GAIN_SPREAD = 0.15  # standard deviation of the taxels' gains
HAND = (0.75, 1.0)  # sizes of hands, 1 = adult
ON_SKIN = 0.7  # share of the pads that must lie over taxels
REACH = 0.13  # no pad goes further from its middle [m]
GAP = 0.25  # pause between touches [s]
TRIES = 60  # places tried for one touch before the part counts as too small for it


@dataclass(frozen=True, eq=False, slots=True)
class Stage:
    """What touches on one skin share: its graph, spacing and gains."""

    skin: Skin
    graph: csr_array
    spacing: float
    gains: FloatArray


def prepare(skin: Skin, *, rng: np.random.Generator) -> Stage:
    """Build the neighbour graph of a skin and draw the gain of each taxel."""
    spacing = median_spacing(skin.positions)
    graph = bridged_graph(skin.positions, 10, 2.5 * spacing)
    gains = np.clip(rng.normal(1.0, GAIN_SPREAD, len(skin)), 0.4, 1.6)
    return Stage(skin, graph, spacing, gains)


def simulate(
    skin: Skin,
    *,
    rng: np.random.Generator,
    per_gesture: int = 20,
    gestures: Sequence[str] = tuple(GESTURES),
    progress: Callable[[str], None] | None = None,
) -> Recording:
    """Touches anywhere on a skin, each gesture equally often, in random order.

    Parameters
    ----------
    skin : Skin
        n taxels.
    rng : numpy.random.Generator
    per_gesture : int
        Touches of each gesture. A gesture that does not fit the skin (less than 70 % of it
        over taxels wherever it is tried) is left out.
    gestures : sequence of str
        Names from `GESTURES`.
    progress : callable, optional
        Called once a touch with the name of the part.

    Returns
    -------
    Recording
        uint8 samples at 50 Hz with event numbers and labels.

    Raises
    ------
    UnknownNameError
        A gesture that does not exist.
    """
    for name in gestures:
        if name not in GESTURES:
            raise UnknownNameError("gesture", name, GESTURES)
    stage = prepare(skin, rng=rng)
    wanted = rng.permutation(np.repeat(np.arange(len(gestures)), per_gesture))
    blocks, events = [], []
    labels: list[str] = []
    tired: set[str] = set()
    for name in (gestures[i] for i in wanted):
        if progress is not None:
            progress(skin.part)
        loads = None if name in tired else _place(stage, name, rng)
        if loads is None:
            tired.add(name)
            continue
        for block, event in ((_play(stage, loads, rng), len(labels)), (_rest(stage, rng), -1)):
            blocks.append(block)
            events.append(np.full(len(block), event))
        labels.append(name)
    pressures = np.concatenate(blocks) if blocks else np.zeros((0, len(skin)), np.uint8)
    times = np.arange(len(pressures)) / RATE
    number = np.concatenate(events) if events else np.zeros(0, np.int64)
    return Recording(skin.part, times, pressures, number, tuple(labels))


def touch_loads(stage: Stage, pads: Sequence[Pad], uv: FloatArray) -> FloatArray:
    """(p, n) load of each pad on each taxel at full press, foam spread included.

    Inside a pad of radius R the load falls off as sqrt(1 - (d / R)^2) (Hertz); outside, the
    foam carries its rim on as a Gaussian.
    """
    loads = np.zeros((len(pads), len(uv)))
    near = np.isfinite(uv[:, 0])
    for number, pad in enumerate(pads):
        depth = pad.depth(uv[near])
        inside = np.sqrt(np.clip(1.0 - (1.0 - np.clip(depth, 0.0, 1.0)) ** 2, 0.0, 1.0))
        outside = np.clip(-depth, 0.0, None) * pad.radius
        rim = 0.35 * np.exp(-0.5 * (outside / FOAM) ** 2)
        loads[number, near] = pad.strength * (0.65 * inside + rim)
    return loads


def _place(stage: Stage, name: str, rng: np.random.Generator) -> FloatArray | None:
    """Loads (p, n) of a gesture at a random place where enough of it lies on the skin."""
    for _ in range(TRIES):
        pads = GESTURES[name](rng, rng.uniform(*HAND))
        source = int(rng.integers(len(stage.skin)))
        uv, _ = log_map(stage.skin.positions, stage.skin.normals, stage.graph, source, REACH)
        angle = rng.uniform(0.0, 2.0 * np.pi)
        c, s = np.cos(angle), np.sin(angle)
        shift = rng.normal(0.0, 0.3 * stage.spacing, 2) + _middle(pads)
        turned = uv @ np.array([[c, s], [-s, c]]) + shift
        if _share_on_skin(pads, turned, stage.spacing) >= ON_SKIN:
            return touch_loads(stage, pads, turned)
    return None


def _middle(pads: Sequence[Pad]) -> FloatArray:
    return np.mean([[*pad.start, *pad.end] for pad in pads], axis=0).reshape(2, 2).mean(axis=0)


def _share_on_skin(pads: Sequence[Pad], uv: FloatArray, spacing: float) -> float:
    """Share of the pads' area within one spacing of a taxel."""
    step = 3e-3
    taxels = uv[np.isfinite(uv[:, 0])]
    corners = np.array([[pad.start, pad.end] for pad in pads]).reshape(-1, 2)
    reach = max(pad.radius for pad in pads)
    low, high = corners.min(axis=0) - reach, corners.max(axis=0) + reach
    grid = np.stack(
        np.meshgrid(*(np.arange(a, b + step, step) for a, b in zip(low, high, strict=True))), -1
    ).reshape(-1, 2)
    covered = grid[np.max([pad.depth(grid) for pad in pads], axis=0) > 0]
    distance, _ = cKDTree(taxels).query(covered, distance_upper_bound=spacing)
    return float(np.isfinite(distance).mean())


def _play(stage: Stage, loads: FloatArray, rng: np.random.Generator) -> np.ndarray:
    """Samples (t, n) of one touch: press, hold with a tremor, let go."""
    press, hold, release = rng.uniform(0.08, 0.25), rng.uniform(0.4, 0.9), rng.uniform(0.08, 0.2)
    time = np.arange(0.0, press + hold + release, 1.0 / RATE) + 0.5 / RATE
    course = np.clip(np.minimum(time / press, (press + hold + release - time) / release), 0.0, 1.0)
    lag = rng.uniform(0.0, 0.06, len(loads))  # fingers do not land together
    each = np.stack([np.interp(time - late, time, course, left=0.0) for late in lag], axis=1)
    tremor = 1.0 + 0.06 * rng.standard_normal((len(time), len(loads)))
    counts = FULL_SCALE * (each * tremor) @ loads * stage.gains
    return _digitise(counts, rng)


def _rest(stage: Stage, rng: np.random.Generator) -> np.ndarray:
    return _digitise(np.zeros((int(GAP * RATE), len(stage.skin))), rng)


def _digitise(counts: FloatArray, rng: np.random.Generator) -> np.ndarray:
    noisy = counts + rng.normal(0.0, NOISE, counts.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
