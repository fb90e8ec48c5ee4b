"""`skinmap evaluate --protocol cross-patch`: trained on other patches, or on another robot.

`skinmap evaluate --protocol physics`: trained in one physics, tested in another.

`skinmap evaluate --protocol time`: names, directions, speeds and counts of touches in time.

Errors of direction and speed are those of strokes whose truth is known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from typing import Any, NamedTuple

import click
import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.cli.evaluate.command import Evaluation, Gestures, Rows, Settings, chosen_gestures
from skinmap.commands.options import open_robot
from skinmap.live.contacts.contact_motion import MotionBook
from skinmap.live.contacts.contact_tracker import ContactTracker
from skinmap.live.robot_skin import JoinedSkin
from skinmap.physics.pressing import import_mujoco
from skinmap.physics.variants import DEFAULT, FROZEN, TUNING, VARIANTS
from skinmap.recognition.protocols import results, transfer
from skinmap.report.table import Table
from skinmap.rows import percent
from skinmap.skin.checks import twin_parts
from skinmap.touch.contacts.rest import felt
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording, TrueMotion
from skinmap.touch.simulation.gestures import TIME


class CrossPatch(Gestures):
    """Which other robot trains."""

    train_robot: str | None = None


def judge_cross_patch(settings: Settings) -> results.CrossPatchResult:
    """Run the protocol."""
    names, other = settings.names or transfer.DEFAULTS, settings.own.train_robot
    transfer.check_carries_over(names)
    gestures = chosen_gestures(settings)
    test = transfer.cut_patches(*open_robot(settings.robot or "icub", settings.parts))
    train = transfer.cut_patches(*open_robot(other, ())) if other else []
    if not train and len(test) < 2:
        raise click.UsageError(
            f"leaving one patch out needs two patches, got {test[0].name}; "
            "give --set train_robot=ROBOT"
        )
    steps = len(test) + len(train) + len(names) * (1 if train else len(test))
    found = []
    with settings.working(settings.seeds * steps, "cross-patch") as shared:
        play = {"per_gesture": settings.per_gesture, "variety": settings.variety, **shared}
        for seed in settings.all_seeds:
            tested = transfer.touch_patches(test, seed=seed, gestures=gestures, **play)
            trained = None
            if train:
                trained = transfer.touch_patches(train, seed=[seed, 1], gestures=gestures, **play)
            found.append(transfer.score_patches(tested, trained, names=names, seed=seed, **shared))
    return results.CrossPatchResult(
        robot=settings.robot or "icub",
        train_robot=other,
        gestures=list(gestures),
        per_gesture=settings.per_gesture,
        **settings.drawn,
        patches={patch.name: len(patch.skin) for patch in test},
        rows=[transfer.summarise(name, [one[k] for one in found]) for k, name in enumerate(names)],
    )


def cross_patch_lines(result: results.CrossPatchResult) -> Iterator[str | Table]:
    """The tables of a result."""
    where = f"trained on {result.train_robot}" if result.train_robot else "leave one patch out"
    yield (
        f"{result.robot}, {len(result.patches)} patches, {where}, {len(result.seeds)} seeds "
        "(simulated); accuracy in % of touches"
    )
    shown = "features classifier mean:% worst:% worst_patch per_class"
    yield Table.of(results.PatchesRow, result.rows, shown, classes=result.gestures)


def judge_physics(settings: Settings) -> results.PhysicsResult:
    """Run the protocol."""
    if len(settings.names) > 1:
        raise click.UsageError("--protocol physics judges one classifier: name it once")
    import_mujoco()
    classifier = settings.names[0] if settings.names else transfer.CLASSIFIER
    transfer.check_carries_over((classifier,))
    loaded, parts = open_robot(settings.robot or "icub", settings.parts)
    skins = {part: PreparedSkin(loaded.skin(part)) for part in parts}
    tested = set(transfer.mirror_pairs(skins).values())
    how = {"per_gesture": settings.per_gesture, **settings.drawn}
    gestures = list(chosen_gestures(settings))
    # Touches of each physics; for each part a training of each physics, and one without each.
    worlds = 1 + len(VARIANTS)
    touches = len(VARIANTS) * len(tested) + len(skins)
    trainings = len(tested) * (1 + len(TUNING) + worlds)
    with settings.working(settings.seeds * (touches + trainings), "physics") as shared:
        rows = transfer.evaluate_physics(
            skins, gestures=gestures, classifier=classifier, **how, **shared
        )
    return results.PhysicsResult(
        robot=loaded.name,
        parts=list(skins),
        classifier=classifier,
        gestures=gestures,
        frozen=FROZEN,
        rows=rows,
        **how,
    )


def physics_lines(result: results.PhysicsResult) -> Iterator[str | Table]:
    """The tables of a result."""
    yield (
        f"{result.robot}, {len(result.parts)} parts in two hands, {len(result.seeds)} seeds "
        f"(simulated by us and by MuJoCo; nothing is trained on {result.frozen!r}); "
        "accuracy in % of touches"
    )
    shown = "trained_on tested_on mean:% ece:.3f held:% set_size per_class"
    yield Table.of(results.PhysicsRow, result.rows, shown, classes=result.gestures)


TRAININGS = 8  # of a seed


def judge_time(settings: Settings) -> results.TimeResult:
    """Run the protocol.

    Raises
    ------
    InvalidArrayError
        Fewer than two parts.
    """
    if settings.names:
        raise click.UsageError("--protocol time judges the default classifier: no --classifier")
    gestures = TIME if settings.own.gestures == "four" else chosen_gestures(settings)
    loaded, parts = open_robot(settings.robot or "icub", settings.parts)
    # Mirror images on both sides of the test would flatter.
    firsts = twin_parts({part: loaded.skin(part) for part in parts})
    skins = {part: PreparedSkin(loaded.skin(part)) for part in dict.fromkeys(firsts.values())}
    physics, skipped = [transfer.OURS], {}
    if find_spec("mujoco"):
        physics += [DEFAULT, FROZEN]
    else:
        skipped["mujoco"] = "not installed: pip install 'skinmap[mujoco]'"
    errors: dict[str, list[StrokeError]] = {one: [] for one in physics}
    steps = settings.seeds * (TRAININGS + len(physics) * len(skins))
    with settings.working(steps, "time") as shared:
        how = {**shared, "variety": settings.variety}
        played = {
            seed: transfer.play(skins, physics, gestures, settings.per_gesture, seed, **how)
            for seed in settings.all_seeds
        }
        found = transfer.evaluate_in_time(played, gestures=gestures, **shared)
    for one in (one for own in played.values() for one in own):
        errors[one.physics] += stroke_errors(one.skin, one.recording)
    best = {
        (row.features, row.seen): row.mean for row in found.rows if row.tested_on == transfer.OURS
    }
    return results.TimeResult(
        robot=loaded.name,
        parts=list(skins),
        gestures=list(gestures),
        per_gesture=settings.per_gesture,
        **settings.drawn,
        rows=found.rows,
        strokes=[strokes_row(name, own) for name, own in errors.items()],
        presses_right=dict(found.counted),
        still_alone=found.still_alone,
        still_together=found.still_together,
        gained_points=100.0 * (best["and motion", 1.0] - best["contact geometry", 1.0]),
        half_seen=best["and motion", 0.5] / best["and motion", 1.0],
        skipped=skipped,
    )


def strokes_row(physics: str, errors: Sequence[StrokeError]) -> results.StrokesRow:
    """Medians of the errors of strokes."""

    def of(values: Sequence[float], how: Callable[..., Any] = np.median) -> float | None:
        known = [value for value in values if np.isfinite(value)]
        return float(how(known)) if known else None

    return results.StrokesRow(
        physics=physics,
        strokes=len(errors),
        speed=of([abs(one.speed) for one in errors]),
        speed_bias=of([one.speed for one in errors]),
        direction_deg=of([one.direction for one in errors]),
        length=of([abs(one.length) for one in errors]),
        within=of([one.within for one in errors], np.mean),
    )


def time_lines(result: results.TimeResult) -> Iterator[str | Table]:
    """The tables of a result."""
    yield (
        f"{result.robot}, {len(result.parts)} parts in two hands, each touched by people of its "
        f"own, {len(result.seeds)} seeds (simulated); accuracy in % of touches"
    )
    shown = "features tested_on seen:.0% mean:% per_class"
    yield Table.of(results.SeenRow, result.rows, shown, classes=result.gestures)
    yield (
        f"\nmotion adds {result.gained_points:.1f} points; half of a touch gives "
        f"{100 * result.half_seen:.0f} % of the accuracy of all of it; still gestures: "
        f"{percent(result.still_alone)} alone, {percent(result.still_together)} beside these"
    )
    yield "\nstrokes of 5 cm or more, medians of the errors"
    table = Table.of(
        results.StrokesRow,
        result.strokes,
        "physics strokes speed:%=speed_% speed_bias:%=bias_% direction_deg:.1f=direction_deg "
        "length:%=way_% within:%=within_2_errors_%",
    )
    taps = [percent(result.presses_right.get(row.physics)) for row in result.strokes]
    rows: Rows = [[*cells, one] for cells, one in zip(table.rows, taps, strict=True)]
    yield Table([*table.columns, "taps counted %"], rows)
    for name, why in result.skipped.items():
        yield f"{name} was left out: {why}"


EVALUATIONS = {
    "cross-patch": Evaluation(judge_cross_patch, cross_patch_lines, CrossPatch),
    "physics": Evaluation(judge_physics, physics_lines, Gestures),
    "time": Evaluation(judge_time, time_lines, Gestures),
}


STROKES = ("stroke", "slide")
LEAST = 0.05  # shorter ways are not judged [m]
LAG = 0.1  # a velocity is compared with the true one of the time before [s]


class StrokeError(NamedTuple):
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
