"""What `skinmap evaluate` does: skins and settings to protocols and their results."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from msgspec import UNSET

from skinmap.cli.evaluate.result import EvaluateResult
from skinmap.cli.evaluate.result.baxter import BaxterResult, Confusion, MethodResult, SplitSpread
from skinmap.cli.evaluate.result.cross_patch import CrossPatchResult, PatchesRow
from skinmap.cli.evaluate.result.kaspar import (
    CarryOver,
    CarryRow,
    CarrySummary,
    KasparResult,
    SweepRow,
)
from skinmap.cli.evaluate.result.physics import PhysicsResult, PhysicsRow
from skinmap.cli.evaluate.result.shared import AccuracyRow
from skinmap.commands.options import open_robot
from skinmap.commands.progress import progress

if TYPE_CHECKING:
    from skinmap.classify.protocols.patches import Patch
    from skinmap.classify.protocols.physics import Judged
    from skinmap.parallel.workers import Workers
    from skinmap.touch.subjects import Places

TUNING_STEPS = 6  # about; only the bar shows it
PROTOCOLS = ("kaspar", "baxter", "cross-patch", "physics", "time", "cost", "fingers", "hands")
ON_DATA = ("cost", "fingers", "hands")  # protocols of files that users bring
# What evaluates these: each module has a function `work` of the settings.
ELSEWHERE = {
    "cost": "skinmap.cli.evaluate.social_touch",
    "fingers": "skinmap.cli.evaluate.fingers",
    "hands": "skinmap.cli.evaluate.hands",
    "recordings": "skinmap.cli.evaluate.recordings",
    "time": "skinmap.cli.evaluate.in_time",
}


@dataclass(frozen=True, slots=True)
class Settings:
    """The options of the command, checked by click."""

    protocol: str
    recordings: tuple[Path, ...]
    workers: Workers
    robot: str | None
    train_robot: str | None
    parts: tuple[str, ...]
    seeds: int
    seed: int
    names: tuple[str, ...]
    gestures: str
    per_gesture: int
    places: Places
    sweep: bool
    images: int
    network: str
    folds: int
    leave_out: tuple[str, ...]
    leaks: bool

    @property
    def all_seeds(self) -> list[int]:
        """The seed of each repetition."""
        return list(range(self.seed, self.seed + self.seeds))


def work(settings: Settings) -> EvaluateResult:
    """Run a protocol."""
    runners: dict[str, Callable[[Settings], EvaluateResult]] = {
        "kaspar": _kaspar,
        "baxter": _baxter,
        "cross-patch": _cross_patch,
        "physics": _physics,
    }
    name = settings.protocol
    if name in runners:
        return runners[name](settings)
    result: EvaluateResult = importlib.import_module(ELSEWHERE[name]).work(settings)
    return result


def chosen_gestures(settings: Settings) -> tuple[str, ...]:
    """Names of the gestures that were asked for."""
    from skinmap.touch.gestures import gesture_set
    from skinmap.touch.simulator import check_gestures

    names = gesture_set([name.strip() for name in settings.gestures.split(",")])
    check_gestures(names)
    return names


def _kaspar(settings: Settings) -> KasparResult:
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


def _baxter(settings: Settings) -> BaxterResult:
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


def _cross_patch(settings: Settings) -> CrossPatchResult:
    from skinmap.classify.protocols.cross_patch import (
        DEFAULTS,
        check_carries_over,
        leave_one_out,
        summarise,
        transfer,
    )

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
            tested = _touched(test, **simulated)
            if train is None:
                found.append(leave_one_out(tested, names=names, seed=seed, **shared))
                continue
            trained = _touched(train, **{**simulated, "seed": [seed, 1]})
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


def _physics(settings: Settings) -> PhysicsResult:
    from skinmap.classify.protocols import physics
    from skinmap.classify.protocols.cross_patch import check_carries_over
    from skinmap.physics.engine import import_mujoco
    from skinmap.physics.variants import FROZEN, TUNING, VARIANTS
    from skinmap.touch.prepared_skin import PreparedSkin

    if len(settings.names) > 1:
        raise click.UsageError("--protocol physics judges one classifier: name it once")
    import_mujoco()
    classifier = settings.names[0] if settings.names else physics.CLASSIFIER
    check_carries_over((classifier,))
    loaded, parts = open_robot(settings.robot or "icub", settings.parts)
    skins = {part: PreparedSkin(loaded.skin(part)) for part in parts}
    tested = set(physics.mirror_pairs(skins).values())
    gestures = chosen_gestures(settings)
    # Touches of each physics; for each part a training of each physics, and one without each.
    worlds = 1 + len(VARIANTS)
    touches = len(VARIANTS) * len(tested) + len(skins)
    trainings = len(tested) * (1 + len(TUNING) + worlds)
    with progress(settings.seeds * (touches + trainings), "physics") as advance:
        found = physics.evaluate_physics(
            skins,
            gestures=gestures,
            per_gesture=settings.per_gesture,
            seeds=settings.all_seeds,
            classifier=classifier,
            workers=settings.workers,
            progress=advance,
        )
    return PhysicsResult(
        robot=loaded.name,
        parts=list(skins),
        classifier=classifier,
        gestures=list(gestures),
        per_gesture=settings.per_gesture,
        frozen=FROZEN,
        seeds=settings.all_seeds,
        rows=[_physics_row(one) for one in found],
    )


def _physics_row(one: Judged) -> PhysicsRow:
    names = (*one.labels, "no_contact")
    confusion = {
        label: dict(zip(names, map(int, row), strict=True))
        for label, row in zip(one.labels, one.counts, strict=True)
    }
    return PhysicsRow(
        trained_on=one.trained_on,
        tested_on=one.tested_on,
        mean=one.mean,
        per_class=one.per_class,
        ece=one.ece,
        held=one.held,
        set_size=one.set_size,
        confusion=confusion,
    )


def _patches(robot: str, parts: tuple[str, ...]) -> list[Patch]:
    from skinmap.classify.protocols.patches import cut_patches

    loaded, names = open_robot(robot, parts)
    return cut_patches(loaded, names)


def _touched(patches: list[Patch], **simulated: Any) -> list[Patch]:
    from skinmap.classify.protocols.patches import touch_patches

    return touch_patches(patches, **simulated)
