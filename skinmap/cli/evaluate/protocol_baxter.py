"""`skinmap evaluate --protocol baxter`: the methods of the second paper on contact images."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import click
from msgspec import Meta

from skinmap.cli.evaluate.evaluation import Own, Rows, Settings
from skinmap.commands.options import MAX_TOUCHES, open_robot
from skinmap.recognition.protocols.results import BaxterResult
from skinmap.report.result import given
from skinmap.report.table import Table
from skinmap.rows import percent


class Baxter(Own):
    """How many images there are, and which network."""

    images: Annotated[int, Meta(ge=90, le=MAX_TOUCHES)] = 1800
    network: Literal["small", "paper"] = "small"


SETTINGS = Baxter


def work(settings: Settings) -> BaxterResult:
    """Run the protocol."""
    from skinmap.io.recordings.image_files import read_images
    from skinmap.recognition.protocols.baxter import METHODS, evaluate_baxter
    from skinmap.recognition.protocols.baxter_images import ImageSet, given_images
    from skinmap.touch.prepared_skin import PreparedSkin

    subject: PreparedSkin | ImageSet
    methods = settings.names or tuple(METHODS)
    if settings.recordings:
        if settings.robot or settings.parts:
            raise click.UsageError("images of files have no --robot and no --part")
        found = read_images(settings.recordings[0])
        subject, name = given_images(found.images, found.labels, found.touches), ""
        methods = settings.names or ("bovw", "cnn")
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


def lines(result: BaxterResult) -> Iterator[str | Table]:
    """The tables of a result."""
    where = f"{result.robot} {result.part}, " if result.part else ""
    yield (
        f"{where}{result.images} images of {result.touches} touches ({result.accuracy_is}), "
        f"{result.repeats} splits 70/30; mean of the diagonal in %"
    )
    rows: Rows = []
    for name in ("bovw", "cnn", "raw_rbf"):
        method = given(getattr(result, name))
        if method is None or given(method.missing) is not None:
            continue
        for split, one in (("by touch", method), ("plain", method.plain)):
            rows.append([name, split, percent(one.mean), percent(one.min), percent(one.max)])
        if name in result.paper:
            theirs = [percent(result.paper[name][key]) for key in ("repeats_mean", "min", "max")]
            rows.append([name, "the paper's, plain", *theirs])
    yield Table(["method", "split", "mean", "min", "max"], rows)
    yield "\nnames of touches (rows) in %: by touch, plain, and in the paper's one plain split"
    rows = []
    for name in ("bovw", "cnn", "raw_rbf"):
        table: list[list[float]] = given(getattr(result.confusion, name)) or []
        method = given(getattr(result, name))
        plain = given(method.plain) if method else None
        dealt = (given(plain.confusion) if plain else None) or table
        for number, label in enumerate(result.confusion.labels[: len(table)]):
            right = result.paper.get(name, {}).get(label)
            both = ["", ""] if right is None else [percent(right), percent(1.0 - right)]
            cells = [*table[number], *dealt[number]]
            rows.append([name, label, *map(percent, cells), *(both[:: 1 - 2 * number])])
    heads = [f"{who}{label}" for who in ("", "plain: ", "paper: ") for label in ("hand", "other")]
    yield Table(["method", "touch", *heads], rows)
    yield from _tuned(result)


def _tuned(result: BaxterResult) -> Iterator[str | Table]:
    """What tuning tried on the first split, as Fig. 8 and Table I of the paper have it."""
    beside = "5 folds by touch within the first split, in %; in brackets the paper's"
    tried = [(row, _beside(row)) for row in _tries(result, "bovw")]
    if tried:
        yield f"\naccuracy over K (Fig. 8), {beside}"
        yield Table(["K", "accuracy"], [[row["words"], cell] for row, cell in tried])
    tried = [(row, _beside(row)) for row in _tries(result, "cnn")]
    if tried:
        cells = {(row["learning_rate"], row["epochs"]): cell for row, cell in tried}
        rates, epochs = (sorted({key[axis] for key in cells}) for axis in (0, 1))
        yield f"\naccuracy over learning rate and epochs (Table I), {beside}"
        rows: Rows = [
            [f"{rate:g}", *(cells.get((rate, number), "") for number in epochs)] for rate in rates
        ]
        yield Table(["rate", *map(str, epochs)], rows)


def _tries(result: BaxterResult, name: str) -> list[dict[str, Any]]:
    method = given(getattr(result, name))
    return [] if method is None else given(method.tuning) or []


def _beside(row: dict[str, Any]) -> str:
    theirs = f" ({percent(row['paper'])})" if "paper" in row else ""
    return percent(row["mean"]) + theirs
