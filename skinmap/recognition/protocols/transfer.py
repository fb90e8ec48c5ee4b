"""Transfer: trained on some patches, parts or physics and tested on others.

Patches: trained on all of a robot but one, tested on that one; or on another robot. Each patch is a
skin of its own, with simulated touches anywhere on it.

Physics: trained on touches of one simulator, tested on those of another. Parts are left out too,
each in turn with its mirror image while the others train. Ours plays on all parts, MuJoCo on one of
each pair. What is trained on never saw the frozen variant.

Touches in time: named with and without their motion, whole and while they still go on. Parts are
left out: the skins are dealt into two hands, one trains while the other tests, and mirror images
never stand on both sides. Each part is touched by people of its own, so people are left out as
well. The judge that can fail is the same classifier without motion, and a second physics.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from sklearn.base import BaseEstimator

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError
from skinmap.parallel.run import task_rng
from skinmap.physics.variants import TUNING, VARIANTS
from skinmap.recognition.catalogue import classifiers
from skinmap.recognition.classifier import NO_CONTACT, WITH_SETS, TouchClassifier, learnable
from skinmap.recognition.descriptors import ContactGeometry, Touch, recorded_touches
from skinmap.recognition.evaluate import Score, likeliest, score
from skinmap.recognition.protocols.folds import mean_and_spread, run_repeats
from skinmap.recognition.protocols.results import PatchesRow, PhysicsRow, SeenRow
from skinmap.recognition.rbf_machine import RbfMachine
from skinmap.skin.checks import twin_parts
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh, build_surface
from skinmap.touch.contacts.motion_features import MOTION_FEATURES, motion_features
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.gestures import FOUR, TIME
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
    columns = skin.channels, skin.modules, skin.positions, skin.normals
    return tuple(
        Skin(f"{skin.part}/{k}", skin.link, *(one[patch == k] for one in columns))
        for k in range(mesh.n_patches)
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


def played(
    skin: PreparedSkin, seed: Sequence[int], physics: str = OURS, times: int = 1, **how: Any
) -> list[Recording]:
    """Recordings of a skin that is touched so many times anew; of MuJoCo one.

    `how` are `gestures`, `per_gesture` and `variety`. Of several recordings every second is at most
    `wide`: what is rarer stands beside it.
    """
    how["rng"], variety = task_rng(seed), how.pop("variety")  # of our simulator alone
    if physics == OURS:
        varieties = variety, min(variety, DEFAULT)
        return [simulate(skin.skin, variety=varieties[k % 2], **how) for k in range(times)]
    from skinmap.physics.simulation import simulate as press

    return [press(skin.skin, variant=physics, **how)]


def touch_patches(
    patches: Sequence[Patch],
    *,
    seed: int | Sequence[int],
    gestures: Sequence[str],
    per_gesture: int,
    variety: float = DEFAULT,
    **who: Any,
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
    who
        `workers` and `progress` of `run_tasks`; it is called after each patch.

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
    own = np.atleast_1d(seed).tolist()
    tasks = [{"skin": one.skin, "seed": (*own, number)} for number, one in enumerate(patches)]
    found = run_repeats(
        played, tasks, gestures=tuple(gestures), per_gesture=per_gesture, variety=variety, **who
    )
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
    **who: Any,
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
    who
        `workers` and `progress` of `run_tasks`; it is called after each training.

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
    found = run_repeats(_train, trials, **who, seed=seed)
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


CLASSIFIER = "contact-geometry"
BOTH = "ours and mujoco"
# Recordings of ours for each of MuJoCo's, each on sensors of another state: they vary more, and a
# touch costs a tenth of the time.
OURS_TIMES = 6
BINS = 10  # of the expected calibration error
COVERAGE = 0.9  # promised by sets of names
Named = tuple[str, str, float]  # true label, name and confidence of a touch


def evaluate_physics(
    skins: Mapping[str, PreparedSkin],
    *,
    gestures: Sequence[str],
    per_gesture: int,
    seeds: Sequence[int],
    classifier: str = CLASSIFIER,
    variety: float = DEFAULT,
    **who: Any,
) -> list[PhysicsRow]:
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
    who
        `workers` and `progress` of `run_tasks`.

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
    firsts = dict.fromkeys(pairs.values())
    if len(firsts) < 2:
        raise InvalidArrayError("leaving parts out needs two parts that are not mirror images")
    how = {"gestures": tuple(gestures), "per_gesture": per_gesture, "variety": variety}
    found: list[tuple[str, str, list[Named], FloatArray]] = []
    for seed in seeds:
        touched = _touch(skins, seed, **how, **who)
        trainings = [one for part in firsts for one in _trainings(touched, pairs, part)]
        for names in run_repeats(
            _train_physics, trainings, classifier=classifier, seed=seed, **who
        ):
            found += names
    rows = []
    for pair in dict.fromkeys((trained, tested) for trained, tested, *_ in found):
        own = [names for names in found if names[:2] == pair]
        held, size = np.concatenate([sets for *_, sets in own]).mean(axis=0).tolist()
        one = judged(*pair, gestures, [name for names in own for name in names[2]])
        rows.append(replace(one, held=held, set_size=size))
    return rows


def mirror_pairs(skins: Mapping[str, PreparedSkin]) -> dict[str, str]:
    """By part, the first one of its shape: itself, or what it is the mirror image of."""
    return twin_parts({part: skin.skin for part, skin in skins.items()})


def judged(trained: str, tested: str, labels: Sequence[str], named: Sequence[Named]) -> PhysicsRow:
    """What (true label, name, confidence) of touches are worth; sets of names are not known."""
    names = (*labels, NO_CONTACT)
    counts = {true: dict.fromkeys(names, 0) for true in labels}
    for true, name, _ in named:
        counts[true][name if name in labels else NO_CONTACT] += 1
    per_class = {
        label: own[label] / total for label, own in counts.items() if (total := sum(own.values()))
    }
    sure = np.array([confidence for _, _, confidence in named])
    right = np.array([true == name for true, name, _ in named])
    return PhysicsRow(
        trained_on=trained,
        tested_on=tested,
        mean=float(np.mean(list(per_class.values()))),
        per_class=per_class,
        ece=calibration_error(sure, right),
        held=None,
        set_size=None,
        confusion=counts,
    )


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
    skins: Mapping[str, PreparedSkin], seed: int, **how: Any
) -> dict[tuple[str, str], tuple[Touch, ...]]:
    """Touches by physics and part."""
    pairs = mirror_pairs(skins)
    tasks: list[dict[str, Any]] = [
        {"skin": skin, "seed": (seed, row, column), "physics": physics}
        for row, physics in enumerate((OURS, *VARIANTS))
        for column, (part, skin) in enumerate(skins.items())
        if physics == OURS or pairs[part] == part
    ]
    found = run_repeats(played, tasks, times=OURS_TIMES, **how)
    return {
        (task["physics"], task["skin"].skin.part): tuple(
            touch for one in recordings for touch in recorded_touches(task["skin"], one)
        )
        for task, recordings in zip(tasks, found, strict=True)
    }


def _trainings(
    touched: Mapping[tuple[str, str], tuple[Touch, ...]], pairs: Mapping[str, str], tested: str
) -> list[dict[str, Any]]:
    """What `_train_physics` takes to test on one of the parts and its mirror image."""

    def of(physics: Sequence[str], left: bool) -> tuple[Touch, ...]:
        chosen = [part for part, first in pairs.items() if (first == tested) == left]
        return tuple(t for one in physics for part in chosen for t in touched.get((one, part), ()))

    every = (OURS, *VARIANTS)
    tests = {one: of([one], True) for one in every}
    alone = [(one, [one], tests) for one in (OURS, *TUNING)]
    both = [(BOTH, [o for o in (OURS, *TUNING) if o != one], {one: tests[one]}) for one in every]
    return [
        {"trained_on": name, "train": of(physics, False), "test": tested_on}
        for name, physics, tested_on in (*alone, *both)
    ]


def _train_physics(
    classifier: str,
    trained_on: str,
    train: Sequence[Touch],
    test: Mapping[str, Sequence[Touch]],
    *,
    seed: int,
) -> list[tuple[str, str, list[Named], FloatArray]]:
    """Train once; names of the touches of each physics, and (m, 2) sets that hold the truth, sizes.

    Sizes and truth are NaN for classifiers that are too slow to calibrate sets of.
    """
    sets = classifier in WITH_SETS
    model = classifiers.get(classifier)().fit(train, rng=task_rng(seed), sets=sets)
    if sets:
        model.promise(COVERAGE)
    found = []
    for physics, touches in test.items():
        named, held = [], np.full((len(touches), 2), np.nan)
        for row, touch in enumerate(touches):
            guess = likeliest(model, touch)
            named.append((touch.label, guess.label, float(guess.confidence)))
            names = model.predict(touch).names
            if names is not None:
                held[row] = touch.label in names, len(names)
        found.append((trained_on, physics, named, held))
    return found


SEEN = (0.25, 0.5, 0.75, 1.0)  # shares of a touch that are judged
PRESSES = MOTION_FEATURES.index("presses")
COUNTED = ("tap", "pat")
ALONE, TOGETHER = "still alone", "still among all"  # trainings that name still touches


class Played(NamedTuple):
    """A skin, what was recorded on it, and in which physics."""

    skin: PreparedSkin
    physics: str
    recording: Recording

    def touches(self, gestures: Sequence[str]) -> list[Touch]:
        """Those of some gestures."""
        every = recorded_touches(self.skin, self.recording)
        return [touch for touch in every if touch.label in gestures]


class InTime(NamedTuple):
    """All that the protocol finds.

    Attributes
    ----------
    rows : list of SeenRow
    counted : mapping of str to float
        Share of taps and pats whose presses were counted right, by physics.
    still_alone, still_together : float
        Share of still touches named right by a classifier of these alone, and of all.
    """

    rows: list[SeenRow]
    counted: Mapping[str, float]
    still_alone: float
    still_together: float


def play(
    skins: Mapping[str, PreparedSkin],
    physics: Sequence[str],
    gestures: Sequence[str],
    per_gesture: int,
    seed: int,
    *,
    variety: float = DEFAULT,
    **who: Any,
) -> list[Played]:
    """Touches on each skin, of ours with the four that stay, in each physics.

    `who` are `workers` and `progress` of `run_tasks`.

    Raises
    ------
    MissingLibraryError
        MuJoCo is asked for, and not installed.
    """
    every = {"gestures": (*gestures, *FOUR), "per_gesture": per_gesture}
    fewer = {"gestures": tuple(gestures), "per_gesture": max(2, per_gesture // 4)}
    tasks: list[dict[str, Any]] = [
        {"skin": skin, "seed": (seed, row, column), "physics": one}
        | (every if one == OURS else fewer)
        for row, one in enumerate(physics)
        for column, skin in enumerate(skins.values())
    ]
    made = run_repeats(played, tasks, variety=variety, **who)
    pairs = zip(tasks, made, strict=True)
    return [Played(task["skin"], task["physics"], one) for task, (one,) in pairs]


def evaluate_in_time(
    touched: Mapping[int, Sequence[Played]], *, gestures: Sequence[str] = TIME, **who: Any
) -> InTime:
    """Train on one half of the parts, test on the other, both ways, for what each seed played.

    Raises
    ------
    InvalidArrayError
        Fewer than two skins: none is left to test on.
    """
    every = [one for own in touched.values() for one in own]
    parts = list(dict.fromkeys(one.skin.skin.part for one in every))
    if len(parts) < 2:
        raise InvalidArrayError(f"leaving parts out needs two parts, got {len(parts)}")
    physics = list(dict.fromkeys(one.physics for one in every))
    trainings = [
        (features, {**task, "seed": seed})
        for seed, own in touched.items()
        for hand in (0, 1)
        for features, task in _seen_trainings(own, parts[hand::2], physics, gestures)
    ]
    found = run_repeats(_train_seen, [task for _, task in trainings], **who)
    named: dict[tuple[str, str, float], list[Named]] = {}
    for (features, _), one in zip(trainings, found, strict=True):
        for (world, share), touches in one.items():
            named.setdefault((features, world, share), []).extend(touches)
    stays = {
        features: float(np.mean([true == name for true, name, _ in named.pop(key)]))
        for features in (ALONE, TOGETHER)
        for key in [(features, OURS, 1.0)]
    }
    rows = [
        SeenRow(
            features=features,
            tested_on=world,
            seen=share,
            mean=found.mean,
            per_class=found.per_class,
            confusion=found.confusion,
        )
        for (features, world, share), touches in named.items()
        for found in [judged(OURS, world, gestures, touches)]
    ]
    counted = {one: _counted(every, one) for one in physics}
    return InTime(rows, counted, stays[ALONE], stays[TOGETHER])


def _seen_trainings(
    played: Sequence[Played],
    tested: Sequence[str],
    physics: Sequence[str],
    gestures: Sequence[str],
) -> list[tuple[str, dict[str, Any]]]:
    """Features, and what `_train_seen` takes, where some parts are left out to test on."""

    def of(kinds: Sequence[str], test: bool, world: str = OURS) -> tuple[Touch, ...]:
        own = [one for one in played if one.physics == world]
        chosen = [one for one in own if (one.skin.skin.part in tested) == test]
        return tuple(touch for one in chosen for touch in one.touches(kinds))

    tests = {one: of(gestures, True, one) for one in physics}
    still = {OURS: of(FOUR, True)}
    learnt, four = of(gestures, False), of(FOUR, False)
    return [
        ("contact geometry", {"train": learnt, "test": {OURS: tests[OURS]}, "motion": False}),
        ("and motion", {"train": learnt, "test": tests, "motion": True}),
        (ALONE, {"train": four, "test": still, "shares": (1.0,)}),
        (TOGETHER, {"train": (*learnt, *four), "test": still, "shares": (1.0,)}),
    ]


def _train_seen(
    train: Sequence[Touch],
    test: Mapping[str, Sequence[Touch]],
    *,
    seed: int,
    motion: bool | None = None,
    shares: Sequence[float] = SEEN,
) -> dict[tuple[str, float], list[Named]]:
    """True label, name and confidence of the touches of each physics and share.

    `motion` is whether it is looked at; the classifier chooses, where None.
    """
    model = TouchClassifier("contact-geometry", ContactGeometry(motion=motion), RbfMachine())
    train = learnable(train)
    model.fit(train, rng=task_rng(seed))
    known = {touch.label for touch in train}  # a hand on a small part is nothing to learn
    found = {}
    for world, every in test.items():
        touches = [touch for touch in every if touch.label in known]
        for share in shares:
            guesses = [
                (touch.label, likeliest(model, beginning(touch, share))) for touch in touches
            ]
            found[world, share] = [(true, one.label, one.confidence) for true, one in guesses]
    return found


def beginning(touch: Touch, share: float) -> Touch:
    """The first share of a touch's samples."""
    if share >= 1.0:
        return touch
    count = max(1, round(share * len(touch.samples)))
    return replace(touch, samples=touch.samples[:count])


def _counted(played: Sequence[Played], physics: str) -> float:
    """Share of taps and pats whose presses are counted right."""
    right = []
    for one in played:
        if one.physics != physics or not one.recording.motions:
            continue
        touches = recorded_touches(one.skin, one.recording)
        for touch, truth in zip(touches, one.recording.motions, strict=True):
            if truth is not None and touch.label in COUNTED:
                row = motion_features(one.skin.geometry, touch.samples, touch.rate)
                right.append(row[PRESSES] == len(truth.onsets))
    return float(np.mean(right)) if right else float("nan")
