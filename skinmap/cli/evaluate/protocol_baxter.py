"""`skinmap evaluate --protocol baxter`: the methods of the second paper on contact images."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import click
from msgspec import Meta

from skinmap.cli.evaluate.evaluation import (
    Own,
    Rows,
    Settings,
    percent,
)
from skinmap.commands.options import MAX_TOUCHES, open_robot
from skinmap.commands.progress import progress
from skinmap.recognition.protocols.results import BaxterResult
from skinmap.report.result import given
from skinmap.report.table import Table

# Tables II and III: rows are hand and other, columns what they were named.
PAPER_CONFUSION = {
    "bovw": ((0.9692, 0.0308), (0.0174, 0.9826)),
    "cnn": ((0.9824, 0.0176), (0.0088, 0.9912)),
}
TUNING_STEPS = 6  # about; only the bar shows it


class Baxter(Own):
    """How many images there are, and which network."""

    images: Annotated[int, Meta(ge=40, le=MAX_TOUCHES)] = 1800
    network: Literal["small", "paper"] = "small"


SETTINGS = Baxter


def work(settings: Settings) -> BaxterResult:
    """Run the protocol."""
    from skinmap.io.recordings.image_files import read_images
    from skinmap.recognition.protocols.baxter import evaluate_baxter
    from skinmap.recognition.protocols.baxter_images import ImageSet, given_images
    from skinmap.recognition.protocols.baxter_methods import METHODS
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
    # Beside the repetitions of both splits, tuning takes a step for each value tried.
    steps = len(methods) * (2 * settings.seeds + TUNING_STEPS)
    with progress(steps, "baxter") as advance:
        return evaluate_baxter(
            subject,
            robot=name,
            seed=settings.seed,
            repeats=settings.seeds,
            images=settings.own.images,
            network=settings.own.network,
            methods=methods,
            variety=settings.variety,
            workers=settings.workers,
            progress=advance,
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
    yield "\nwhat touches (rows) were named, by touch, in %; beside it the paper's one split"
    rows = []
    for name in ("bovw", "cnn", "raw_rbf"):
        table: list[list[float]] = given(getattr(result.confusion, name)) or []
        published = PAPER_CONFUSION.get(name)
        for number, label in enumerate(result.confusion.labels[: len(table)]):
            theirs = [percent(one) for one in published[number]] if published else ["", ""]
            rows.append([name, label, *map(percent, table[number]), *theirs])
    yield Table(["method", "touch", "hand", "other", "paper: hand", "paper: other"], rows)
