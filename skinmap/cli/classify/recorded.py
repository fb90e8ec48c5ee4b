"""`skinmap classify` on recordings: the touches of each event, named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray
from skinmap.classify.classifier import NO_CONTACT, Prediction, TouchClassifier
from skinmap.classify.naming import JOIN, all_right, name_touches, true_labels
from skinmap.cli.classify.result import ClassifyResult, Health, NamedRow, NameSets
from skinmap.commands.options import open_robot
from skinmap.errors import SkinMismatchError, UnknownNameError
from skinmap.io.recordings.touch_files import load_recordings
from skinmap.live.contacts.contact_motion import MotionBook, recorded_course
from skinmap.live.robot_skin import JoinedSkin
from skinmap.touch.grouping import GroupingRule
from skinmap.touch.motion_features import MM, MOTION_FEATURES, motion_features
from skinmap.touch.prepared_skin import PreparedSkin, prepare_skins
from skinmap.touch.recording import Recording


def work(
    classifier: TouchClassifier,
    path: Path,
    robot: str | None,
    parts: tuple[str, ...],
    rule: GroupingRule,
) -> ClassifyResult:
    """Name the touches of each event and compare them with what was recorded."""
    recordings = load_recordings(path)
    loaded, wanted = open_robot(robot, parts)
    chosen = [one for one in recordings if one.part in wanted]
    if not chosen:
        asked = parts[0] if parts else f"any of {loaded.name}"
        raise UnknownNameError("recorded part", asked, [one.part for one in recordings])
    skins = prepare_skins(loaded, chosen)
    check_model(classifier, skins, chosen)
    rows: list[NamedRow] = []
    right = 0
    for one in chosen:
        found, hits = _name_events(classifier, skins[one.part], one, rule)
        rows.extend(found)
        right += hits
    events = sum(len(one.labels) for one in chosen)
    return ClassifyResult(
        classifier=classifier.name,
        touches=rows,
        events=events,
        accuracy=right / events if events else None,
        sets=_sets(classifier, rows),
        health=_health(chosen, skins),
    )


def _sets(classifier: TouchClassifier, rows: Sequence[NamedRow]) -> NameSets | None:
    """How the promised coverage was kept; None where none was asked for."""
    if classifier.coverage is None:
        return None
    names = [row.names or [] for row in rows]
    held = [row.recorded_label in own for row, own in zip(rows, names, strict=True)]
    return NameSets(
        coverage=classifier.coverage,
        held=float(np.mean(held)) if held else None,
        mean_size=float(np.mean([len(own) for own in names])) if names else None,
    )


def _health(
    recordings: Sequence[Recording], skins: Mapping[str, PreparedSkin]
) -> dict[str, Health]:
    """Channels that hang or are noisy between the touches, by part."""
    found = {one.part: one.rest() for one in recordings}
    channels = {part: skins[part].skin.channels for part in found}
    return {
        part: Health(
            stuck=channels[part][rest.stuck].tolist(), noisy=channels[part][rest.noisy].tolist()
        )
        for part, rest in found.items()
        if rest.stuck.any() or rest.noisy.any()
    }


def _name_events(
    classifier: TouchClassifier,
    skin: PreparedSkin,
    recording: Recording,
    rule: GroupingRule,
) -> tuple[list[NamedRow], int]:
    """A row for each touch of each event, and how many events were understood in full."""
    step = np.diff(recording.times)
    rate = 1.0 / float(np.median(step)) if len(step) and np.median(step) > 0 else 50.0
    rule = GroupingRule(span=rule.span, together=rule.together, rate=rate)
    rows = []
    right = 0
    rest, book = recording.rest(), MotionBook(JoinedSkin({recording.part: skin}))
    for event, label, samples in recording.touches():
        owners = None if recording.owners is None else recording.owners[event]
        person = int(recording.subjects[event])
        named = name_touches(classifier, skin, samples, rule=rule, rest=rest, person=person)
        right += all_right(named, samples, label, owners)
        moved = [_motion(skin, book, samples, one.taxels, rate) for one in named]
        moved = moved or [_motion(skin, book, samples[:0], np.zeros(len(skin), bool), rate)]
        alone = None if classifier.coverage is None else (NO_CONTACT,)
        nothing = Prediction(NO_CONTACT, 1.0, alone)
        said = [one.prediction for one in named] or [nothing]
        truth = true_labels(named, samples, label, owners)
        for number, (one, recorded) in enumerate(zip(said, truth or [label], strict=True)):
            row = NamedRow(
                part=recording.part,
                event=event,
                touch=number,
                label=one.label,
                confidence=one.confidence,
                names=None if one.names is None else list(one.names),
                recorded_label=recorded,
                **moved[number],
            )
            rows.append(row)
    return rows, right


def _motion(
    skin: PreparedSkin,
    book: MotionBook,
    samples: NDArray[np.uint8],
    taxels: BoolArray,
    rate: float,
) -> dict[str, Any]:
    """What a row says of how a touch went on."""
    own = np.where(taxels, samples, 0).astype(np.uint8)
    found = motion_features(skin.geometry, own, rate)
    number = dict(zip(MOTION_FEATURES, found.tolist(), strict=True))
    presses = int(number["presses"])
    course = recorded_course(book, own, rate)
    return {
        "heading": course.heading,
        "up_mm": course.up * MM,
        "right_mm": course.right * MM,
        "way_mm": number["way_mm"],
        "speed_mm_s": number["speed_mm_s"],
        "presses": presses,
        "period_ms": number["period_ms"] if presses > 1 else None,
        "twist_deg": number["turned_deg"],
    }


def check_model(
    classifier: TouchClassifier,
    skins: Mapping[str, PreparedSkin],
    recordings: Sequence[Recording],
) -> None:
    """Refuse skins that a model cannot name touches on; say what else does not fit.

    Raises
    ------
    SkinMismatchError
        A model that reads taxels by their number, and another skin.
    """
    for skin in skins.values():
        difference = classifier.difference(skin.skin)
        if not difference.may_go_on:
            raise SkinMismatchError(f"{classifier.name!r} cannot go on: {difference.message}")
        if difference.message:
            click.echo(f"note: {difference.message}", err=True)
    recorded = {kind for one in recordings for label in one.labels for kind in label.split(JOIN)}
    strange = sorted(recorded - set(classifier.labels))
    if strange:
        click.echo(
            f"note: recorded as {', '.join(strange)}, which the model cannot say; "
            f"it knows {', '.join(classifier.labels)}",
            err=True,
        )
