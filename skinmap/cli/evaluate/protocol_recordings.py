"""Recordings, cross-validated: by event, and with sessions, people, places and parts left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from skinmap.cli.collection import Collected, Collection, collect
from skinmap.cli.evaluate.command import Evaluation, Folds, Settings, chosen_gestures
from skinmap.errors import InvalidArrayError, check_known
from skinmap.recognition.classifier import DEFAULT, classifiers
from skinmap.recognition.protocols.folds import run_repeats
from skinmap.recognition.protocols.recordings import (
    KINDS,
    NAIVE,
    Judged,
    check_spelling,
    evaluate_recordings,
    places_of,
    run_left_out,
)
from skinmap.recognition.protocols.results import AccuracyRow, LeftOutRow, RecordingsResult
from skinmap.report.table import Table
from skinmap.touch.recording import JOIN


def work(settings: Settings) -> RecordingsResult:
    """Judge classifiers on touches that were recorded."""
    collection = collect(settings.recordings, settings.robot, settings.parts)
    only = () if settings.own.gestures in ("four", "all") else _labels(settings)
    chosen = judged_touches(collection, only)
    names = settings.names or ((DEFAULT,) if settings.leave_out else classifiers.names())
    with settings.working(len(names) * len(KINDS) * settings.seeds, "recordings") as shared:
        table, leak, skipped = evaluate_recordings(
            [one.touch for one in chosen],
            names=names,
            seeds=settings.all_seeds,
            folds=settings.own.folds,
            optional=not settings.names,
            **shared,
        )
    labels = [one.touch.label for one in chosen]
    people = {name: count for name, count in collection.count("person").items() if name}
    return RecordingsResult(
        robot=", ".join(dict.fromkeys(robot for robot, _ in collection.skins)),
        parts=list(collection.parts),
        recordings=[str(path) for path in settings.recordings],
        folds=settings.own.folds,
        seeds=settings.all_seeds,
        touches={label: labels.count(label) for label in dict.fromkeys(sorted(labels))},
        table=table,
        leak=leak,
        left_out=judge_groups(settings, chosen, names) if settings.leave_out else [],
        sessions=collection.count("session"),
        people=people,
        warnings=list(collection.doubts()),
        skipped=skipped,
    )


def _labels(settings: Settings) -> tuple[str, ...]:
    """Labels asked for, given or by default; `eight` are those of the simulator."""
    if settings.own.gestures == "eight":
        return chosen_gestures(settings)
    return tuple(name.strip() for name in settings.own.gestures.split(","))


def judged_touches(collection: Collection, only: Sequence[str]) -> list[Collected]:
    """The touches with one label each that were asked for; several at once are left out.

    Raises
    ------
    InvalidArrayError
        Touches without a label, labels that differ in spelling only, or no touch at all.
    UnknownNameError
        A label that nobody recorded.
    """
    for one in collection.touches:
        if not one.touch.label.strip():
            raise InvalidArrayError(f"a touch of {one.part!r} in {one.file} has no label")
    found = [one for one in collection.touches if JOIN not in one.touch.label]
    known = sorted({one.touch.label for one in found})
    if not known:
        raise InvalidArrayError(
            "no marked touch in the recordings; mark them with `skinmap record --label` or "
            "`skinmap label`"
        )
    check_spelling(known)
    check_known("recorded gesture", only, known)
    return [one for one in found if not only or one.touch.label in only]


def judge_groups(
    settings: Settings, chosen: Sequence[Collected], names: Sequence[str]
) -> list[LeftOutRow]:
    """A row for touches dealt out and for each kind of group left out, of each classifier."""
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
        {"classifier": name, "way": way}
        for name in names
        for way in dict.fromkeys((NAIVE, *settings.leave_out))
    ]
    shared = {"judged": judged, "folds": settings.own.folds, "seed": settings.seed}
    return run_repeats(run_left_out, trials, workers=settings.workers, **shared)


def lines(result: RecordingsResult) -> Iterator[str | Table]:
    """The tables of a result."""
    touches = ", ".join(f"{count} {name}" for name, count in result.touches.items())
    yield f"{touches} on {', '.join(result.parts)}; {result.folds} folds; in %"
    shown = "classifier folds per_class mean:%" + " std:%" * (len(result.seeds) > 1)
    yield Table.of(AccuracyRow, result.table, shown, classes=list(result.touches))
    if result.left_out:
        yield from _left_out(result)
    for leak in result.leak:
        way = "flatter" if leak.points >= 0.0 else "are harder on"
        yield f"plain folds {way} {leak.classifier} by {abs(leak.points):.1f} points"
    for name, why in result.skipped.items():
        yield f"{name} was not judged: {why}"


def _left_out(result: RecordingsResult) -> Iterator[str | Table]:
    shown = (
        "classifier left_out per_class mean:% right:%=all control:%=before first:% raw:% chance:% "
        "meaning:s=sound"
    )
    judged = [row for row in result.left_out if row.mean is not None]
    yield Table.of(LeftOutRow, judged, shown, classes=list(result.touches))
    yield "mean: of the labels; all: of all touches. Controls, near chance where nothing leaks:"
    yield "before, first: named before the touches, from the first samples; raw: bare values before"
    for row in result.left_out:
        if row.verdict:
            yield f"{row.classifier}, {row.left_out}: {row.verdict}"
    for warning in result.warnings:
        yield f"warning: {warning}"


EVALUATIONS = {"recordings": Evaluation(work, lines, Folds)}
