"""`skinmap classify`: name the touches of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from skinmap.cli.common import emit, json_option, open_robot, part_option, robot_option, table

if TYPE_CHECKING:
    from skinmap.skin.robot import Robot
    from skinmap.touch.prepared import PreparedSkin
    from skinmap.touch.recording import Recording


@click.command("classify")
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("recording", type=click.Path(path_type=Path))
@robot_option
@part_option
@json_option
def command(
    model: Path, recording: Path, robot: str, parts: tuple[str, ...], as_json: bool
) -> None:
    """Name each touch event of a recording, with a confidence from 0 to 1.

    \b
    Example:  skinmap classify touch.skinmodel touches.npz --part right_forearm --json
    """
    from skinmap.classify.descriptors import Touch
    from skinmap.classify.model_file import load_classifier
    from skinmap.touch.recording import load_recordings

    classifier = load_classifier(model)
    recordings = load_recordings(recording)
    loaded, wanted = open_robot(robot, parts)
    chosen = [one for one in recordings if one.part in wanted]
    skins = prepare_skins(loaded, chosen)
    rows = []
    for one in chosen:
        for event, label, samples in one.touches():
            named = classifier.predict(Touch(skins[one.part], samples))
            rows.append(
                {
                    "part": one.part,
                    "event": event,
                    "label": named.label,
                    "confidence": named.confidence,
                    "recorded_label": label,
                }
            )
    right = sum(row["label"] == row["recorded_label"] for row in rows)
    if as_json:
        accuracy = right / len(rows) if rows else None
        emit({"classifier": classifier.name, "touches": rows, "accuracy": accuracy})
        return
    table(
        ["part", "event", "label", "confidence", "recorded"],
        [
            [row["part"], row["event"], row["label"], row["confidence"], row["recorded_label"]]
            for row in rows
        ],
    )
    click.echo(f"{right} of {len(rows)} as recorded")


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
    from skinmap.touch.prepared import PreparedSkin

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
