"""How wrong direction and speed of strokes are whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.live.contacts.contact_motion import MotionBook
from skinmap.live.contacts.contact_tracker import ContactTracker
from skinmap.live.robot_skin import JoinedSkin
from skinmap.touch.contacts.rest import felt
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording, TrueMotion

STROKES = ("stroke", "slide")
LEAST = 0.05  # shorter ways are not judged [m]
LAG = 0.1  # a velocity is compared with the true one of the time before [s]


@dataclass(frozen=True, slots=True)
class StrokeError:
    """Of one stroke.

    Attributes
    ----------
    speed : float
        Measured over true, less 1; -1 where no motion was seen.
    direction : float
        Median angle between velocities and true ones, while it goes [deg]; NaN where none was seen.
    length : float
        Measured over true, less 1.
    within : float
        Share of the velocities that are wrong by no more than twice their stated error.
    """

    speed: float
    direction: float
    length: float
    within: float


def stroke_errors(skin: PreparedSkin, recording: Recording) -> list[StrokeError]:
    """Follow every stroke of 5 cm or more, sample by sample, as live; all contacts are its own."""
    joined, rest = JoinedSkin({skin.skin.part: skin}), recording.rest()
    found = []
    for (event, label, samples), own in zip(recording.touches(), recording.rows(), strict=True):
        truth = recording.motions[event] if recording.motions else None
        if label not in STROKES or truth is None or truth.length < LEAST:
            continue
        rows = felt(samples, rest, skin.geometry.beside).astype(np.float64)
        found.append(_followed(joined, recording.times[own], rows, truth))
    return found


def _followed(
    joined: JoinedSkin, times: FloatArray, rows: FloatArray, truth: TrueMotion
) -> StrokeError:
    tracker, book = ContactTracker(joined), MotionBook(joined)
    seen: list[FloatArray] = []
    for time, pressures in zip(times.tolist(), rows, strict=True):
        tracker.update(time, pressures)
        tracks = tracker.present
        book.update(time, {0: tracks} if tracks else {}, pressures)
        now = book.motion(0, 0, tracks[0].normal) if tracks else None
        if now is not None and np.isfinite(now.error):
            seen.append(np.array([time, *now.velocity, now.error]))
    if 0 not in book.ways or not seen:
        return StrokeError(-1.0, float("nan"), -1.0, float("nan"))
    way, table = book.ways[0], np.array(seen)
    speed, length = way.speed / truth.speed - 1.0, way.length / truth.length - 1.0
    true, known = _true_velocities(truth, table[:, 0] - LAG)
    table, true = table[known], true[known]
    if len(table) == 0:
        return StrokeError(speed, float("nan"), length, float("nan"))
    lengths = np.linalg.norm(table[:, 1:4], axis=1) * np.linalg.norm(true, axis=1)
    cosine = np.einsum("ij,ij->i", table[:, 1:4], true) / np.maximum(lengths, 1e-12)
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    wrong = np.linalg.norm(table[:, 1:4] - true, axis=1)
    within = float((wrong <= 2.0 * table[:, 4]).mean())
    return StrokeError(speed, float(np.median(angle)), length, within)


def _true_velocities(truth: TrueMotion, at: FloatArray) -> tuple[FloatArray, IntArray]:
    """True velocities (k, 3) at times (k,), and which of them are of a hand that goes evenly."""
    middle = 0.5 * (truth.times[1:] + truth.times[:-1])
    velocity = np.diff(truth.places, axis=0) / np.diff(truth.times)[:, None]
    found = np.column_stack([np.interp(at, middle, one) for one in velocity.T])
    speed = np.linalg.norm(found, axis=1)
    known = (at >= middle[0]) & (at <= middle[-1]) & (speed > 0.5 * truth.speed)
    return found, np.flatnonzero(known)
