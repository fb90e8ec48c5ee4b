"""`skinmap evaluate --protocol cross-patch`: trained on other patches, or on another robot."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from skinmap.cli.evaluate.evaluation import (
    Figure,
    Rows,
    Settings,
    chosen_gestures,
    percent,
)
from skinmap.cli.evaluate.result.cross_patch import CrossPatchResult, PatchesRow
from skinmap.commands.options import open_robot
from skinmap.commands.progress import progress
from skinmap.report.figure import plain_figure, save_figure
from skinmap.report.table import Table

if TYPE_CHECKING:
    from skinmap.classify.protocols.patches import Patch


def work(settings: Settings) -> CrossPatchResult:
    """Run the protocol."""
    from skinmap.classify.protocols.cross_patch import (
        DEFAULTS,
        check_carries_over,
        leave_one_out,
        summarise,
        transfer,
    )
    from skinmap.classify.protocols.patches import touch_patches

    names = settings.names or DEFAULTS
    check_carries_over(names)
    gestures = chosen_gestures(settings)
    test = _patches(settings.robot or "icub", settings.parts)
    train = _patches(settings.train_robot, ()) if settings.train_robot else None
    if train is None and len(test) < 2:
        raise click.UsageError(
            f"leaving one patch out needs two patches, got {test[0].name}; give --train-robot"
        )
    steps = len(test) + (len(train) if train else 0) + len(names) * (1 if train else len(test))
    found = []
    with progress(settings.seeds * steps, "cross-patch") as advance:
        shared: dict[str, Any] = {"workers": settings.workers, "progress": advance}
        for seed in settings.all_seeds:
            simulated: dict[str, Any] = {
                "seed": seed,
                "gestures": gestures,
                "per_gesture": settings.per_gesture,
                **shared,
            }
            tested = touch_patches(test, **simulated)
            if train is None:
                found.append(leave_one_out(tested, names=names, seed=seed, **shared))
                continue
            trained = touch_patches(train, **{**simulated, "seed": [seed, 1]})
            found.append(transfer(trained, tested, names=names, seed=seed, **shared))
    rows = [summarise(name, [one[k] for one in found]) for k, name in enumerate(names)]
    return CrossPatchResult(
        robot=settings.robot or "icub",
        train_robot=settings.train_robot,
        gestures=list(gestures),
        per_gesture=settings.per_gesture,
        seeds=settings.all_seeds,
        patches={patch.name: len(patch.skin) for patch in test},
        rows=[PatchesRow(**row) for row in rows],
    )


def _patches(robot: str, parts: tuple[str, ...]) -> list[Patch]:
    from skinmap.classify.protocols.patches import cut_patches

    loaded, names = open_robot(robot, parts)
    return cut_patches(loaded, names)


def lines(result: CrossPatchResult) -> Iterator[str | Table]:
    """The tables of a result."""
    where = f"trained on {result.train_robot}" if result.train_robot else "leave one patch out"
    yield (
        f"{result.robot}, {len(result.patches)} patches, {where}, {len(result.seeds)} seeds "
        "(simulated); accuracy in % of touches"
    )
    classes = list(result.gestures)
    rows: Rows = [
        [
            row.features, row.classifier, percent(row.mean), percent(row.worst),
            row.worst_patch, *(percent(row.per_class.get(name)) for name in classes),
        ]
        for row in result.rows
    ]  # fmt: skip
    yield Table(["features", "classifier", "mean", "worst", "worst patch", *classes], rows)


def patches_figure(result: CrossPatchResult, path: Path) -> None:
    """Accuracy of each classifier on each patch."""
    patches = list(result.patches)
    rows = result.rows
    values = np.array([[100.0 * row.per_patch[name] for name in patches] for row in rows])
    figure = plain_figure((max(2.8 + 0.45 * len(patches), 6.5), 2.8 + 0.55 * len(rows)))
    axis = figure.subplots()
    image = axis.imshow(values, cmap="viridis", vmin=0.0, vmax=100.0, aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        colour = "white" if value < 60.0 else "black"
        axis.text(column, row, f"{value:.0f}", ha="center", va="center", color=colour, fontsize=8)
    names = [f"{name} ({result.patches[name]})" for name in patches]
    axis.set_xticks(range(len(patches)), names, rotation=60, ha="right", fontsize=8)
    labels = [f"{row.features}: {100 * row.mean:.1f}" for row in rows]
    axis.set_yticks(range(len(rows)), labels)
    trained = result.train_robot
    how = f"trained on {trained}" if trained else "trained on all other patches"
    figure.suptitle(
        f"{result.robot}: touches named right on each patch [%]\n{how} (simulated)", fontsize=11
    )
    figure.colorbar(image, ax=axis, pad=0.01)
    save_figure(figure, path)


FIGURES: dict[str, Figure] = {"patches.png": patches_figure}
