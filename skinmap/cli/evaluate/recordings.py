"""Recordings, cross-validated: by event, and with sessions, people, places and parts left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skinmap.cli.evaluate.evaluation import (
    BLUE,
    GREY,
    Figure,
    Rows,
    Settings,
    by_class,
    chosen_gestures,
    percent,
)
from skinmap.cli.evaluate.result.recordings import LeakRow, LeftOutRow, RecordingsResult
from skinmap.cli.evaluate.result.shared import AccuracyRow
from skinmap.commands.progress import progress
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.report.figure import plain_figure, save_figure
from skinmap.report.result import given
from skinmap.report.table import Table

if TYPE_CHECKING:
    from skinmap.classify.protocols.left_out import Control, LeftOutTrial
    from skinmap.cli.collection import Collected, Collection


def work(settings: Settings) -> RecordingsResult:
    """Judge classifiers on touches that were recorded."""
    from skinmap.classify.classifier import DEFAULT, classifiers
    from skinmap.classify.protocols.recordings import KINDS, evaluate_recordings
    from skinmap.cli.collection import collect

    collection = collect(settings.recordings, settings.robot, settings.parts)
    only = () if settings.gestures in ("four", "all") else _labels(settings)
    chosen = judged_touches(collection, only)
    grouped = bool(settings.leave_out) or settings.leaks
    names = settings.names or ((DEFAULT,) if grouped else classifiers.names())
    with progress(len(names) * len(KINDS) * settings.seeds, "recordings") as advance:
        found = evaluate_recordings(
            [one.touch for one in chosen],
            names=names,
            seeds=settings.all_seeds,
            folds=settings.folds,
            optional=not settings.names,
            workers=settings.workers,
            progress=advance,
        )
    labels = [one.touch.label for one in chosen]
    people = {name: count for name, count in collection.count("person").items() if name}
    return RecordingsResult(
        robot=", ".join(dict.fromkeys(robot for robot, _ in collection.skins)),
        parts=list(collection.parts),
        recordings=[str(path) for path in settings.recordings],
        folds=settings.folds,
        seeds=settings.all_seeds,
        touches={label: labels.count(label) for label in dict.fromkeys(sorted(labels))},
        table=[AccuracyRow(**row) for row in found["table"]],
        leak=[LeakRow(**row) for row in found["leak"]],
        left_out=judge_groups(settings, chosen, names) if grouped else [],
        sessions=collection.count("session"),
        people=people,
        warnings=list(collection.doubts()),
        skipped=found["skipped"],
    )


def _labels(settings: Settings) -> tuple[str, ...]:
    """Labels asked for, given or by default; `eight` are those of the simulator."""
    if settings.gestures == "eight":
        return chosen_gestures(settings)
    return tuple(name.strip() for name in settings.gestures.split(","))


def judged_touches(collection: Collection, only: Sequence[str]) -> list[Collected]:
    """The touches with one label each that were asked for; several at once are left out.

    Raises
    ------
    InvalidArrayError
        Touches without a label, labels that differ in spelling only, or no touch at all.
    UnknownNameError
        A label that nobody recorded.
    """
    from skinmap.classify.protocols.recordings import TOGETHER, check_spelling

    for one in collection.touches:
        if not one.touch.label.strip():
            raise InvalidArrayError(f"a touch of {one.part!r} in {one.file} has no label")
    found = [one for one in collection.touches if TOGETHER not in one.touch.label]
    known = sorted({one.touch.label for one in found})
    if not known:
        raise InvalidArrayError(
            "no marked touch in the recordings; mark them with `skinmap record --label` or "
            "`skinmap label`"
        )
    check_spelling(known)
    for name in only:
        if name not in known:
            raise UnknownNameError("recorded gesture", name, known)
    return [one for one in found if not only or one.touch.label in only]


def judge_groups(
    settings: Settings, chosen: Sequence[Collected], names: Sequence[str]
) -> list[LeftOutRow]:
    """A row for touches dealt out and for each kind of group left out, of each classifier."""
    from skinmap.classify.protocols.left_out import (
        NAIVE,
        Judged,
        LeftOutTrial,
        places_of,
        run_left_out,
    )
    from skinmap.parallel.run import run_tasks

    touches = tuple(one.touch for one in chosen)
    groups = {
        "session": np.array([one.session for one in chosen]),
        "person": np.array([one.person for one in chosen]),
        "part": np.array([f"{one.robot} {one.part}" for one in chosen]),
    }
    if "place" in settings.leave_out:
        groups["place"] = places_of(touches)
    judged = Judged(
        touches, groups, tuple(one.before for one in chosen), tuple(one.first for one in chosen)
    )
    trials = [
        LeftOutTrial(name, judged, way, settings.folds, settings.seed, settings.leaks)
        for name in names
        for way in (NAIVE, *dict.fromkeys(settings.leave_out))
    ]
    found = run_tasks(run_left_out, trials, workers=settings.workers)
    return [_row(trial, one) for trial, one in zip(trials, found, strict=True)]


def _row(trial: LeftOutTrial, found: dict[str, Any]) -> LeftOutRow:
    from skinmap.classify.protocols.left_out import meaning_of

    judged = trial.judged
    own = judged.groups.get(trial.way)
    meaning, verdict = None, found.get("reason", "")
    if trial.leaks and not verdict:
        sessions, labels = judged.groups["session"], judged.labels
        alone = [
            str(label)
            for label in np.unique(labels)
            if len(np.unique(sessions[labels == label])) == 1
        ]
        meaning, verdict = meaning_of(found, trial.way, judged, alone)
    return LeftOutRow(
        classifier=trial.classifier,
        left_out=trial.way,
        groups=len(judged.touches) if own is None else len(np.unique(own)),
        per_class=found.get("per_class", {}),
        mean=found.get("mean"),
        right=found.get("right"),
        chance=judged.chance,
        control=_known(found.get("control")),
        first=_known(found.get("first")),
        raw=_known(found.get("raw")),
        meaning=meaning,
        verdict=verdict,
    )


def _known(control: Control | None) -> float | None:
    return None if control is None or control.share != control.share else control.share


def lines(result: RecordingsResult) -> Iterator[str | Table]:
    """The tables of a result."""
    touches = ", ".join(f"{count} {name}" for name, count in result.touches.items())
    yield f"{touches} on {', '.join(result.parts)}; {result.folds} folds; in %"
    classes = list(result.touches)
    rows: Rows = [
        [
            row.classifier,
            row.folds,
            *by_class(row, classes),
            percent(row.mean),
            percent(given(row.std)),
        ]
        for row in result.table
    ]
    yield Table(["classifier", "folds", *classes, "mean", "std"], rows)
    if result.left_out:
        yield from _left_out(result)
    for leak in result.leak:
        yield f"plain folds flatter {leak.classifier} by {leak.points:.1f} points"
    for name, why in result.skipped.items():
        yield f"{name} was left out: {why}"


def _left_out(result: RecordingsResult) -> Iterator[str | Table]:
    classes = list(result.touches)
    rows: Rows = [
        [
            row.classifier, row.left_out, *(percent(row.per_class.get(name)) for name in classes),
            percent(row.mean), percent(row.control), percent(row.first), percent(row.raw),
            percent(row.chance), row.meaning or "",
        ]
        for row in result.left_out
        if row.mean is not None
    ]  # fmt: skip
    head = ["classifier", "left out", *classes, "mean", "before", "first", "raw before", "chance"]
    yield Table([*head, "means something"], rows)
    for row in result.left_out:
        if row.verdict:
            yield f"{row.classifier}, {row.left_out}: {row.verdict}"
    for warning in result.warnings:
        yield f"warning: {warning}"


def leak_figure(result: RecordingsResult, path: Path) -> None:
    """Accuracy of each classifier, plain folds beside folds by event."""
    names = list(dict.fromkeys(row.classifier for row in result.table))
    figure = plain_figure((2.5 + 1.1 * len(names), 4.6))
    axis = figure.subplots()
    for shift, (kind, colour) in enumerate((("event", BLUE), ("plain", GREY))):
        rows = [row for row in result.table if row.folds == kind]
        place = np.arange(len(names)) + 0.38 * (shift - 0.5)
        values = [100.0 * row.mean for row in rows]
        spread = [100.0 * (given(row.std) or 0.0) for row in rows]
        axis.bar(place, values, 0.36, yerr=spread, color=colour, label=f"{kind} folds")
    axis.set_xticks(range(len(names)), names, rotation=30, ha="right")
    axis.set_ylabel("mean of the classes [%]")
    axis.set_ylim(0.0, 100.0)
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper right", ncols=2)
    save_figure(figure, path)


FIGURES: dict[str, Figure] = {"leak.png": leak_figure}
