"""`skinmap evaluate --protocol kaspar`: the features and classifiers of the first paper.

`skinmap evaluate --protocol baxter`: the methods of the second paper on contact images.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import click
import numpy as np
from msgspec import Meta

from skinmap.cli.evaluate.command import Evaluation, Own, Rows, Settings
from skinmap.commands.options import MAX_TOUCHES, open_robot
from skinmap.io.recordings.image_files import read_images
from skinmap.recognition.protocols import kaspar, results
from skinmap.recognition.protocols.baxter import METHODS, ImageSet, evaluate_baxter, given_images
from skinmap.report.page import plain_figure, save_figure
from skinmap.report.result import given
from skinmap.report.table import Table
from skinmap.rows import by_class, percent
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.variety import Places


class Kaspar(Own):
    """Where people touch, and whether r and k are swept."""

    places: Places = "anywhere"
    sampling: Literal["random", "paper"] = "random"
    sweep: bool = False


def judge_kaspar(settings: Settings) -> results.KasparResult:
    """Run the protocol."""
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
        carry_over = kaspar.evaluate_carry_over(skins, percent=most, **shared)
        swept = []
        if sweeps:
            swept = kaspar.sweep_radius_and_words(skins[part], percent=most, **shared)
    return results.KasparResult(
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


def kaspar_lines(result: results.KasparResult) -> Iterator[str | Table]:
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
    shown = "percent folds features points:.1f=margin paper:.1f=the_paper's"
    yield Table.of(results.MarginRow, given(result.margins) or [], shown)
    yield "\ncarry-over between patches with other numbers of taxels, 10 %, by event"
    shown = "features same:%=same_patch other:%=other_patches worst:% worst_pair"
    yield Table.of(results.CarrySummary, result.carry_over.summary, shown)
    if result.sweep:
        yield "\nradius and codewords a structure, 10 %, by event"
        words, radii, cells = swept(result)
        rows = [
            [f"{r:g}", cells[r, words[0]].structures, *(percent(cells[r, k].mean) for k in words)]
            for r in radii
        ]
        yield Table(["r [mm]", "structures", *(f"k = {k}" for k in words)], rows)


def sweep_figure(result: results.KasparResult, path: Path) -> None:
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


def swept(
    result: results.KasparResult,
) -> tuple[list[int], list[float], dict[tuple[float, int], results.SweepRow]]:
    """Numbers of codewords, radii, and the row of each pair."""
    words = list(dict.fromkeys(row.words for row in result.sweep))
    radii = list(dict.fromkeys(row.radius_mm for row in result.sweep))
    return words, radii, {(row.radius_mm, row.words): row for row in result.sweep}


class Baxter(Own):
    """How many images there are, and which network."""

    images: Annotated[int, Meta(ge=90, le=MAX_TOUCHES)] = 1800
    network: Literal["small", "paper"] = "small"


def judge_baxter(settings: Settings) -> results.BaxterResult:
    """Run the protocol."""
    subject: PreparedSkin | ImageSet
    # `raw-rbf` is the name of that classifier elsewhere.
    named = tuple(one.replace("-", "_") for one in settings.names)
    methods = named or tuple(METHODS)
    if settings.recordings:
        if settings.robot or settings.parts:
            raise click.UsageError("images of files have no --robot and no --part")
        found = read_images(settings.recordings[0])
        subject, name = given_images(found.images, found.labels, found.touches), ""
        methods = named or ("bovw", "cnn")
    else:
        name = settings.robot or "baxter-forearm"
        loaded, parts = open_robot(name, settings.parts)
        if len(parts) > 1:
            raise click.UsageError(f"which part of {name}? --part {' | '.join(parts)}")
        subject, name = PreparedSkin(loaded.skin(parts[0])), loaded.name
    with settings.working(2 * len(methods) * settings.seeds, "baxter") as shared:
        return evaluate_baxter(
            subject,
            robot=name,
            seed=settings.seed,
            repeats=settings.seeds,
            images=settings.own.images,
            network=settings.own.network,
            methods=methods,
            variety=settings.variety,
            **shared,
        )


def baxter_lines(result: results.BaxterResult) -> Iterator[str | Table]:
    """The tables of a result."""
    where = f"{result.robot} {result.part}, " if result.part else ""
    yield (
        f"{where}{result.images} images of {result.touches} touches ({result.accuracy_is}), "
        f"{result.repeats} splits 70/30; mean of the diagonal in %"
    )
    rows: Rows = []
    methods = _methods(result)
    for name, method in methods.items():
        for split, one in (("by touch", method), ("plain", method.plain)):
            rows.append([name, split, percent(one.mean), percent(one.min), percent(one.max)])
        if name in result.paper:
            theirs = [percent(result.paper[name][key]) for key in ("repeats_mean", "min", "max")]
            rows.append([name, "the paper's, plain", *theirs])
    yield Table(["method", "split", "mean", "min", "max"], rows)
    yield "\nnames of touches (rows) in %: by touch, plain, and in the paper's one plain split"
    rows = []
    for name, method in methods.items():
        table: list[list[float]] = getattr(result.confusion, name)
        dealt = given(method.plain.confusion) or table
        for number, label in enumerate(result.confusion.labels):
            right = result.paper.get(name, {}).get(label)
            both = ["", ""] if right is None else [percent(right), percent(1.0 - right)]
            cells = [*table[number], *dealt[number]]
            rows.append([name, label, *map(percent, cells), *(both[:: 1 - 2 * number])])
    heads = [f"{who}{label}" for who in ("", "plain: ", "paper: ") for label in ("hand", "other")]
    yield Table(["method", "touch", *heads], rows)
    yield from _tuned(result)


def _tuned(result: results.BaxterResult) -> Iterator[str | Table]:
    """What tuning tried on the first split, as Fig. 8 and Table I of the paper have it."""
    beside = "5 folds by touch within the first split, in %; in brackets the paper's"
    if tried := _tries(result, "bovw"):
        yield f"\naccuracy over K (Fig. 8), {beside}"
        yield Table(["K", "accuracy"], [[row["words"], cell] for row, cell in tried])
    if tried := _tries(result, "cnn"):
        cells = {(row["learning_rate"], row["epochs"]): cell for row, cell in tried}
        rates, epochs = (sorted({key[axis] for key in cells}) for axis in (0, 1))
        yield f"\naccuracy over learning rate and epochs (Table I), {beside}"
        rows: Rows = [
            [f"{rate:g}", *(cells.get((rate, number), "") for number in epochs)] for rate in rates
        ]
        yield Table(["rate", *map(str, epochs)], rows)


def _methods(result: results.BaxterResult) -> dict[str, Any]:
    """Results by method, of those that ran."""
    found = {name: given(getattr(result, name)) for name in METHODS}
    return {name: one for name, one in found.items() if one and given(one.missing) is None}


def _tries(result: results.BaxterResult, name: str) -> list[tuple[dict[str, Any], str]]:
    """What tuning tried, each with its accuracy and the paper's."""
    method = _methods(result).get(name)
    return [
        (row, percent(row["mean"]) + (f" ({percent(row['paper'])})" if "paper" in row else ""))
        for row in (given(method.tuning) if method else None) or []
    ]


EVALUATIONS = {
    "kaspar": Evaluation(judge_kaspar, kaspar_lines, Kaspar, sweep_figure),
    "baxter": Evaluation(judge_baxter, baxter_lines, Baxter),
}
