"""Recordings with planted faults, and how many of them `skinmap examine` finds.

    python -m benchmarks.reliability.planted_faults [--recordings 300] [--seed 0]

Skins of 8 to 400 channels at 20 to 200 Hz: touches that pass over a sheet of taxels, with noise, as
whole numbers or silent at rest, rising or falling. Each fault is planted in one recording, and one
recording in a few stays clean. A fault is found where a finding of its kind names one of its
channels and one of its rows; others are false.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.soundness.examination import examine_tracks
from skinmap.soundness.finding import Finding
from skinmap.soundness.track import Track

Rng = np.random.Generator


@dataclass
class Made:
    """A recording, and the truth about it."""

    values: NDArray[Any]
    times: NDArray[np.float64]
    rate: float
    noise: float
    silent: bool
    sign: int
    more: dict[str, Any] = field(default_factory=dict)
    kind: str = ""
    channels: set[int] | None = None
    rows: list[list[int]] | None = None
    value: float | None = None


def sheet(rng: Rng) -> Made:
    """Touches that pass over a sheet of taxels."""
    width = int(rng.choice([8, 12, 16, 24, 40, 64, 100, 144, 192, 280, 400]))
    rate = float(rng.choice([20, 25, 48.6, 50, 80, 100, 125, 200]))
    count = int(np.clip(rate * rng.uniform(25, 90), 900, 9000))
    style = str(rng.choice(["float", "counts", "falling", "silent", "wide"]))
    columns = int(np.ceil(np.sqrt(width)))
    places = np.array([(k % columns, k // columns) for k in range(width)], float)
    gains = rng.lognormal(0.0, 0.25, width)
    load = np.zeros((count, width))
    at = int(rng.uniform(0.5, 3.0) * rate)
    labels, events, number = [], np.full(count, -1), 0
    kinds = ["poke", "stroke", "hand"]
    while at < count - 2 * rate:
        kind = str(rng.choice(kinds))
        long = int(rng.uniform(0.4, 2.5) * rate)
        begin, way = places[rng.integers(width)] + rng.uniform(-0.4, 0.4, 2), rng.normal(0, 1, 2)
        way *= np.sign(way * (columns / 2 - begin) + 1e-9)  # across the sheet
        way *= {"poke": 0.0, "stroke": columns, "hand": 0.2}[kind] / max(np.linalg.norm(way), 1e-9)
        size = {"poke": 0.8, "stroke": 1.0, "hand": 2.2}[kind] * rng.uniform(0.8, 1.2)
        force = rng.uniform(40, 160)
        span = np.arange(min(long, count - at))
        phase = span / max(long, 1)
        course = np.sin(np.pi * phase) ** rng.uniform(0.5, 1.5)
        course *= 1.0 + 0.1 * np.sin(2 * np.pi * span / rate * rng.uniform(0.5, 2.0))
        middle = begin + np.outer(phase, way)
        away = ((places[None] - middle[:, None]) ** 2).sum(axis=2)
        load[at + span] += force * course[:, None] * np.exp(-away / (2 * size**2))
        events[at + span] = number
        labels.append(kind)
        number += 1
        rest = rng.uniform(0.3, 2.5) if rng.random() > 0.15 else rng.uniform(4, 12)
        at += long + int(rest * rate)
    load *= gains
    noise = {"float": rng.uniform(0.2, 1.5),
             "counts": rng.uniform(0.25, 2.0), "wide": rng.uniform(5, 40),
             "falling": rng.uniform(0.3, 1.2), "silent": 0.0}[style]  # fmt: skip
    base = rng.normal(240, 4, width) if style == "falling" else rng.uniform(500, 3000) + rng.normal(
        0, 60, width) if style == "wide" else rng.uniform(10, 30, width) if style == "counts" else (
        np.zeros(width) if style == "silent" else rng.normal(0, 0.5, width))  # fmt: skip
    scale = 40.0 if style == "wide" else 1.0
    own = noise * rng.lognormal(0, 0.2, width)
    sign = -1 if style == "falling" else 1
    values = base + sign * scale * load + rng.normal(size=load.shape) * own
    if style != "float":
        values = np.rint(values)
    if style in ("counts", "silent"):
        values = (
            np.clip(values, 0, 255).astype(np.uint8)
            if values.max() < 250
            else np.clip(values, 0, 60000).astype(np.int32)
        )
    elif style == "falling":
        values = values.astype(np.int16)
    times = np.arange(count) / rate + rng.uniform(0, 1000)
    times += rng.normal(0, rng.choice([0.0, 0.003, 0.02]) / rate, count)
    return Made(values, np.maximum.accumulate(times), rate, noise,
                style == "silent", sign, {"events": events, "labels": tuple(labels)})  # fmt: skip


def touched_channels(made: Made) -> NDArray[np.int64]:
    """Channels that feel several touches."""
    values = made.values.astype(float)
    reach = np.abs(values - np.median(values, axis=0)).max(axis=0)
    order = np.argsort(reach)[::-1]
    return order[: max(len(order) // 2, 4)]


def some(made: Made, rng: Rng, most: int = 3) -> NDArray[np.int64]:
    """A few channels that are touched, which it notes."""
    count = int(rng.integers(1, min(most, max(made.values.shape[1] // 10, 1)) + 1))
    own = rng.choice(touched_channels(made), count, False)
    made.channels = set(own.tolist())
    return own


def rewrite(made: Made, order: NDArray[np.int64]) -> None:
    """Rows in another order, with their events."""
    made.values = made.values[order]
    made.times = made.times[order]
    if "events" in made.more:
        made.more["events"] = made.more["events"][order]


def plant_duplicate(made: Made, rng: Rng) -> None:
    """Rows written twice, or values that are not new."""
    count = len(made.times)
    if made.silent or rng.random() < 0.5:  # written twice, time and all
        rows = np.sort(
            rng.choice(np.arange(5, count - 5), int(rng.integers(3, count // 20)), False)
        )
        order = np.sort(np.concatenate([np.arange(count), rows]))
        first = rows + 1 + np.arange(len(rows))
        rewrite(made, order)
        made.rows = [[int(a), int(a)] for a in first]
    else:  # values that are not new, at times that go on
        a = int(rng.integers(10, count // 2))
        k = int(rng.integers(2, 6))
        rows = np.arange(a, min(a + int(rng.integers(100, 600)), count))
        made.values[rows] = made.values[a + (rows - a) // k * k]
        made.rows = [[int(rows[0]), int(rows[-1])]]


def plant_lost(made: Made, rng: Rng) -> None:
    """Rows left out."""
    count, gone = len(made.times), []
    for _ in range(int(rng.integers(1, 5))):
        a = int(rng.integers(20, count - 60))
        gone.append(np.arange(a, a + int(rng.integers(2, 30))))
    kept = np.setdiff1d(np.arange(count), np.concatenate(gone))
    rows = np.flatnonzero(np.diff(kept) > 1)
    rewrite(made, kept)
    made.rows = [[int(a), int(a) + 1] for a in rows]


def plant_order(made: Made, rng: Rng) -> None:
    """Rows in another order."""
    count = len(made.times)
    order = np.arange(count)
    made.rows = []
    for _ in range(int(rng.integers(1, 6))):
        a, k = int(rng.integers(10, count - 100)), int(rng.choice([2, 3, 10, 40]))
        order[a : a + k] = (
            order[a : a + k][::-1] if rng.random() < 0.5 else np.roll(order[a : a + k], 1)
        )
        made.rows.append([a, a + k - 1])
    rewrite(made, order)


def plant_restart(made: Made, rng: Rng) -> None:
    """A clock that begins anew."""
    count = len(made.times)
    a = int(rng.integers(count // 4, 3 * count // 4))
    made.times[a:] -= made.times[a] - (0.0 if rng.random() < 0.5 else made.times[0])
    made.rows = [[a, a]]


def plant_burst(made: Made, rng: Rng) -> None:
    """Rows with the time of their arrival."""
    times, made.rows = made.times, []
    for _ in range(int(rng.integers(1, 6))):
        a, k = int(rng.integers(20, len(times) - 100)), int(rng.integers(5, 40))
        times[a : a + k] = times[a + k - 1] - (
            np.arange(k)[::-1] * 1e-4 if rng.random() < 0.5 else 0
        )
        made.rows.append([a, a + k - 1])
    made.times = np.maximum.accumulate(times)


def plant_stamps(made: Made, rng: Rng) -> None:
    """Times of a writer."""
    step = 1 / made.rate
    if rng.random() < 0.6:
        late = rng.exponential(rng.uniform(0.4, 1.0) * step, len(made.times))
        made.times = np.maximum.accumulate(made.times + late)
    else:
        grid = step * rng.uniform(1.3, 2.5)
        made.times = np.ceil(made.times / grid) * grid


def plant_dead(made: Made, rng: Rng) -> None:
    """Channels that never change."""
    own = some(made, rng)
    level = 0 if rng.random() < 0.5 else np.median(made.values[:, own], axis=0)
    made.values[:, own] = level


def plant_stuck(made: Made, rng: Rng) -> None:
    """Channels that stop."""
    own = some(made, rng, 2)
    count = len(made.times)
    a = int(rng.integers(count // 8, count // 2))
    b = count if rng.random() < 0.5 else a + int(rng.integers(count // 5, count // 3))
    if made.silent:  # while it is touched
        far = np.flatnonzero(made.values[a : count - 200, own[0]] > 20)
        later = int(far[0]) if len(far) else 0
        a, b = a + later, min(b + later, count)
        own = own[:1]
    made.values[a:b, own] = made.values[a, own]
    made.channels, made.rows = set(own.tolist()), [[a, b - 1]]


def plant_noisy(made: Made, rng: Rng) -> None:
    """Channels with more noise."""
    own = some(made, rng, 2)
    size = max(made.noise, 0.5 if made.values.dtype.kind in "iu" else 0.1) * rng.uniform(7, 20)
    with changing(made) as changed:
        changed[:, own] += rng.normal(0, size, (len(made.times), len(own)))


def rounded(made: Made, values: NDArray[np.float64]) -> NDArray[Any]:
    """Values of the type that a recording had."""
    kind = made.values.dtype
    if kind.kind == "f":
        return np.rint(values) if (made.values == np.rint(made.values)).all() else values
    limits = np.iinfo(kind)
    return np.clip(np.rint(values), limits.min, limits.max).astype(kind)


@contextmanager
def changing(made: Made) -> Iterator[NDArray[np.float64]]:
    """Values as numbers, to be changed in place; the recording has them in its own type."""
    changed = made.values.astype(float)
    yield changed
    made.values = rounded(made, changed)


def plant_clipped(made: Made, rng: Rng) -> None:
    """Readings cut off at a value."""
    values = made.values.astype(float)
    base = np.median(values, axis=0)
    reach = (made.sign * (values - base)).max(axis=0)
    level = np.sort(reach)[::-1][min(3, len(reach) - 1)] * rng.uniform(0.35, 0.7)
    value = float(np.rint(np.median(base) + made.sign * level))
    cut = np.minimum(values, value) if made.sign > 0 else np.maximum(values, value)
    hit = (cut != values).sum(axis=0) >= 5
    made.values = rounded(made, cut)
    made.channels, made.value = set(np.flatnonzero(hit).tolist()), value
    if made.values.dtype.kind == "f" and value not in made.values:
        made.values = cut


def plant_quantised(made: Made, rng: Rng) -> None:
    """Channels with coarse steps."""
    own = some(made, rng)
    step = (4 if made.values.dtype.kind in "iu" else max(4 * made.noise, 2)) * rng.choice([1, 2])
    step = float(np.rint(step)) if (made.values == np.rint(made.values)).all() else step
    with changing(made) as changed:
        changed[:, own] = np.rint(changed[:, own] / step) * step


def plant_repeated_id(made: Made, rng: Rng) -> None:
    """An id given twice."""
    ids = np.arange(made.values.shape[1])
    a, b = rng.choice(ids, 2, False)
    ids[a] = ids[b]
    made.more["ids"], made.channels = ids, {int(a), int(b)}


def plant_copied(made: Made, rng: Rng) -> None:
    """A channel with the values of its neighbour."""
    own = touched_channels(made)
    a = int(rng.choice(own))
    b = a + 1 if a + 1 < made.values.shape[1] else a - 1
    made.values[:, b] = made.values[:, a]
    made.channels = {a, b}


def plant_sign(made: Made, rng: Rng) -> None:
    """Channels with their sign turned."""
    own = some(made, rng, 2)
    if made.values.dtype.kind == "u":
        made.values = made.values.astype(np.int32)
    with changing(made) as changed:
        base = 0.0 if made.silent else np.median(changed[:, own], axis=0)
        changed[:, own] = 2 * base - changed[:, own]


def plant_module(made: Made, rng: Rng) -> None:
    """A module that hangs."""
    count, width = made.values.shape
    k = int(min(rng.choice([6, 10, 12, 16]), width // 2))
    first = int(rng.integers(0, width - k + 1))
    a = int(rng.integers(count // 8, count // 2))
    b = a + int(rng.integers(count // 5, count // 3))
    if made.silent:
        busy = (made.values[a : count - 300, first : first + k] > 15).sum(axis=1)
        a, b = a + int(np.argmax(busy)), b + int(np.argmax(busy))
    made.values[a:b, first : first + k] = made.values[a, first : first + k]
    made.channels, made.rows = set(range(first, first + k)), [[a, min(b, count) - 1]]


def plant_thermal(made: Made, rng: Rng) -> None:
    """Temperatures among the taxels."""
    own = some(made, rng, 3)
    t = np.linspace(0, 1, len(made.times))
    spread = max(12 * made.noise, 10.0)
    with changing(made) as changed:
        for c in own:
            course = spread * rng.uniform(1, 3) * (t if rng.random() < 0.5 else 1 - np.exp(-4 * t))
            noise = rng.normal(0, made.noise * 0.3, len(t))
            changed[:, c] = np.median(changed[:, c]) + course + noise


def plant_drift(made: Made, rng: Rng) -> None:
    """A rest that moves slowly."""
    t = np.linspace(0, 1, len(made.times))
    own = all_or_some(made, rng)
    size = shift_of(made, rng)
    course = t if rng.random() < 0.5 else (1 - np.exp(-3 * t))
    with changing(made) as changed:
        changed[:, own] += (size * course)[:, None] * (1 if made.silent else rng.choice([-1, 1]))


def plant_rest(made: Made, rng: Rng) -> None:
    """Another rest from a row on."""
    count = len(made.times)
    own = all_or_some(made, rng)
    a = int(rng.integers(count // 4, 3 * count // 4))
    with changing(made) as changed:
        changed[a:, own] += shift_of(made, rng)
    made.rows = [[a, count - 1]]


def all_or_some(made: Made, rng: Rng) -> NDArray[np.int64]:
    """All channels, or a few, which it notes."""
    if rng.random() < 0.5:
        return np.arange(made.values.shape[1])
    return some(made, rng)


def shift_of(made: Made, rng: Rng) -> float:
    """How far a rest moves: beyond noise, by less than touches reach."""
    values = made.values.astype(float)
    reach = np.percentile(np.abs(values - np.median(values, axis=0)).max(axis=0), 70)
    return float(reach * rng.uniform(0.15, 0.4) + 8 * made.noise)


def plant_leak(made: Made, rng: Rng) -> None:
    """Sessions or resting patterns that name the label."""
    labels = made.more["labels"]
    kinds = sorted(set(labels))
    if rng.random() < 0.5:
        made.more["sessions"] = tuple(f"day {kinds.index(one)}" for one in labels)
        return
    events = made.more["events"]
    size = 6 * made.noise + 0.03 * np.ptp(made.values.astype(float))
    pattern = rng.normal(0, size, (len(kinds), made.values.shape[1]))
    level = np.zeros(made.values.shape)
    bounds = [0] + [int(np.flatnonzero(events == k)[-1]) + 1 for k in range(len(labels))]
    for k, label in enumerate(labels):
        level[bounds[k] : bounds[k + 1]] = pattern[kinds.index(label)]
    with changing(made) as changed:
        changed += np.abs(level) if made.silent else level


def plant_labels(made: Made, rng: Rng) -> None:
    """Labels where nothing was felt."""
    events, labels = made.more["events"].copy(), list(made.more["labels"])
    quiet = [a for a in range(20, len(events) - 60, 7) if (events[a - 8 : a + 45] < 0).all()]
    made.rows = []
    for a in rng.permutation(quiet)[:3].tolist():
        if (events[a - 8 : a + 45] >= 0).any():
            continue
        events[a : a + 25] = len(labels)
        labels.append("poke")
        made.rows.append([a, a + 24])
    made.more |= {"events": events, "labels": tuple(labels)}


PLANTS: dict[str, Callable[[Made, Rng], None]] = {
    name[6:]: one for name, one in globals().items() if name.startswith("plant_")
}


def track(made: Made, name: str = "planted") -> Track:
    """As the command reads it."""
    return Track(name, made.values, made.times, **made.more)


def meets(found: Finding, made: Made) -> bool:
    """Whether a finding is the planted one, at its place."""
    if found.kind != made.kind:
        return False
    if made.channels is not None and found.channels is not None:
        share = len(made.channels & set(found.channels)) / len(made.channels | set(found.channels))
        if share < 0.5:
            return False
    elif (made.channels is None) != (found.channels is None) and made.kind in ("drift", "rest"):
        return made.channels is None and len(found.channels or ()) > 0.5 * made.values.shape[1]
    if made.rows and found.rows:
        near = 0.03 * len(made.times)
        if not any(a <= d + near and c <= b + near for a, b in made.rows for c, d in found.rows):
            return False
    return made.value is None or abs(found.value - made.value) < 0.51  # type: ignore[operator]


def run(recordings: int, seed: int, only: str = "") -> dict[str, Any]:
    """Found and false findings of each kind, and what was missed."""
    names = [only] if only else [*PLANTS]
    found, planted, false = Counter[str](), Counter[str](), Counter[str]()
    clean = {"recordings": 0, "findings": 0}
    missed = []
    for number in range(recordings):
        rng = np.random.default_rng([seed, number])
        made = sheet(rng)
        if only or number % 7 < 6:
            made.kind = names[(number - number // 7) % len(names)]
            PLANTS[made.kind](made, rng)
        result, _ = examine_tracks([track(made)])
        several = result.files[0].findings
        if made.kind:
            right = any(meets(one, made) for one in several)
            planted[made.kind] += 1
            found[made.kind] += right
            false.update(f"{one.kind} in {made.kind}" for one in several if one.kind != made.kind)
        else:
            right = not several
            clean["recordings"] += 1
            clean["findings"] += len(several)
        if not right:
            missed.append([number, made.kind or "clean", [one.text for one in several][:3]])
    kinds = {kind: f"{found[kind]}/{count}" for kind, count in sorted(planted.items())}
    return {"found": kinds, "clean": clean, "other": dict(false.most_common(25)), "missed": missed}


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--recordings", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", default="")
    asked = parser.parse_args()
    print(json.dumps(run(asked.recordings, asked.seed, asked.kind), indent=1))
