"""`skinmap evaluate --protocol kaspar`: the features and classifiers of the first paper."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import click
import numpy as np

from skinmap.cli.evaluate.evaluation import Own, Rows, Settings
from skinmap.commands.options import open_robot
from skinmap.recognition.protocols.results import CarrySummary, KasparResult, SweepRow
from skinmap.report.page import plain_figure, save_figure
from skinmap.report.result import given
from skinmap.report.table import Table
from skinmap.rows import by_class, percent
from skinmap.touch.simulation.variety import Places


class Kaspar(Own):
    """Where people touch, and whether r and k are swept."""

    places: Places = "anywhere"
    sampling: Literal["random", "paper"] = "random"
    sweep: bool = False


SETTINGS = Kaspar


def work(settings: Settings) -> KasparResult:
    """Run the protocol."""
    from skinmap.recognition.protocols import kaspar
    from skinmap.recognition.protocols.carry_over import evaluate_carry_over
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
    sweeps = settings.own.sweep or settings.pictures
    most = max(kaspar.PERCENTS)
    chosen = {"places": settings.own.places, "sampling": settings.own.sampling}
    with settings.working((3 if sweeps else 2) * settings.seeds, "kaspar") as who:
        shared = {**settings.drawn, **who, "samples": kaspar.SAMPLES}
        table = kaspar.evaluate_kaspar(skins[part], percents=kaspar.PERCENTS, **chosen, **shared)
        carry_over = evaluate_carry_over(skins, percent=most, **shared)
        swept = []
        if sweeps:
            swept = kaspar.sweep_radius_and_words(skins[part], percent=most, **shared)
    return KasparResult(
        robot=loaded.name,
        part=part,
        taxels=len(skins[part]),
        **chosen,
        **settings.drawn,
        samples=kaspar.SAMPLES,
        table=table,
        margins=kaspar.margins(table),
        paper=kaspar.paper_rows(),
        carry_over=carry_over,
        sweep=swept,
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
    how = {"random": "drawn at random", "paper": "every 50th and every 10th, as published"}
    drawn = how[given(result.sampling) or "random"]
    yield f"\nhistograms ahead of raw values (RBF SVM) in points; samples {drawn}"
    rows = [
        [f"{row.percent} %", row.folds, row.features, f"{row.points:.1f}",
         "" if row.paper is None else f"{row.paper:.1f}"]
        for row in given(result.margins) or []
    ]  # fmt: skip
    yield Table(["percent", "folds", "features", "margin", "the paper's"], rows)
    yield "\ncarry-over between patches with other numbers of taxels, 10 %, by event"
    shown = "features same:%=same_patch other:%=other_patches worst:% worst_pair"
    yield Table.of(CarrySummary, result.carry_over.summary, shown)
    if result.sweep:
        yield "\nradius and codewords a structure, 10 %, by event"
        words, radii, cells = swept(result)
        rows = [
            [f"{r:g}", cells[r, words[0]].structures, *(percent(cells[r, k].mean) for k in words)]
            for r in radii
        ]
        yield Table(["r [mm]", "structures", *(f"k = {k}" for k in words)], rows)


def sweep_figure(result: KasparResult, path: Path) -> None:
    """Accuracy over radius and codewords, a number in each cell."""
    words, radii, cells = swept(result)
    rows = [[cells[r, k] for k in words] for r in radii]
    values = np.array([[100.0 * one.mean for one in row] for row in rows])
    figure = plain_figure((7.6, 4.6))
    axis = figure.subplots()
    image = axis.imshow(values, cmap="viridis", aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        text = f"{value:.1f}\n± {100 * rows[row][column].std:.1f}"
        colour = "black" if image.norm(value) > 2 / 3 else "white"
        axis.text(column, row, text, ha="center", va="center", color=colour, fontsize=8)
    heads = [f"{row[0].radius_mm:g} mm ({row[0].neighbours}, {row[0].structures})" for row in rows]
    axis.set_xticks(range(len(words)), words)
    axis.set_yticks(range(len(rows)), heads)
    axis.set_xlabel("codewords a structure k, rest included")
    axis.set_ylabel("radius r (neighbours of most taxels, structures)")
    axis.set_title("Histograms by radius and codewords, folds by event", fontsize=11)
    figure.colorbar(image, ax=axis, label="mean of the classes [%], simulated")
    save_figure(figure, path)


def swept(result: KasparResult) -> tuple[list[int], list[float], dict[tuple[float, int], SweepRow]]:
    """Numbers of codewords, radii, and the row of each pair."""
    words = list(dict.fromkeys(row.words for row in result.sweep))
    radii = list(dict.fromkeys(row.radius_mm for row in result.sweep))
    return words, radii, {(row.radius_mm, row.words): row for row in result.sweep}
