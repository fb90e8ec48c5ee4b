"""`skinmap evaluate --protocol cross-patch`: trained on other patches, or on another robot."""

from __future__ import annotations

from collections.abc import Iterator

import click

from skinmap.cli.evaluate.evaluation import Gestures, Settings, chosen_gestures
from skinmap.commands.options import open_robot
from skinmap.recognition.protocols.results import CrossPatchResult, PatchesRow
from skinmap.report.table import Table


class CrossPatch(Gestures):
    """Which other robot trains."""

    train_robot: str | None = None


SETTINGS = CrossPatch


def work(settings: Settings) -> CrossPatchResult:
    """Run the protocol."""
    from skinmap.recognition.protocols.cross_patch import (
        DEFAULTS,
        check_carries_over,
        cut_patches,
        score_patches,
        summarise,
        touch_patches,
    )

    names, other = settings.names or DEFAULTS, settings.own.train_robot
    check_carries_over(names)
    gestures = chosen_gestures(settings)
    test = cut_patches(*open_robot(settings.robot or "icub", settings.parts))
    train = cut_patches(*open_robot(other, ())) if other else []
    if not train and len(test) < 2:
        raise click.UsageError(
            f"leaving one patch out needs two patches, got {test[0].name}; "
            "give --set train_robot=ROBOT"
        )
    steps = len(test) + len(train) + len(names) * (1 if train else len(test))
    found = []
    with settings.working(settings.seeds * steps, "cross-patch") as shared:
        play = {"per_gesture": settings.per_gesture, "variety": settings.variety, **shared}
        for seed in settings.all_seeds:
            tested = touch_patches(test, seed=seed, gestures=gestures, **play)
            trained = None
            if train:
                trained = touch_patches(train, seed=[seed, 1], gestures=gestures, **play)
            found.append(score_patches(tested, trained, names=names, seed=seed, **shared))
    return CrossPatchResult(
        robot=settings.robot or "icub",
        train_robot=other,
        gestures=list(gestures),
        per_gesture=settings.per_gesture,
        **settings.drawn,
        patches={patch.name: len(patch.skin) for patch in test},
        rows=[summarise(name, [one[k] for one in found]) for k, name in enumerate(names)],
    )


def lines(result: CrossPatchResult) -> Iterator[str | Table]:
    """The tables of a result."""
    where = f"trained on {result.train_robot}" if result.train_robot else "leave one patch out"
    yield (
        f"{result.robot}, {len(result.patches)} patches, {where}, {len(result.seeds)} seeds "
        "(simulated); accuracy in % of touches"
    )
    shown = "features classifier mean:% worst:% worst_patch per_class"
    yield Table.of(PatchesRow, result.rows, shown, classes=result.gestures)
