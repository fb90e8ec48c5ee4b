"""`skinmap classify`: name the touches of a recording, or of what comes live."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinmap.commands.options import json_option, open_robot, part_option, robot_option, seed_option
from skinmap.commands.profiles import profile_option
from skinmap.report.present import emit
from skinmap.report.table import table

if TYPE_CHECKING:
    from skinmap.classify.classifier import TouchClassifier
    from skinmap.skin.robot import Robot
    from skinmap.touch.grouping import GroupingRule
    from skinmap.touch.prepared_skin import PreparedSkin
    from skinmap.touch.recording import Recording


@click.command("classify")
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("source")
@robot_option
@part_option
@click.option(
    "--span-mm",
    type=click.FloatRange(min=1.0),
    default=200.0,
    show_default=True,
    help="A spread hand: contacts further apart are separate touches.",
)
@click.option(
    "--together-ms",
    type=click.FloatRange(min=1.0),
    default=80.0,
    show_default=True,
    help="Contacts that begin and end within this time are one grip.",
)
@click.option(
    "--seconds",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Stop after so long; live sources only.",
)
@click.option(
    "--publish",
    multiple=True,
    metavar="SPEC",
    help="Let others follow pressures, contacts and labels: lsl:NAME or zmq:PORT.",
)
@click.option(
    "--response",
    "responses",
    multiple=True,
    metavar="[PART=]FILE",
    help="Response calibration of a part that sends raw values.",
)
@seed_option
@profile_option("classify")
@json_option
def command(
    model: Path,
    source: str,
    robot: str,
    parts: tuple[str, ...],
    span_mm: float,
    together_ms: float,
    seconds: float | None,
    publish: tuple[str, ...],
    responses: tuple[str, ...],
    seed: int,
    as_json: bool,
) -> None:
    """Name touches with a confidence from 0 to 1.

    SOURCE is a recording of marked touches (.npz, .mcap), whose names are compared with the
    recorded ones, or whatever can be followed: sim, lsl:NAME, zmq:HOST:PORT, a recording without
    marks (.mcap, .xdf, data.log), which gives a line a touch when it ends and a summary at the
    end; with --json each line is an object.

    Several touches at once on one part are told apart and named each. `no_contact` is said where
    nothing is touched, `unknown` where the model is less sure than it was on held-out touches.

    \b
    Example:  skinmap classify touch.skinmodel touches.npz --part right_forearm --json
              skinmap classify touch.skinmodel lsl:demo --seconds 60 --json
    """
    from skinmap.classify.model_file import load_classifier
    from skinmap.touch.grouping import GroupingRule

    classifier = load_classifier(model)
    rule = GroupingRule(span=span_mm / 1e3, together=together_ms / 1e3)
    live = not holds_events(source)
    if live or publish or seconds is not None:
        from skinmap.cli.classify.live import classify_live

        classify_live(
            classifier,
            source,
            robot=robot,
            parts=parts,
            rule=rule,
            seconds=seconds,
            seed=seed,
            publish=publish,
            responses=responses,
            as_json=as_json,
        )
        return
    _classify_events(classifier, Path(source), robot, parts, rule, as_json=as_json)


def holds_events(source: str) -> bool:
    """Whether a source is a recording of pressures whose touches were marked."""
    path = Path(source)
    if path.suffix.lower() != ".mcap" or not path.is_file():
        return path.suffix.lower() == ".npz"
    from skinmap.io.recordings.mcap_track import read_track

    track = read_track(path)
    return track.kind == "pressure" and len(track.touches) > 0


def _classify_events(
    classifier: TouchClassifier,
    path: Path,
    robot: str,
    parts: tuple[str, ...],
    rule: GroupingRule,
    *,
    as_json: bool,
) -> None:
    """Name the touches of each event and compare them with what was recorded."""
    from skinmap.errors import UnknownNameError
    from skinmap.io.recordings.touch_files import load_recordings

    recordings = load_recordings(path)
    loaded, wanted = open_robot(robot, parts)
    chosen = [one for one in recordings if one.part in wanted]
    if not chosen:
        asked = parts[0] if parts else f"any of {loaded.name}"
        raise UnknownNameError("recorded part", asked, [one.part for one in recordings])
    skins = prepare_skins(loaded, chosen)
    check_model(classifier, skins, chosen)
    rows: list[dict[str, Any]] = []
    right = 0
    for one in chosen:
        found, hits = _name_events(classifier, skins[one.part], one, rule)
        rows.extend(found)
        right += hits
    events = sum(len(one.labels) for one in chosen)
    if as_json:
        accuracy = right / events if events else None
        emit(
            {
                "classifier": classifier.name,
                "touches": rows,
                "events": events,
                "accuracy": accuracy,
            }
        )
        return
    keys = ("part", "event", "touch", "label", "confidence", "recorded_label")
    table([*keys[:-1], "recorded"], [[row[key] for key in keys] for row in rows])
    click.echo(f"{right} of {events} as recorded")


def _name_events(
    classifier: TouchClassifier,
    skin: PreparedSkin,
    recording: Recording,
    rule: GroupingRule,
) -> tuple[list[dict[str, Any]], int]:
    """A row for each touch of each event, and how many events were understood in full."""
    import numpy as np

    from skinmap.classify.classifier import NO_CONTACT
    from skinmap.classify.naming import all_right, name_touches, true_labels
    from skinmap.touch.grouping import GroupingRule as Rule  # the type alone above

    step = np.diff(recording.times)
    rate = 1.0 / float(np.median(step)) if len(step) and np.median(step) > 0 else 50.0
    rule = Rule(span=rule.span, together=rule.together, rate=rate)
    rows = []
    right = 0
    for event, label, samples in recording.touches():
        owners = None if recording.owners is None else recording.owners[event]
        named = name_touches(classifier, skin, samples, rule=rule)
        right += all_right(named, samples, label, owners)
        said = [(one.prediction.label, one.prediction.confidence) for one in named]
        truth = true_labels(named, samples, label, owners)
        for number, ((name, sure), recorded) in enumerate(
            zip(said or [(NO_CONTACT, 1.0)], truth or [label], strict=True)
        ):
            rows.append(
                {
                    "part": recording.part,
                    "event": event,
                    "touch": number,
                    "label": name,
                    "confidence": sure,
                    "recorded_label": recorded,
                }
            )
    return rows, right


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
    from skinmap.classify.naming import JOIN
    from skinmap.errors import SkinMismatchError

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


def prepare_skins(robot: Robot, recordings: Sequence[Recording]) -> dict[str, PreparedSkin]:
    """The skins of recorded parts; taxels and channels must agree.

    Raises
    ------
    UnknownNameError
        A recorded part that the robot lacks.
    SkinMismatchError
        A recording of another number of taxels.
    """
    from skinmap.errors import SkinMismatchError
    from skinmap.touch.prepared_skin import PreparedSkin

    skins = {}
    for recording in recordings:
        skin = PreparedSkin(robot.skin(recording.part))
        if recording.pressures.shape[1] != len(skin):
            raise SkinMismatchError(
                f"the recording of {recording.part!r} has {recording.pressures.shape[1]} taxels, "
                f"the skin of {robot.name} has {len(skin)}"
            )
        skins[recording.part] = skin
    return skins
