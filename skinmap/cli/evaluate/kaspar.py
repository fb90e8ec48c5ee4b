"""`skinmap evaluate --protocol kaspar`: the features and classifiers of the first paper."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from skinmap.cli.evaluate.evaluation import (
    COLOURS,
    Figure,
    Rows,
    Settings,
    by_class,
    percent,
)
from skinmap.cli.evaluate.result.kaspar import (
    CarryOver,
    CarryRow,
    CarrySummary,
    KasparResult,
    SweepRow,
)
from skinmap.cli.evaluate.result.shared import AccuracyRow
from skinmap.commands.options import open_robot
from skinmap.commands.progress import progress
from skinmap.report.figure import plain_figure, save_figure
from skinmap.report.result import given
from skinmap.report.table import Table


def work(settings: Settings) -> KasparResult:
    """Run the protocol."""
    from skinmap.classify.protocols import kaspar, sweep
    from skinmap.classify.protocols.carry_over import evaluate_carry_over
    from skinmap.touch.prepared_skin import PreparedSkin

    if settings.names:
        raise click.UsageError("--protocol kaspar has its own classifiers: no --classifier")
    name = settings.robot or kaspar.ROBOT
    loaded, parts = open_robot(name, settings.parts)
    part = settings.parts[0] if settings.parts else kaspar.PART
    if not settings.parts and name != kaspar.ROBOT:
        raise click.UsageError(f"which part of {name}? --part {' | '.join(loaded.parts)}")
    sizes: dict[int, str] = {}  # one part of each size: mirror images would only cost time
    for one in (part, *parts):
        sizes.setdefault(len(loaded.skin(one)), one)
    skins = {one: PreparedSkin(loaded.skin(one)) for one in sizes.values()}
    seeds = settings.all_seeds
    with progress((3 if settings.sweep else 2) * len(seeds), "kaspar") as advance:
        shared: dict[str, Any] = {
            "seeds": seeds,
            "workers": settings.workers,
            "progress": advance,
        }
        shared["samples"] = kaspar.SAMPLES
        most = max(kaspar.PERCENTS)
        table = kaspar.evaluate_kaspar(
            skins[part], percents=kaspar.PERCENTS, places=settings.places, **shared
        )
        others = evaluate_carry_over(skins, percent=most, **shared)
        swept = []
        if settings.sweep:
            swept = sweep.sweep_radius_and_words(
                skins[part], radii=sweep.RADII, words=sweep.WORDS, percent=most, **shared
            )
    carry_over = CarryOver(
        percent=others["percent"],
        summary=[CarrySummary(**row) for row in others["summary"]],
        rows=[CarryRow(**row) for row in others["rows"]],
        left_out=others["left_out"],
    )
    return KasparResult(
        robot=loaded.name,
        part=part,
        taxels=len(skins[part]),
        places=settings.places,
        seeds=seeds,
        samples=kaspar.SAMPLES,
        table=[AccuracyRow(**row) for row in table],
        paper=[AccuracyRow(**row) for row in kaspar.paper_rows()],
        carry_over=carry_over,
        sweep=[SweepRow(**row) for row in swept],
    )


def lines(result: KasparResult) -> Iterator[str | Table]:
    """The tables of a result."""
    yield (
        f"{result.robot} {result.part}, {result.taxels} taxels, {len(result.seeds)} seeds, "
        f"touches {result.places} (simulated); accuracy in %"
    )
    classes = list(result.samples)
    named = [(row.folds, row) for row in result.table] + [("paper", row) for row in result.paper]
    rows: Rows = [
        [
            f"{row.percent} %", folds, row.features, row.classifier, *by_class(row, classes),
            percent(row.mean), percent(given(row.std)),
        ]
        for folds, row in named
    ]  # fmt: skip
    yield Table(["percent", "folds", "features", "classifier", *classes, "mean", "std"], rows)
    yield "\ncarry-over between patches with other numbers of taxels, 10 %, by event"
    rows = [
        [
            row.features,
            percent(row.same),
            percent(row.other),
            percent(row.worst),
            " > ".join(row.worst_pair),
        ]
        for row in result.carry_over.summary
    ]
    yield Table(["features", "same patch", "other patches", "worst", "worst pair"], rows)
    if result.sweep:
        yield "\nradius and codewords a structure, 10 %, by event"
        yield _sweep(result.sweep)


def _sweep(found: Sequence[SweepRow]) -> Table:
    words = list(dict.fromkeys(row.words for row in found))
    radii = list(dict.fromkeys(row.radius_mm for row in found))
    cells = {(row.radius_mm, row.words): row for row in found}
    rows: Rows = [
        [f"{r:g}", cells[r, words[0]].structures, *(percent(cells[r, k].mean) for k in words)]
        for r in radii
    ]
    return Table(["r [mm]", "structures", *(f"k = {k}" for k in words)], rows)


def kaspar_figure(result: KasparResult, path: Path) -> None:
    """Accuracy by features, plain folds beside folds by event, the paper's as lines."""
    percents = list(dict.fromkeys(row.percent for row in result.table))
    figure = plain_figure((5.6 * len(percents), 5.0))
    axes = figure.subplots(1, len(percents), sharey=True, squeeze=False)[0]
    for axis, share in zip(axes, percents, strict=True):
        rows = [row for row in result.table if row.percent == share]
        kinds = list(dict.fromkeys(row.folds for row in rows))
        pairs = list(dict.fromkeys((row.features, row.classifier) for row in rows))
        for number, (features, classifier) in enumerate(pairs):
            own = [row for row in rows if (row.features, row.classifier) == pairs[number]]
            place = np.arange(len(kinds)) + 0.16 * (number - (len(pairs) - 1) / 2)
            values = [100.0 * row.mean for row in own]
            spread = [100.0 * (given(row.std) or 0.0) for row in own]
            label = f"{features}, {classifier}"
            axis.bar(place, values, 0.15, yerr=spread, color=COLOURS[number % 5], label=label)
        for row in result.paper:
            if row.percent == share:
                style = "-" if row.features == "histogram" else "--"
                text = f"paper: {row.features}, plain folds, real touches"
                axis.axhline(100.0 * row.mean, color="black", lw=1.0, ls=style, label=text)
        axis.set_xticks(range(len(kinds)), [f"{kind} folds" for kind in kinds])
        axis.set_title(f"{share} % of the samples")
        axis.set_ylim(25.0, 100.0)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("mean of the classes [%], simulated")
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8
    )
    figure.suptitle(f"{result.robot} {result.part}: four touches, 4 folds")
    save_figure(figure, path)


def sweep_figure(result: KasparResult, path: Path) -> None:
    """Accuracy over radius and codewords, a number in each cell."""
    rows = result.sweep
    words = list(dict.fromkeys(row.words for row in rows))
    radii = list(dict.fromkeys(row.radius_mm for row in rows))
    cells = {(row.radius_mm, row.words): row for row in rows}
    values = np.array([[100.0 * cells[r, k].mean for k in words] for r in radii])
    figure = plain_figure((7.6, 4.6))
    axis = figure.subplots()
    image = axis.imshow(values, cmap="viridis", aspect="auto")
    middle = 0.5 * (values.min() + values.max())
    for (row, column), value in np.ndenumerate(values):
        spread = cells[radii[row], words[column]].std
        text = f"{value:.1f}\n± {100.0 * spread:.1f}" if spread else f"{value:.1f}"
        colour = "white" if value < middle else "black"
        axis.text(column, row, text, ha="center", va="center", color=colour, fontsize=8)
    axis.set_xticks(range(len(words)), [str(k) for k in words])
    labels = [
        f"{r:g} mm ({cells[r, words[0]].neighbours}, {cells[r, words[0]].structures})"
        for r in radii
    ]
    axis.set_yticks(range(len(radii)), labels)
    axis.set_xlabel("codewords a structure k, rest included")
    axis.set_ylabel("radius r (neighbours of most taxels, structures)")
    axis.set_title("Histograms by radius and codewords, folds by event", fontsize=11)
    figure.colorbar(image, ax=axis, label="mean of the classes [%], simulated")
    save_figure(figure, path)


FIGURES: dict[str, Figure] = {"kaspar.png": kaspar_figure, "sweep.png": sweep_figure}
