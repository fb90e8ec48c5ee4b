"""`skinmap evaluate --protocol time`: names, directions, speeds and counts of touches in time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from skinmap.cli.evaluate.evaluation import (
    BLUE,
    COLOURS,
    GREY,
    Figure,
    Rows,
    Settings,
    chosen_gestures,
    percent,
)
from skinmap.cli.evaluate.result.in_time import SeenRow, StrokesRow, TimeResult
from skinmap.commands.options import open_robot
from skinmap.commands.progress import progress
from skinmap.report.figure import plain_figure, save_figure
from skinmap.report.table import Table

if TYPE_CHECKING:
    from skinmap.classify.protocols.in_time import InTime
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


def lines(result: TimeResult) -> Iterator[str | Table]:
    """The tables of a result."""
    yield (
        f"{result.robot}, {len(result.parts)} parts in two hands, each touched by people of its "
        f"own, {len(result.seeds)} seeds (simulated); accuracy in % of touches"
    )
    rows: Rows = [
        [
            row.features, row.tested_on, f"{100 * row.seen:.0f} %", percent(row.mean),
            *(percent(row.per_class.get(name)) for name in result.gestures),
        ]
        for row in result.rows
    ]  # fmt: skip
    yield Table(["features", "tested on", "seen", "mean", *result.gestures], rows)
    yield (
        f"\nmotion adds {result.gained_points:.1f} points; half of a touch gives "
        f"{100 * result.half_seen:.0f} % of the accuracy of all of it; still gestures: "
        f"{percent(result.still_alone)} alone, {percent(result.still_together)} beside these"
    )
    yield "\nstrokes of 5 cm or more, medians of the errors"
    rows = [
        [
            row.physics, row.strokes, percent(row.speed), percent(row.speed_bias),
            "" if row.direction_deg is None else f"{row.direction_deg:.1f}",
            percent(row.length), percent(row.within),
            percent(result.presses_right.get(row.physics)),
        ]
        for row in result.strokes
    ]  # fmt: skip
    heads = ["speed %", "bias %", "direction deg", "way %", "within 2 errors %", "taps counted %"]
    yield Table(["physics", "strokes", *heads], rows)
    for name, why in result.skipped.items():
        yield f"{name} was left out: {why}"


def time_figure(result: TimeResult, path: Path) -> None:
    """Accuracy against the share of a touch seen, and by gesture with and without motion."""
    figure = plain_figure((11.0, 4.6))
    course, bars = figure.subplots(1, 2, width_ratios=(1.0, 1.4))
    for number, key in enumerate(dict.fromkeys((r.features, r.tested_on) for r in result.rows)):
        own = [row for row in result.rows if (row.features, row.tested_on) == key]
        seen, mean = [100 * row.seen for row in own], [100 * row.mean for row in own]
        course.plot(seen, mean, "o-", color=COLOURS[number % 5], label=", ".join(key))
    course.set_xlabel("seen of the touch [%]")
    course.set_ylabel("mean of the classes [%], simulated")
    course.set_ylim(0.0, 100.0)
    course.legend(fontsize=8, frameon=False)
    whole = [row for row in result.rows if row.seen == 1.0 and row.tested_on == "ours"]
    place = np.arange(len(result.gestures))
    for shift, (row, colour) in enumerate(zip(whole, (GREY, BLUE), strict=False)):
        values = [100.0 * row.per_class.get(name, 0.0) for name in result.gestures]
        bars.bar(place + 0.38 * (shift - 0.5), values, 0.36, color=colour, label=row.features)
    bars.set_xticks(place, result.gestures, rotation=30, ha="right")
    bars.set_ylim(0.0, 100.0)
    bars.legend(fontsize=8, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    for axis in (course, bars):
        axis.spines[["top", "right"]].set_visible(False)
    figure.suptitle(f"{result.robot}: touches in time, parts and people left out")
    save_figure(figure, path)


FIGURES: dict[str, Figure] = {"time.png": time_figure}
