"""The patches of a robot, each a skin of its own, and simulated touches on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from skinmap.classify.descriptors import Touch, recorded_touches
from skinmap.parallel.run import run_tasks, task_rng
from skinmap.parallel.workers import ONE, Workers
from skinmap.skin.robot import Robot
from skinmap.surface.surface_mesh import build_surface
from skinmap.touch.patches import cut_into_patches
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulator import simulate


@dataclass(frozen=True, eq=False, slots=True)
class Patch:
    """A connected sheet of modules with touches on it.

    Attributes
    ----------
    name : str
        The part, with the number of the patch where the part has several.
    skin : PreparedSkin
    touches : tuple of Touch
    """

    name: str
    skin: PreparedSkin
    touches: tuple[Touch, ...] = ()


def cut_patches(robot: Robot, parts: Sequence[str]) -> list[Patch]:
    """Every patch of some parts as a skin of its own."""
    skins = [skin for part in parts for skin in cut_into_patches(build_surface(robot.skin(part)))]
    return [Patch(skin.part, PreparedSkin(skin)) for skin in skins]


def touch_patches(
    patches: Sequence[Patch],
    *,
    seed: int | Sequence[int],
    gestures: Sequence[str],
    per_gesture: int,
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> list[Patch]:
    """The same patches with simulated touches anywhere on each.

    A gesture that does not fit a patch is left out there.
    """
    tasks = [
        _Playing(patch, seed, number, tuple(gestures), per_gesture)
        for number, patch in enumerate(patches)
    ]
    found = run_tasks(_simulate, tasks, workers=workers, progress=progress)
    return [
        Patch(
            patch.name,
            patch.skin,
            tuple(Touch(patch.skin, samples, label, person) for label, samples, person in touches),
        )
        for patch, touches in zip(patches, found, strict=True)
    ]


@dataclass(frozen=True, eq=False, slots=True)
class _Playing:
    patch: Patch
    seed: int | Sequence[int]
    number: int
    gestures: tuple[str, ...]
    per_gesture: int


def _simulate(task: _Playing) -> list[tuple[str, np.ndarray, int]]:
    recording = simulate(
        task.patch.skin.skin,
        rng=task_rng(task.seed, task.number),
        per_gesture=task.per_gesture,
        gestures=task.gestures,
    )
    touches = recorded_touches(task.patch.skin, recording)
    return [(touch.label, touch.samples, touch.person) for touch in touches]
