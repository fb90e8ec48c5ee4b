"""`skinmap evaluate --protocol time`: names, directions, speeds and counts of touches in time."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from skinmap.cli.evaluate.evaluation import chosen_gestures
from skinmap.cli.evaluate.result.in_time import SeenRow, StrokesRow, TimeResult
from skinmap.commands.options import open_robot
from skinmap.commands.progress import progress

if TYPE_CHECKING:
    from skinmap.classify.protocols.in_time import InTime
    from skinmap.cli.evaluate.evaluation import Settings
    from skinmap.live.contacts.stroke_errors import StrokeError

TRAININGS = 8  # of a seed


def work(settings: Settings) -> TimeResult:
    """Run the protocol.

    Raises
    ------
    InvalidArrayError
        Fewer than two parts.
    """
    from skinmap.classify.protocols.in_time import evaluate_in_time, play
    from skinmap.classify.protocols.physics import OURS
    from skinmap.live.contacts.stroke_errors import stroke_errors
    from skinmap.physics.variants import DEFAULT, FROZEN
    from skinmap.touch.gestures import TIME
    from skinmap.touch.prepared_skin import PreparedSkin

    if settings.names:
        raise click.UsageError("--protocol time judges the default classifier: no --classifier")
    gestures = TIME if settings.gestures == "four" else chosen_gestures(settings)
    loaded, parts = open_robot(settings.robot or "icub", settings.parts)
    sizes: dict[int, str] = {}  # mirror images on both sides of the test would flatter
    for part in parts:
        sizes.setdefault(len(loaded.skin(part)), part)
    skins = {part: PreparedSkin(loaded.skin(part)) for part in sizes.values()}
    physics, skipped = [OURS], {}
    if find_spec("mujoco"):
        physics += [DEFAULT, FROZEN]
    else:
        skipped["mujoco"] = "not installed: pip install 'skinmap[mujoco]'"
    found: list[InTime] = []
    errors: dict[str, list[StrokeError]] = {one: [] for one in physics}
    steps = settings.seeds * (TRAININGS + len(physics) * len(skins))
    with progress(steps, "time") as advance:
        shared: dict[str, Any] = {"workers": settings.workers, "progress": advance}
        for seed in settings.all_seeds:
            played = play(skins, physics, gestures, settings.per_gesture, seed, **shared)
            for one in played:
                errors[one.physics] += stroke_errors(one.skin, one.recording)
            found.append(evaluate_in_time(played, gestures=gestures, seed=seed, **shared))
    rows = _rows(found)
    best = {(row.features, row.seen): row.mean for row in rows if row.tested_on == OURS}
    return TimeResult(
        robot=loaded.name,
        parts=list(skins),
        gestures=list(gestures),
        per_gesture=settings.per_gesture,
        seeds=settings.all_seeds,
        rows=rows,
        strokes=[strokes_row(name, own) for name, own in errors.items()],
        presses_right={one: _mean([each.counted[one] for each in found]) for one in physics},
        still_alone=float(np.mean([one.still_alone for one in found])),
        still_together=float(np.mean([one.still_together for one in found])),
        gained_points=100.0 * (best["and motion", 1.0] - best["contact geometry", 1.0]),
        half_seen=best["and motion", 0.5] / best["and motion", 1.0],
        skipped=skipped,
    )


def _rows(found: Sequence[InTime]) -> list[SeenRow]:
    """Every row of the first repetition, with the touches of all."""
    rows = []
    for number, first in enumerate(found[0].rows):
        counts = np.sum([one.rows[number].judged.counts for one in found], axis=0)
        labels = first.judged.labels
        total = counts.sum(axis=1)
        share = np.diagonal(counts) / np.maximum(total, 1)
        per_class = {
            name: float(right) for name, right, n in zip(labels, share, total, strict=True) if n
        }
        rows.append(
            SeenRow(
                features=first.features,
                tested_on=first.judged.tested_on,
                seen=first.seen,
                mean=float(np.mean(list(per_class.values()))),
                per_class=per_class,
                confusion={
                    label: dict(zip((*labels, "no_contact"), map(int, row), strict=True))
                    for label, row in zip(labels, counts, strict=True)
                },
            )
        )
    return rows


def strokes_row(physics: str, errors: Sequence[StrokeError]) -> StrokesRow:
    """Medians of the errors of strokes."""

    def median(values: Sequence[float]) -> float | None:
        known = [value for value in values if np.isfinite(value)]
        return float(np.median(known)) if known else None

    return StrokesRow(
        physics=physics,
        strokes=len(errors),
        speed=median([abs(one.speed) for one in errors]),
        speed_bias=median([one.speed for one in errors]),
        direction_deg=median([one.direction for one in errors]),
        length=median([abs(one.length) for one in errors]),
        within=_mean([one.within for one in errors]),
    )


def _mean(values: Sequence[float]) -> float | None:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else None
