"""Touches in time: named with and without their motion, whole and while they still go on.

Parts are left out: the skins are dealt into two hands, one trains while the other tests, and mirror
images never stand on both sides. Each part is touched by people of its own, so people are left out
as well. The judge that can fail is the same classifier without motion, and a second physics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skinmap.errors import InvalidArrayError
from skinmap.parallel.run import run_tasks, task_rng
from skinmap.recognition.classifier import TouchClassifier, learnable
from skinmap.recognition.descriptors import ContactGeometry, Touch, recorded_touches
from skinmap.recognition.evaluate import likeliest
from skinmap.recognition.protocols.cross_patch import OURS, Playing, played
from skinmap.recognition.protocols.physics import Named, judged
from skinmap.recognition.protocols.results import SeenRow
from skinmap.recognition.rbf_machine import RbfMachine
from skinmap.touch.contacts.motion_features import MOTION_FEATURES, motion_features
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.gestures import FOUR, TIME
from skinmap.touch.simulation.variety import DEFAULT

SEEN = (0.25, 0.5, 0.75, 1.0)  # shares of a touch that are judged
PRESSES = MOTION_FEATURES.index("presses")
COUNTED = ("tap", "pat")
ALONE, TOGETHER = "still alone", "still among all"  # trainings that name still touches


@dataclass(frozen=True, eq=False, slots=True)
class Played:
    """A skin, what was recorded on it, and in which physics."""

    skin: PreparedSkin
    physics: str
    recording: Recording

    def touches(self, gestures: Sequence[str]) -> list[Touch]:
        """Those of some gestures."""
        every = recorded_touches(self.skin, self.recording)
        return [touch for touch in every if touch.label in gestures]


@dataclass(frozen=True, eq=False, slots=True)
class InTime:
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


@dataclass(frozen=True, eq=False, slots=True)
class _Training:
    features: str
    motion: bool | None  # whether it is looked at; what the classifier chooses, where None
    train: tuple[Touch, ...]
    test: Mapping[str, tuple[Touch, ...]]
    shares: tuple[float, ...]
    seed: int


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
    tasks = [
        Playing(
            skin,
            (*gestures, *FOUR) if one == OURS else tuple(gestures),
            per_gesture if one == OURS else max(2, per_gesture // 4),
            variety,
            (seed, row, column),
            one,
        )
        for row, one in enumerate(physics)
        for column, skin in enumerate(skins.values())
    ]
    made = run_tasks(played, tasks, **who)
    return [Played(task.skin, task.physics, one) for task, (one,) in zip(tasks, made, strict=True)]


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
        task
        for seed, own in touched.items()
        for hand in (0, 1)
        for task in _trainings(own, parts[hand::2], physics, gestures, seed)
    ]
    found = run_tasks(_train, trainings, **who)
    named: dict[tuple[str, str, float], list[Named]] = {}
    for task, one in zip(trainings, found, strict=True):
        for (world, share), touches in one.items():
            named.setdefault((task.features, world, share), []).extend(touches)
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


def _trainings(
    played: Sequence[Played],
    tested: Sequence[str],
    physics: Sequence[str],
    gestures: Sequence[str],
    seed: int,
) -> list[_Training]:
    """What is trained where some parts are left out to test on."""

    def of(kinds: Sequence[str], test: bool, world: str = OURS) -> tuple[Touch, ...]:
        own = [one for one in played if one.physics == world]
        chosen = [one for one in own if (one.skin.skin.part in tested) == test]
        return tuple(touch for one in chosen for touch in one.touches(kinds))

    tests = {one: of(gestures, True, one) for one in physics}
    still = {OURS: of(FOUR, True)}
    learnt, four = of(gestures, False), of(FOUR, False)
    return [
        _Training("contact geometry", False, learnt, {OURS: tests[OURS]}, SEEN, seed),
        _Training("and motion", True, learnt, tests, SEEN, seed),
        _Training(ALONE, None, four, still, (1.0,), seed),
        _Training(TOGETHER, None, (*learnt, *four), still, (1.0,), seed),
    ]


def _train(task: _Training) -> dict[tuple[str, float], list[Named]]:
    """True label, name and confidence of the touches of each physics and share."""
    machine = ContactGeometry(motion=task.motion)
    model = TouchClassifier("contact-geometry", machine, RbfMachine())
    train = learnable(task.train)
    model.fit(train, rng=task_rng(task.seed))
    known = {touch.label for touch in train}  # a hand on a small part is nothing to learn
    found = {}
    for world, every in task.test.items():
        touches = [touch for touch in every if touch.label in known]
        for share in task.shares:
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
