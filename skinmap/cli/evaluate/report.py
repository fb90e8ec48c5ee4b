"""What `skinmap evaluate` says to people, and what it writes into `--out`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from skinmap.cli.evaluate.result import EvaluateResult
from skinmap.cli.evaluate.result.baxter import BaxterResult
from skinmap.cli.evaluate.result.cross_patch import CrossPatchResult
from skinmap.cli.evaluate.result.in_time import TimeResult
from skinmap.cli.evaluate.result.kaspar import KasparResult, SweepRow
from skinmap.cli.evaluate.result.physics import PhysicsResult
from skinmap.cli.evaluate.result.real_skin import FingersResult, HandsResult
from skinmap.cli.evaluate.result.recordings import RecordingsResult
from skinmap.cli.evaluate.result.shared import AccuracyRow
from skinmap.cli.evaluate.result.social_touch import CostResult
from skinmap.report.image import media
from skinmap.report.page import lines_page
from skinmap.report.result import given, plain
from skinmap.report.table import Cell, Table

Rows = list[list[Cell]]


def lines(result: EvaluateResult) -> Iterator[str | Table]:
    """The tables of a result."""
    if isinstance(result, KasparResult):
        return _kaspar(result)
    if isinstance(result, CrossPatchResult):
        return _cross_patch(result)
    if isinstance(result, PhysicsResult):
        return _physics(result)
    if isinstance(result, TimeResult):
        return _time(result)
    if isinstance(result, CostResult):
        return _cost(result)
    if isinstance(result, FingersResult):
        return _fingers(result)
    if isinstance(result, HandsResult):
        return _hands(result)
    return _baxter(result) if isinstance(result, BaxterResult) else _recordings(result)


def write(result: EvaluateResult, stage: Path) -> Iterator[str]:
    """Write the result as JSON and its pictures; names of the files."""
    from skinmap.cli.evaluate import figures

    numbers = {key: value for key, value in plain(result).items() if key != "files"}
    text = json.dumps(numbers, indent=2, allow_nan=False) + "\n"
    (stage / "evaluation.json").write_text(text, encoding="utf-8")
    yield "evaluation.json"
    if isinstance(result, KasparResult):
        figures.kaspar_figure(result, stage / "kaspar.png")
        figures.sweep_figure(result.sweep, stage / "sweep.png")
        yield from ("kaspar.png", "sweep.png")
    elif isinstance(result, CrossPatchResult):
        figures.patches_figure(result, stage / "patches.png")
        yield "patches.png"
    elif isinstance(result, TimeResult):
        figures.time_figure(result, stage / "time.png")
        yield "time.png"
    elif isinstance(result, FingersResult):
        figures.fingers_figure(result, stage / "fingers.png")
        yield "fingers.png"
    elif isinstance(result, HandsResult):
        figures.hands_figure(result, stage / "hands.png")
        yield "hands.png"
    elif isinstance(result, RecordingsResult):
        figures.leak_figure(result, stage / "leak.png")
        yield "leak.png"


def report(result: EvaluateResult, stage: Path) -> str:
    """The page, with the pictures that were written."""
    pictures = [media(path, path.stem) for path in sorted(stage.glob("*.png"))]
    return lines_page(f"{result.robot}: evaluation, {result.protocol}", lines(result), pictures)


def _percent(value: float | None) -> str:
    return "" if value is None or value != value else f"{100 * value:.1f}"


def _kaspar(result: KasparResult) -> Iterator[str | Table]:
    yield (
        f"{result.robot} {result.part}, {result.taxels} taxels, {len(result.seeds)} seeds, "
        f"touches {result.places} (simulated); accuracy in %"
    )
    classes = list(result.samples)
    named = [(row.folds, row) for row in result.table] + [("paper", row) for row in result.paper]
    rows: Rows = [
        [
            f"{row.percent} %", folds, row.features, row.classifier, *_by_class(row, classes),
            _percent(row.mean), _percent(given(row.std)),
        ]
        for folds, row in named
    ]  # fmt: skip
    yield Table(["percent", "folds", "features", "classifier", *classes, "mean", "std"], rows)
    yield "\ncarry-over between patches with other numbers of taxels, 10 %, by event"
    rows = [
        [
            row.features,
            _percent(row.same),
            _percent(row.other),
            _percent(row.worst),
            " > ".join(row.worst_pair),
        ]
        for row in result.carry_over.summary
    ]
    yield Table(["features", "same patch", "other patches", "worst", "worst pair"], rows)
    if result.sweep:
        yield "\nradius and codewords a structure, 10 %, by event"
        yield _sweep(result.sweep)


def _by_class(row: AccuracyRow, classes: Sequence[str]) -> list[str]:
    return [_percent(row.per_class.get(name)) for name in classes]


def _sweep(found: Sequence[SweepRow]) -> Table:
    words = list(dict.fromkeys(row.words for row in found))
    radii = list(dict.fromkeys(row.radius_mm for row in found))
    cells = {(row.radius_mm, row.words): row for row in found}
    rows: Rows = [
        [f"{r:g}", cells[r, words[0]].structures, *(_percent(cells[r, k].mean) for k in words)]
        for r in radii
    ]
    return Table(["r [mm]", "structures", *(f"k = {k}" for k in words)], rows)


def _cross_patch(result: CrossPatchResult) -> Iterator[str | Table]:
    where = f"trained on {result.train_robot}" if result.train_robot else "leave one patch out"
    yield (
        f"{result.robot}, {len(result.patches)} patches, {where}, {len(result.seeds)} seeds "
        "(simulated); accuracy in % of touches"
    )
    classes = list(result.gestures)
    rows: Rows = [
        [
            row.features, row.classifier, _percent(row.mean), _percent(row.worst),
            row.worst_patch, *(_percent(row.per_class.get(name)) for name in classes),
        ]
        for row in result.rows
    ]  # fmt: skip
    yield Table(["features", "classifier", "mean", "worst", "worst patch", *classes], rows)


def _physics(result: PhysicsResult) -> Iterator[str | Table]:
    yield (
        f"{result.robot}, {len(result.parts)} parts in two hands, {len(result.seeds)} seeds "
        f"(simulated by us and by MuJoCo; nothing is trained on {result.frozen!r}); "
        "accuracy in % of touches"
    )
    rows: Rows = [
        [
            row.trained_on, row.tested_on, _percent(row.mean), f"{row.ece:.3f}",
            _percent(row.held), row.set_size,
            *(_percent(row.per_class.get(name)) for name in result.gestures),
        ]
        for row in result.rows
    ]  # fmt: skip
    yield Table(
        ["trained on", "tested on", "mean", "ece", "held", "set size", *result.gestures], rows
    )


def _fingers(result: FingersResult) -> Iterator[str | Table]:
    total = sum(result.recordings.values())
    told = ", ".join(f"{count} of {number}" for number, count in result.recordings.items())
    yield (
        f"{result.robot}, {result.taxels} taxels: {total} recordings of real fingers ({told}); "
        f"each taxel's own rest taken away; in %, majority {_percent(result.majority)}"
    )
    if result.unplaced or result.unrecorded:
        yield (
            f"{result.unplaced} channels have no place, {result.unrecorded} taxels no channel: "
            "left out"
        )
    rows: Rows = [
        [
            row.method, _percent(row.exact), _percent(row.within_one), _percent(row.spread),
            _percent(row.control), _percent(row.control_within_one),
        ]
        for row in (result.live, result.width, result.chosen, result.trained)
    ]  # fmt: skip
    head = ["fingers counted by", "exact", "within one", "std", "control", "within one"]
    yield Table(head, rows)
    yield (
        f"control: the same on the first {result.first_samples} samples of each recording; width: "
        f"one finger up to {result.narrow_mm:.1f} mm, one more for each {result.finger_mm:.1f} mm"
    )


def _hands(result: HandsResult) -> Iterator[str | Table]:
    low, high = result.contacts_quartiles
    quiet = "none" if result.quiet_contacts is None else f"{result.quiet_contacts:.2f}"
    yield (
        f"{result.robot}, {result.taxels} taxels: {result.grasping} of {result.samples} samples "
        "of real hands grasp it"
    )
    rows: Rows = [
        ["contacts of the live tracker, median", f"{result.contacts_median:g}"],
        ["quartiles", f"{low:g} to {high:g}"],
        ["connected active taxels, specks and all, median", f"{result.pieces_median:g}"],
        ["contacts of a single taxel, mean", f"{result.single_taxels:.2f}"],
        ["control: contacts of the untouched skin, mean", quiet],
        ["flipped triangles of the flat map", result.flips],
        ["its edge error [%]", f"{result.edge_error_percent:.2f}"],
    ]
    yield Table(["of a grasping hand", ""], rows)
    if result.hand_or_not:
        names: Rows = [
            [row.method, _percent(row.mean), _percent(row.spread)] for row in result.hand_or_not
        ]
        yield Table(["hand or not, grasps left out", "mean", "std"], names)
    for name, why in result.skipped.items():
        yield f"{name} was left out: {why}"


def _time(result: TimeResult) -> Iterator[str | Table]:
    yield (
        f"{result.robot}, {len(result.parts)} parts in two hands, each touched by people of its "
        f"own, {len(result.seeds)} seeds (simulated); accuracy in % of touches"
    )
    rows: Rows = [
        [
            row.features, row.tested_on, f"{100 * row.seen:.0f} %", _percent(row.mean),
            *(_percent(row.per_class.get(name)) for name in result.gestures),
        ]
        for row in result.rows
    ]  # fmt: skip
    yield Table(["features", "tested on", "seen", "mean", *result.gestures], rows)
    yield (
        f"\nmotion adds {result.gained_points:.1f} points; half of a touch gives "
        f"{100 * result.half_seen:.0f} % of the accuracy of all of it; still gestures: "
        f"{_percent(result.still_alone)} alone, {_percent(result.still_together)} beside these"
    )
    yield "\nstrokes of 5 cm or more, medians of the errors"
    rows = [
        [
            row.physics, row.strokes, _percent(row.speed), _percent(row.speed_bias),
            "" if row.direction_deg is None else f"{row.direction_deg:.1f}",
            _percent(row.length), _percent(row.within),
            _percent(result.presses_right.get(row.physics)),
        ]
        for row in result.strokes
    ]  # fmt: skip
    heads = ["speed %", "bias %", "direction deg", "way %", "within 2 errors %", "taps counted %"]
    yield Table(["physics", "strokes", *heads], rows)
    for name, why in result.skipped.items():
        yield f"{name} was left out: {why}"


def _cost(result: CostResult) -> Iterator[str | Table]:
    yield (
        f"{result.captures} captures of {len(result.gestures)} gestures by {result.subjects} "
        f"subjects, {result.classifier}; named right in %"
    )
    rows: list[list[Cell]] = [
        [
            row.variant,
            row.left_out,
            row.captures,
            *map(_percent, (row.right, row.first, row.chance)),
        ]
        for row in result.rows
    ]
    yield Table(["variant", "left out", "captures", "right", "first samples", "chance"], rows)
    for row in result.rows:
        if row.reason:
            yield f"{row.variant}, {row.left_out}: {row.reason}"
    for what, share in result.published.items():
        yield f"published, subjects left out, {what}: {100 * share:.0f} %"


def _recordings(result: RecordingsResult) -> Iterator[str | Table]:
    touches = ", ".join(f"{count} {name}" for name, count in result.touches.items())
    yield f"{touches} on {', '.join(result.parts)}; {result.folds} folds; in %"
    classes = list(result.touches)
    rows: Rows = [
        [
            row.classifier,
            row.folds,
            *_by_class(row, classes),
            _percent(row.mean),
            _percent(given(row.std)),
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
            row.classifier, row.left_out, *(_percent(row.per_class.get(name)) for name in classes),
            _percent(row.mean), _percent(row.control), _percent(row.first), _percent(row.raw),
            _percent(row.chance), row.meaning or "",
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


def _baxter(result: BaxterResult) -> Iterator[str | Table]:
    yield (
        f"{result.robot} {result.part}, {result.images} images of {result.touches} touches "
        f"(simulated), {result.repeats} splits 70/30; mean of the diagonal in %"
    )
    rows: Rows = []
    for name in ("bovw", "cnn", "raw_rbf"):
        method = given(getattr(result, name))
        if method is None or given(method.missing) is not None:
            continue
        for split, one in (("by touch", method), ("plain", method.plain)):
            rows.append([name, split, _percent(one.mean), _percent(one.min), _percent(one.max)])
    yield Table(["method", "split", "mean", "min", "max"], rows)
