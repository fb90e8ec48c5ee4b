"""`skinmap evaluate --protocol baxter`: the methods of the second paper on contact images."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import click
from msgspec import UNSET

from skinmap.cli.evaluate.evaluation import (
    Figure,
    Rows,
    Settings,
    percent,
)
from skinmap.cli.evaluate.result.baxter import BaxterResult, Confusion, MethodResult, SplitSpread
from skinmap.commands.options import open_robot
from skinmap.commands.progress import progress
from skinmap.report.result import given
from skinmap.report.table import Table

TUNING_STEPS = 6  # about; only the bar shows it
FIGURES: dict[str, Figure] = {}


def work(settings: Settings) -> BaxterResult:
    """Run the protocol."""
    from skinmap.classify.protocols.baxter import evaluate_baxter
    from skinmap.classify.protocols.baxter_methods import METHODS
    from skinmap.touch.prepared_skin import PreparedSkin

    name = settings.robot or "baxter-forearm"
    loaded, parts = open_robot(name, settings.parts)
    if len(parts) > 1:
        raise click.UsageError(f"which part of {name}? --part {' | '.join(parts)}")
    skin = PreparedSkin(loaded.skin(parts[0]))
    methods = settings.names or tuple(METHODS)
    # Beside the repetitions of both splits, tuning takes a step for each value tried.
    steps = len(methods) * (2 * settings.seeds + TUNING_STEPS)
    with progress(steps, "baxter") as advance:
        found = evaluate_baxter(
            skin,
            seed=settings.seed,
            repeats=settings.seeds,
            images=settings.images,
            network=settings.network,
            methods=methods,
            workers=settings.workers,
            progress=advance,
        )
    own: dict[str, Any] = {name: _method(found.pop(name)) for name in methods}
    confusion, _ = Confusion(**found.pop("confusion")), found.pop("simulated")
    return BaxterResult(
        robot=loaded.name, part=parts[0], taxels=len(skin), confusion=confusion, **own, **found
    )


def _method(found: dict[str, Any]) -> MethodResult:
    plain = found.pop("plain", None)
    return MethodResult(**found, plain=UNSET if plain is None else SplitSpread(**plain))


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
