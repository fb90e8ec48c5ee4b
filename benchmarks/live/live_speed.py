"""One sample of a whole robot to its labels: pressures, contacts, touches, names."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import skinmap
from benchmarks.harness.timing import quartiles
from skinmap.classify.classifier import classifiers
from skinmap.classify.descriptors import Touch
from skinmap.classify.named_classifiers import default_model
from skinmap.classify.naming import name_touches
from skinmap.live.loop import TouchLoop
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import StreamInfo
from skinmap.touch.contacts import ACTIVE
from skinmap.touch.gestures import TIME
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulator import simulate


def live_rows(quick: bool) -> list[dict[str, Any]]:
    """One sample of a whole robot to its labels: all parts, two of them touched at once."""
    robot = skinmap.load_robot("icub")
    parts = ("torso", "right_forearm") if quick else tuple(robot.parts)
    skins = {part: PreparedSkin(robot.skin(part)) for part in parts}
    rng = np.random.default_rng(2)
    touched = ("torso", "right_forearm")
    train = []
    for part in touched:
        recording = simulate(skins[part].skin, rng=rng, per_gesture=8 if quick else 16)
        train += [Touch(skins[part], samples, label) for _, label, samples in recording.touches()]
    played = {part: simulate(skins[part].skin, rng=rng, per_gesture=4) for part in touched}
    tracks = {part: recording.pressures for part, recording in played.items()}
    # The middle of each touch: a sample of a hand at rest on the skin.
    middles = {
        part: [samples[len(samples) // 2] for _, _, samples in recording.touches()]
        for part, recording in played.items()
    }
    steps = min(100 if quick else 600, *(len(track) for track in tracks.values()))
    rows = []
    for name in ("contact-geometry", "histogram"):
        model = classifiers.get(name)().fit(train, rng=rng)
        if name == "histogram":
            for skin in skins.values():
                model.descriptor.counter(skin, compiled=True)  # type: ignore[attr-defined]
        row = {"classifier": name, **_live_row(robot, model, skins, tracks, steps)}
        for count in (1, 2):
            some = {part: middles[part] for part in touched[:count]}
            row[f"one_sample_alone_{count}_touched_ms"] = _alone(model, skins, some)
        rows.append(row)
    return rows


def in_time_rows(quick: bool) -> list[dict[str, Any]]:
    """The same with the model that comes with Skinmap, while one part or five are touched in time.

    Of each sample in which so many touches are felt, contacts and names of the touches so far.
    """
    robot = skinmap.load_robot("icub")
    model = default_model()
    rng = np.random.default_rng(2)
    rows = []
    for count in (1,) if quick else (1, 5):
        parts = ("torso", "right_forearm", "left_arm", "left_leg_upper", "right_leg_upper")[:count]
        skins = {part: PreparedSkin(robot.skin(part)) for part in (parts if quick else robot.parts)}
        tracks = {
            part: simulate(skins[part].skin, rng=rng, gestures=TIME, per_gesture=1).pressures
            for part in parts
        }
        steps = min(100 if quick else 10_000, *(len(track) for track in tracks.values()))
        row = _live_row(robot, model, skins, tracks, steps, count)
        rows.append({"touches": count, **row})
    return rows


def _alone(
    model: Any, skins: dict[str, PreparedSkin], middles: dict[str, list[Any]]
) -> dict[str, Any]:
    """One sample of all parts, without a past, to the labels of all touches in it."""
    rest = {part: np.zeros(len(skin), np.uint8) for part, skin in skins.items()}
    times: list[float] = []
    for _ in range(3):  # the first time warms up
        times = []
        for samples in zip(*middles.values(), strict=False):
            now = {**rest, **dict(zip(middles, samples, strict=True))}
            start = time.process_time()
            for part, sample in now.items():
                if sample.max() > ACTIVE:
                    name_touches(model, skins[part], sample[None])
            times.append((time.process_time() - start) * 1e3)
    cost = np.array(times)
    p95 = float(np.percentile(cost, 95))
    return {"mean": float(cost.mean()), "p95": p95, "quartiles": quartiles(cost)}


def _live_row(
    robot: Any,
    model: Any,
    skins: dict[str, PreparedSkin],
    tracks: dict[str, Any],
    steps: int,
    several: int = 0,
) -> dict[str, Any]:
    """CPU of each step; that while touched is of those with so many touches, where said."""
    values = np.concatenate(
        [
            tracks[part][:steps] if part in tracks else np.zeros((steps, len(skin)), np.uint8)
            for part, skin in skins.items()
        ],
        axis=1,
    )
    info = StreamInfo("benchmark", tuple(skins), tuple(map(len, skins.values())), 50.0)
    source = Playback(info, np.arange(steps) / 50.0, values, speed=float("inf"))
    loop = TouchLoop(robot, source, classifier=model, skins=skins)
    times: list[float] = []
    touches: list[int] = []
    for _ in range(2):  # the first time warms up
        loop.seek(0.0)
        times, touches = [], []
        for _ in range(steps):
            start = time.process_time()
            moment = loop.step(1.0)
            times.append((time.process_time() - start) * 1e3)
            touches.append(0 if moment is None else len(moment.touches))
    cost, felt = np.array(times), np.array(touches)
    count = np.where(felt == several, felt, 0) if several else felt
    while_touched = cost[count > 0]
    return {
        "taxels": sum(len(skin) for skin in skins.values()),
        "parts": len(skins),
        "samples": steps,
        "share_of_samples_with_a_named_touch": float((count > 0).mean()),
        "mean_ms": float(cost.mean()),
        "mean_ms_while_touched": float(while_touched.mean()) if len(while_touched) else None,
        "median_ms_while_touched": float(np.median(while_touched)) if len(while_touched) else None,
        "median_ms": float(np.median(cost)),
        "p95_ms": float(np.percentile(cost, 95)),
        "worst_ms": float(cost.max()),
    }
