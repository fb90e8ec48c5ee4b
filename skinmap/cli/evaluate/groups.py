"""Sessions, people, places and parts left out in turn, and the control beside each figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from skinmap.cli.evaluate.result.recordings import LeftOutRow
from skinmap.errors import InvalidArrayError, UnknownNameError

if TYPE_CHECKING:
    from skinmap.classify.protocols.left_out import Control, LeftOutTrial
    from skinmap.cli.collection import Collected, Collection
    from skinmap.cli.evaluate.evaluation import Settings


def judged_touches(collection: Collection, only: Sequence[str]) -> list[Collected]:
    """The touches with one label each that were asked for; several at once are left out.

    Raises
    ------
    InvalidArrayError
        Touches without a label, labels that differ in spelling only, or no touch at all.
    UnknownNameError
        A label that nobody recorded.
    """
    from skinmap.classify.protocols.recordings import TOGETHER, check_spelling

    for one in collection.touches:
        if not one.touch.label.strip():
            raise InvalidArrayError(f"a touch of {one.part!r} in {one.file} has no label")
    found = [one for one in collection.touches if TOGETHER not in one.touch.label]
    known = sorted({one.touch.label for one in found})
    if not known:
        raise InvalidArrayError(
            "no marked touch in the recordings; mark them with `skinmap record --label` or "
            "`skinmap label`"
        )
    check_spelling(known)
    for name in only:
        if name not in known:
            raise UnknownNameError("recorded gesture", name, known)
    return [one for one in found if not only or one.touch.label in only]


def judge_groups(
    settings: Settings, chosen: Sequence[Collected], names: Sequence[str]
) -> list[LeftOutRow]:
    """A row for touches dealt out and for each kind of group left out, of each classifier."""
    from skinmap.classify.protocols.left_out import (
        NAIVE,
        Judged,
        LeftOutTrial,
        places_of,
        run_left_out,
    )
    from skinmap.parallel.run import run_tasks

    touches = tuple(one.touch for one in chosen)
    groups = {
        "session": np.array([one.session for one in chosen]),
        "person": np.array([one.person for one in chosen]),
        "part": np.array([f"{one.robot} {one.part}" for one in chosen]),
    }
    if "place" in settings.leave_out:
        groups["place"] = places_of(touches)
    judged = Judged(
        touches, groups, tuple(one.before for one in chosen), tuple(one.first for one in chosen)
    )
    trials = [
        LeftOutTrial(name, judged, way, settings.folds, settings.seed, settings.leaks)
        for name in names
        for way in (NAIVE, *dict.fromkeys(settings.leave_out))
    ]
    found = run_tasks(run_left_out, trials, workers=settings.workers)
    return [_row(trial, one) for trial, one in zip(trials, found, strict=True)]


def _row(trial: LeftOutTrial, found: dict[str, Any]) -> LeftOutRow:
    from skinmap.classify.protocols.left_out import meaning_of

    judged = trial.judged
    own = judged.groups.get(trial.way)
    meaning, verdict = None, found.get("reason", "")
    if trial.leaks and not verdict:
        sessions, labels = judged.groups["session"], judged.labels
        alone = [
            str(label)
            for label in np.unique(labels)
            if len(np.unique(sessions[labels == label])) == 1
        ]
        meaning, verdict = meaning_of(found, trial.way, judged, alone)
    return LeftOutRow(
        classifier=trial.classifier,
        left_out=trial.way,
        groups=len(judged.touches) if own is None else len(np.unique(own)),
        per_class=found.get("per_class", {}),
        mean=found.get("mean"),
        right=found.get("right"),
        chance=judged.chance,
        control=_known(found.get("control")),
        first=_known(found.get("first")),
        raw=_known(found.get("raw")),
        meaning=meaning,
        verdict=verdict,
    )


def _known(control: Control | None) -> float | None:
    return None if control is None or control.share != control.share else control.share
