"""`skinmap evaluate --protocol physics`: trained in one physics, tested in another."""

from __future__ import annotations

from collections.abc import Iterator

import click

from skinmap.cli.evaluate.evaluation import Gestures, Settings, chosen_gestures
from skinmap.commands.options import open_robot
from skinmap.recognition.protocols.results import PhysicsResult, PhysicsRow
from skinmap.report.table import Table

SETTINGS = Gestures


def work(settings: Settings) -> PhysicsResult:
    """Run the protocol."""
    from skinmap.physics.engine import import_mujoco
    from skinmap.physics.variants import FROZEN, TUNING, VARIANTS
    from skinmap.recognition.protocols import physics
    from skinmap.recognition.protocols.cross_patch import check_carries_over
    from skinmap.touch.prepared_skin import PreparedSkin

    if len(settings.names) > 1:
        raise click.UsageError("--protocol physics judges one classifier: name it once")
    import_mujoco()
    classifier = settings.names[0] if settings.names else physics.CLASSIFIER
    check_carries_over((classifier,))
    loaded, parts = open_robot(settings.robot or "icub", settings.parts)
    skins = {part: PreparedSkin(loaded.skin(part)) for part in parts}
    tested = set(physics.mirror_pairs(skins).values())
    how = {"per_gesture": settings.per_gesture, **settings.drawn}
    gestures = list(chosen_gestures(settings))
    # Touches of each physics; for each part a training of each physics, and one without each.
    worlds = 1 + len(VARIANTS)
    touches = len(VARIANTS) * len(tested) + len(skins)
    trainings = len(tested) * (1 + len(TUNING) + worlds)
    with settings.working(settings.seeds * (touches + trainings), "physics") as shared:
        rows = physics.evaluate_physics(
            skins, gestures=gestures, classifier=classifier, **how, **shared
        )
    return PhysicsResult(
        robot=loaded.name,
        parts=list(skins),
        classifier=classifier,
        gestures=gestures,
        frozen=FROZEN,
        rows=rows,
        **how,
    )


def lines(result: PhysicsResult) -> Iterator[str | Table]:
    """The tables of a result."""
    yield (
        f"{result.robot}, {len(result.parts)} parts in two hands, {len(result.seeds)} seeds "
        f"(simulated by us and by MuJoCo; nothing is trained on {result.frozen!r}); "
        "accuracy in % of touches"
    )
    shown = "trained_on tested_on mean:% ece:.3f held:% set_size per_class"
    yield Table.of(PhysicsRow, result.rows, shown, classes=result.gestures)
