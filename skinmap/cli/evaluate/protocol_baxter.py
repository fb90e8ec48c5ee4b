"""`skinmap evaluate --protocol baxter`: the methods of the second paper on contact images."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import click
from msgspec import Meta

from skinmap.classifiers.protocols.results import BaxterResult
from skinmap.cli.evaluate.evaluation import (
    Own,
    Rows,
    Settings,
    percent,
)
from skinmap.commands.options import MAX_TOUCHES, open_robot
from skinmap.commands.progress import progress
from skinmap.report.result import given
from skinmap.report.table import Table

TUNING_STEPS = 6  # about; only the bar shows it


class Baxter(Own):
    """How many images there are, and which network."""

    images: Annotated[int, Meta(ge=40, le=MAX_TOUCHES)] = 1800
    network: Literal["small", "paper"] = "small"


SETTINGS = Baxter


def work(settings: Settings) -> BaxterResult:
    """Run the protocol."""
    from skinmap.classifiers.protocols.baxter import evaluate_baxter
    from skinmap.classifiers.protocols.baxter_methods import METHODS
    from skinmap.touch.prepared_skin import PreparedSkin

    name = settings.robot or "baxter-forearm"
    loaded, parts = open_robot(name, settings.parts)
    if len(parts) > 1:
        raise click.UsageError(f"which part of {name}? --part {' | '.join(parts)}")
    methods = settings.names or tuple(METHODS)
    # Beside the repetitions of both splits, tuning takes a step for each value tried.
    steps = len(methods) * (2 * settings.seeds + TUNING_STEPS)
    with progress(steps, "baxter") as advance:
        return evaluate_baxter(
            PreparedSkin(loaded.skin(parts[0])),
            robot=loaded.name,
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
            rows.append([name, split, percent(one.mean), percent(one.min), percent(one.max)])
    yield Table(["method", "split", "mean", "min", "max"], rows)
