"""Transfer: trained on all patches of a robot but one, tested on that one; or on another robot.

Each patch is a skin of its own, with simulated touches anywhere on it.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator

from skinmap.errors import InvalidArrayError
from skinmap.parallel.run import run_tasks, task_rng
from skinmap.parallel.workers import ONE, Workers
from skinmap.recognition.classifier import classifiers
from skinmap.recognition.descriptors import Touch, recorded_touches
from skinmap.recognition.evaluate import Score, score
from skinmap.recognition.protocols.folds import mean_and_spread, run_repeats
from skinmap.recognition.protocols.results import PatchesRow
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh, build_surface
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.simulator import simulate
from skinmap.touch.simulation.variety import DEFAULT


def cut_into_patches(mesh: SurfaceMesh) -> tuple[Skin, ...]:
    """One skin for each connected patch, the largest first, named `part/0`, `part/1`...

    A part of one patch keeps its name. Taxels that no face uses belong to no patch and are
    left out.
    """
    skin, patch = mesh.skin, mesh.taxel_patches
    if mesh.n_patches == 1 and (patch == 0).all():
        return (skin,)
    return tuple(_cut(skin, np.flatnonzero(patch == k), k) for k in range(mesh.n_patches))


def _cut(skin: Skin, rows: np.ndarray, number: int) -> Skin:
    return Skin(
        f"{skin.part}/{number}",
        skin.link,
        skin.channels[rows],
        skin.modules[rows],
        skin.positions[rows],
        skin.normals[rows],
    )


OURS = "ours"  # the physics that is not MuJoCo's
DEFAULTS = ("contact-geometry", "histogram", "paper")
Scores = Mapping[str, Score]  # by patch


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
    """Every patch of some parts as a skin of its own.

    Parameters
    ----------
    robot : Robot
    parts : sequence of str

    Returns
    -------
    list of Patch
        Without touches.

    Examples
    --------
    >>> import skinmap
    >>> patches = cut_patches(skinmap.load_robot("icub"), ["left_forearm"])
    >>> [(patch.name, len(patch.skin)) for patch in patches]
    [('left_forearm/0', 160), ('left_forearm/1', 80)]
    """
    skins = [skin for part in parts for skin in cut_into_patches(build_surface(robot.skin(part)))]
    return [Patch(skin.part, PreparedSkin(skin)) for skin in skins]


@dataclass(frozen=True, eq=False, slots=True)
class Playing:
    """A skin to be touched in a physics, so many times anew: what a worker needs."""

    skin: PreparedSkin
    gestures: tuple[str, ...]
    per_gesture: int
    variety: float
    seed: tuple[int, ...]
    physics: str = OURS
    times: int = 1


def played(task: Playing) -> list[Recording]:
    """The recordings of what is played; of MuJoCo one."""
    skin = task.skin.skin
    how: dict[str, Any] = {"gestures": task.gestures, "per_gesture": task.per_gesture}
    how["rng"] = task_rng(task.seed)
    if task.physics == OURS:
        return [simulate(skin, variety=task.variety, **how) for _ in range(task.times)]
    from skinmap.physics.simulation import simulate as press

    return [press(skin, variant=task.physics, **how)]


def touch_patches(
    patches: Sequence[Patch],
    *,
    seed: int | Sequence[int],
    gestures: Sequence[str],
    per_gesture: int,
    variety: float = DEFAULT,
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> list[Patch]:
    """The same patches with simulated touches anywhere on each.

    Parameters
    ----------
    patches : sequence of Patch
    seed : int or sequence of int
    gestures : sequence of str
        Those that do not fit a patch are left out there.
    per_gesture : int
        Touches of each gesture on each patch.
    variety : float
        Random spread of touches and sensors, 0 to 2.
    workers : Workers
    progress : callable, optional
        Called after each patch.

    Returns
    -------
    list of Patch
        With touches.

    Examples
    --------
    >>> import skinmap
    >>> patches = cut_patches(skinmap.load_robot("kaspar"), ["left_hand"])
    >>> (touched,) = touch_patches(patches, seed=0, gestures=["poke"], per_gesture=2)
    >>> [touch.label for touch in touched.touches]
    ['poke', 'poke']
    """
    own = tuple(np.atleast_1d(seed).tolist())
    tasks = [
        Playing(patch.skin, tuple(gestures), per_gesture, variety, (*own, number))
        for number, patch in enumerate(patches)
    ]
    found = run_tasks(played, tasks, workers=workers, progress=progress)
    return [
        replace(patch, touches=tuple(recorded_touches(patch.skin, recording)))
        for patch, (recording,) in zip(patches, found, strict=True)
    ]


def score_patches(
    test: Sequence[Patch],
    train: Sequence[Patch] | None = None,
    *,
    names: Sequence[str] = DEFAULTS,
    seed: int,
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> list[dict[str, Score]]:
    """Scores of each of some classifiers on each patch.

    Parameters
    ----------
    test : sequence of Patch
        With touches.
    train : sequence of Patch, optional
        What all are trained on; by default each patch is tested by what the others taught.
    names : sequence of str
        Classifiers.
    seed : int
    workers : Workers
    progress : callable, optional
        Called after each training.

    Returns
    -------
    list of dict of str to Score
        For each of `names`, by patch.

    Raises
    ------
    InvalidArrayError
        One patch to test on, and none to train on.

    Examples
    --------
    >>> import skinmap
    >>> patches = cut_patches(skinmap.load_robot("kaspar"), ["left_hand", "right_arm"])
    >>> kinds = ["poke", "full_finger"]
    >>> touched = touch_patches(patches, seed=0, gestures=kinds, per_gesture=6)
    >>> (scores,) = score_patches(touched, names=["contact-geometry"], seed=0)
    >>> sorted(scores), scores["left_hand"].touches
    (['left_hand', 'right_arm'], 12)
    """
    if train is None and len(test) < 2:
        raise InvalidArrayError(f"leaving one patch out needs two patches, got {len(test)}")
    sides = (
        [((*test[:k], *test[k + 1 :]), (patch,)) for k, patch in enumerate(test)]
        if train is None
        else [(tuple(train), tuple(test))]
    )
    trials = [
        {"classifier": name, "train": trained, "test": tested}
        for name in names
        for trained, tested in sides
    ]
    found = run_repeats(_train, trials, workers=workers, progress=progress, seed=seed)
    return [
        {patch: own for scores in found[k : k + len(sides)] for patch, own in scores.items()}
        for k in range(0, len(found), len(sides))
    ]


def _train(
    classifier: str, train: Sequence[Patch], test: Sequence[Patch], *, seed: int
) -> dict[str, Score]:
    """Train once; scores for each test patch by name."""
    touches = [touch for patch in train for touch in patch.touches]
    model = classifiers.get(classifier)().fit(touches, rng=task_rng(seed))
    return {patch.name: score(model, patch.touches) for patch in test}


def check_carries_over(names: Sequence[str]) -> None:
    """Refuse classifiers that know one skin only.

    Raises
    ------
    InvalidArrayError, UnknownNameError
    """
    for name in names:
        if getattr(classifiers.get(name)().descriptor, "one_skin", False):
            raise InvalidArrayError(
                f"{name!r} learns the taxels of one part: it cannot be tested on another"
            )


def summarise(name: str, seeds: Sequence[Scores]) -> PatchesRow:
    """One row: means over the seeds per patch and class, mean and worst over the patches."""
    per_patch = {
        patch: float(np.mean([scores[patch].accuracy for scores in seeds])) for patch in seeds[0]
    }
    every = [one for scores in seeds for one in scores.values()]
    right: dict[str, float] = defaultdict(float)
    total = Counter[str]()
    for one in every:
        for label, count in one.counts.items():
            right[label] += one.per_label[label] * count
            total[label] += count
    mean, std = mean_and_spread(
        [float(np.mean([one.accuracy for one in scores.values()])) for scores in seeds]
    )
    worst = min(per_patch, key=lambda patch: per_patch[patch])
    return PatchesRow(
        features=name,
        classifier=_machine(classifiers.get(name)().estimator),
        mean=mean,
        std=std,
        worst=per_patch[worst],
        worst_patch=worst,
        per_patch=per_patch,
        per_class={label: right[label] / total[label] for label in total},
        unknown=float(np.mean([one.unknown for one in every])),
        touches=total.total(),
    )


def _machine(estimator: Any) -> str:
    """The class that decides, without what calibrates or prepares for it."""
    while True:
        if hasattr(estimator, "steps"):
            estimator = estimator.steps[-1][1]
        elif isinstance(getattr(estimator, "estimator", None), BaseEstimator):
            estimator = estimator.estimator
        else:
            return type(estimator).__name__
