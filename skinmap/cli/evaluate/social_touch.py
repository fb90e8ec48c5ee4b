"""The protocol `cost`: the Corpus of Social Touch, which users bring."""

from __future__ import annotations

from collections.abc import Iterator

import click

from skinmap.cli.evaluate.evaluation import (
    Figure,
    Rows,
    Settings,
    percent,
)
from skinmap.cli.evaluate.result.social_touch import CostResult, CostRow
from skinmap.commands.progress import progress
from skinmap.report.table import Table


def work(settings: Settings) -> CostResult:
    """Read the corpus and judge one classifier as its authors did."""
    from skinmap.classify.classifier import DEFAULT, classifiers
    from skinmap.classify.protocols.cost import PUBLISHED, evaluate_cost
    from skinmap.io.recordings.cost import cost_skin, read_cost
    from skinmap.touch.prepared_skin import PreparedSkin

    if len(settings.recordings) != 1 or len(settings.names) > 1:
        raise click.UsageError("--protocol cost takes one file, CoST.csv, and one --classifier")
    name = settings.names[0] if settings.names else DEFAULT
    classifiers.get(name)
    (recording,) = read_cost(settings.recordings[0])
    with progress(8, "cost") as advance:
        found = evaluate_cost(
            recording,
            PreparedSkin(cost_skin()),
            classifier=name,
            folds=settings.folds,
            seed=settings.seed,
            workers=settings.workers,
            progress=advance,
        )
    rows = [
        CostRow(
            variant=one["variant"],
            left_out="subject" if one["left_out"] == "person" else "capture",
            captures=one["captures"],
            right=one.get("right"),
            first=None if "first" not in one or one["first"].share != one["first"].share
            else one["first"].share,
            chance=one["chance"],
            reason=one.get("reason", ""),
        )
        for one in found
    ]  # fmt: skip
    return CostResult(
        robot="CoST",
        file=str(settings.recordings[0]),
        classifier=name,
        captures=len(recording.labels),
        subjects=len(set(recording.people)),
        gestures=sorted(set(recording.labels)),
        seed=settings.seed,
        rows=rows,
        published=dict(PUBLISHED),
    )


def lines(result: CostResult) -> Iterator[str | Table]:
    """The tables of a result."""
    yield (
        f"{result.captures} captures of {len(result.gestures)} gestures by {result.subjects} "
        f"subjects, {result.classifier}; named right in %"
    )
    rows: Rows = [
        [
            row.variant,
            row.left_out,
            row.captures,
            *map(percent, (row.right, row.first, row.chance)),
        ]
        for row in result.rows
    ]
    yield Table(["variant", "left out", "captures", "right", "first samples", "chance"], rows)
    for row in result.rows:
        if row.reason:
            yield f"{row.variant}, {row.left_out}: {row.reason}"
    for what, share in result.published.items():
        yield f"published, subjects left out, {what}: {100 * share:.0f} %"


FIGURES: dict[str, Figure] = {}
