"""Names across physics: trained on touches of one simulator, tested on those of another.

Parts are left out too, each in turn with its mirror image while the others train. Ours plays on all
parts, MuJoCo on one of each pair. What is trained on never saw the frozen variant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.classify.classifier import WITH_SETS
from skinmap.classify.descriptors import Touch, recorded_touches
from skinmap.classify.evaluate import likeliest
from skinmap.classify.protocols.cross_patch import make
from skinmap.errors import InvalidArrayError
from skinmap.parallel.run import run_tasks, task_rng
from skinmap.parallel.workers import ONE, Workers
from skinmap.physics.simulation import simulate as press
from skinmap.physics.variants import TUNING, VARIANTS
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulator import simulate

OURS = "ours"
CLASSIFIER = "contact-geometry"
BOTH = "ours and mujoco"
# Recordings of ours for each of MuJoCo's, each on sensors of another state: they vary more, and a
# touch costs a tenth of the time.
OURS_TIMES = 6
BINS = 10  # of the expected calibration error
COVERAGE = 0.9  # promised by sets of names
Named = tuple[str, str, float]  # true label, name and confidence of a touch


@dataclass(frozen=True, eq=False, slots=True)
class Judged:
    """What one training is worth on one physics.

    Attributes
    ----------
    trained_on, tested_on : str
        "ours", a variant of MuJoCo, or "ours and mujoco": all of both but what is tested on.
    labels : tuple of str
    counts : (l, l + 1) int
        Touches of each label (rows) that were named each; the last column is `no_contact`.
    ece : float
        Expected calibration error: by how much confidence and share right differ, over ten bins.
    held, set_size : float
        Share of the touches whose set of names, promised for 0.9 of them, holds the true one, and
        names in a set; NaN where no sets were asked for.
    """

    trained_on: str
    tested_on: str
    labels: tuple[str, ...]
    counts: FloatArray
    ece: float
    held: float = float("nan")
    set_size: float = float("nan")

    @property
    def per_class(self) -> dict[str, float]:
        """Share named right of each label."""
        total = self.counts.sum(axis=1)
        right = np.diagonal(self.counts) / np.maximum(total, 1)
        return {name: float(r) for name, r, n in zip(self.labels, right, total, strict=True) if n}

    @property
    def mean(self) -> float:
        """Of the classes."""
        return float(np.mean(list(self.per_class.values())))


@dataclass(frozen=True, eq=False, slots=True)
class Playing:
    """A skin to be touched in a physics: what a worker needs."""

    skin: PreparedSkin
    physics: str
    gestures: tuple[str, ...]
    per_gesture: int
    seed: tuple[int, ...]


@dataclass(frozen=True, eq=False, slots=True)
class _Training:
    """One training and all that it is tested on, by physics."""

    classifier: str
    trained_on: str
    train: tuple[Touch, ...]
    test: Mapping[str, tuple[Touch, ...]]
    seed: int


def evaluate_physics(
    skins: Mapping[str, PreparedSkin],
    *,
    gestures: Sequence[str],
    per_gesture: int,
    seeds: Sequence[int],
    classifier: str = CLASSIFIER,
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> list[Judged]:
    """Train on ours, on each variant that may be trained on, and on all; test on each physics.

    Parameters
    ----------
    skins : mapping of str to PreparedSkin
        By part; those of as many taxels count as mirror images.
    gestures : sequence of str
    per_gesture : int
        Touches of each gesture on a skin in each variant of MuJoCo; of ours `OURS_TIMES` as many.
    seeds : sequence of int
        Repetitions.
    classifier : str
    workers : Workers
    progress : callable, optional

    Raises
    ------
    InvalidArrayError
        Fewer than two skins: none is left to test on.
    MissingLibraryError
        MuJoCo is not installed.
    """
    if len(skins) < 2:
        raise InvalidArrayError(f"leaving parts out needs two parts, got {len(skins)}")
    pairs = mirror_pairs(skins)
    if len(set(pairs.values())) < 2:
        raise InvalidArrayError("leaving parts out needs two parts that are no mirror images")
    found: list[tuple[str, str, list[Named], FloatArray]] = []
    for seed in seeds:
        touched = _touch(skins, gestures, per_gesture, seed, workers, progress)
        trainings = [
            one
            for part in dict.fromkeys(pairs.values())
            for one in _trainings(touched, pairs, part, classifier, seed)
        ]
        for rows in run_tasks(_train, trainings, workers=workers, progress=progress):
            found += rows
    judgements = []
    for pair in dict.fromkeys((trained, tested) for trained, tested, *_ in found):
        own = [rows for rows in found if rows[:2] == pair]
        held, size = np.concatenate([sets for *_, sets in own]).mean(axis=0).tolist()
        one = judged(*pair, gestures, [name for rows in own for name in rows[2]])
        judgements.append(replace(one, held=held, set_size=size))
    return judgements


def mirror_pairs(skins: Mapping[str, PreparedSkin]) -> dict[str, str]:
    """By part, the first one of as many taxels: itself, or what it is the mirror image of."""
    first: dict[int, str] = {}
    return {part: first.setdefault(len(skin.skin), part) for part, skin in skins.items()}


def judged(trained: str, tested: str, labels: Sequence[str], named: Sequence[Named]) -> Judged:
    """Counts and calibration of (true label, name, confidence) of touches."""
    counts = np.zeros((len(labels), len(labels) + 1))
    columns = {name: k for k, name in enumerate(labels)}
    for true, name, _ in named:
        counts[columns[true], columns.get(name, len(labels))] += 1
    sure = np.array([confidence for _, _, confidence in named])
    right = np.array([true == name for true, name, _ in named])
    return Judged(trained, tested, tuple(labels), counts, calibration_error(sure, right))


def calibration_error(confidence: FloatArray, right: FloatArray) -> float:
    """Expected calibration error of confidences (n,) whose names were right (n,) or not.

    Guo, Pleiss, Sun and Weinberger, "On Calibration of Modern Neural Networks", ICML 2017.
    """
    if len(confidence) == 0:
        return float("nan")
    bins = np.minimum((confidence * BINS).astype(int), BINS - 1)
    gap = np.bincount(bins, confidence - right, minlength=BINS)
    return float(np.abs(gap).sum() / len(confidence))


def _touch(
    skins: Mapping[str, PreparedSkin],
    gestures: Sequence[str],
    per_gesture: int,
    seed: int,
    workers: Workers,
    progress: Callable[[str], None] | None,
) -> dict[tuple[str, str], tuple[Touch, ...]]:
    """Touches by physics and part."""
    pairs = mirror_pairs(skins)
    tasks = [
        Playing(skin, physics, tuple(gestures), per_gesture, (seed, row, column))
        for row, physics in enumerate((OURS, *VARIANTS))
        for column, (part, skin) in enumerate(skins.items())
        if physics == OURS or pairs[part] == part
    ]
    played = run_tasks(_play, tasks, workers=workers, progress=progress)
    return {
        (task.physics, task.skin.skin.part): tuple(
            Touch(task.skin, samples, label) for label, samples in touches
        )
        for task, touches in zip(tasks, played, strict=True)
    }


def _play(task: Playing) -> list[tuple[str, np.ndarray]]:
    rng = task_rng(task.seed)
    skin, count, gestures = task.skin.skin, task.per_gesture, task.gestures
    if task.physics == OURS:
        played = [
            simulate(skin, rng=rng, per_gesture=count, gestures=gestures) for _ in range(OURS_TIMES)
        ]
    else:
        played = [press(skin, rng=rng, variant=task.physics, per_gesture=count, gestures=gestures)]
    every = [touch for one in played for touch in recorded_touches(task.skin, one)]
    return [(touch.label, touch.samples) for touch in every]


def _trainings(
    touched: Mapping[tuple[str, str], tuple[Touch, ...]],
    pairs: Mapping[str, str],
    tested: str,
    classifier: str,
    seed: int,
) -> list[_Training]:
    """All trainings that test on one of the parts and its mirror image."""

    def of(physics: Sequence[str], left: bool) -> tuple[Touch, ...]:
        chosen = [part for part, first in pairs.items() if (first == tested) == left]
        return tuple(t for one in physics for part in chosen for t in touched.get((one, part), ()))

    every = (OURS, *VARIANTS)
    tests = {one: of([one], True) for one in every}
    made = [_Training(classifier, one, of([one], False), tests, seed) for one in (OURS, *TUNING)]
    for one in every:
        rest = [other for other in (OURS, *TUNING) if other != one]
        made.append(_Training(classifier, BOTH, of(rest, False), {one: tests[one]}, seed))
    return made


def _train(task: _Training) -> list[tuple[str, str, list[Named], FloatArray]]:
    """Train once; names of the touches of each physics, and (m, 2) sets that hold the truth, sizes.

    Sizes and truth are NaN for classifiers that are too slow to calibrate sets of.
    """
    sets = task.classifier in WITH_SETS
    model = make(task.classifier).fit(task.train, rng=task_rng(task.seed), sets=sets)
    if sets:
        model.promise(COVERAGE)
    found = []
    for physics, touches in task.test.items():
        named, held = [], np.full((len(touches), 2), np.nan)
        for row, touch in enumerate(touches):
            guess = likeliest(model, touch)
            named.append((touch.label, guess.label, float(guess.confidence)))
            names = model.predict(touch).names
            if names is not None:
                held[row] = touch.label in names, len(names)
        found.append((task.trained_on, physics, named, held))
    return found
