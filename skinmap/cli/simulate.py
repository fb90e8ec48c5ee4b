"""`skinmap simulate`: simulated touches on the skin, as a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from skinmap.cli.common import (
    emit,
    json_option,
    open_robot,
    part_option,
    progress,
    robot_argument,
    seed_option,
)


@click.command("simulate")
@robot_argument
@part_option
@click.option(
    "--per-gesture",
    type=click.IntRange(min=1),
    default=20,
    show_default=True,
    help="Touches of each gesture on each part.",
)
@click.option("--gesture", "gestures", multiple=True, help="Only this gesture; may be repeated.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("touches.npz"),
    show_default=True,
    help="Recording to write.",
)
@seed_option
@json_option
def command(
    robot: str,
    parts: tuple[str, ...],
    per_gesture: int,
    gestures: tuple[str, ...],
    output: Path,
    seed: int,
    as_json: bool,
) -> None:
    """Simulate touches at random places and write them with event numbers and labels.

    \b
    Example:  skinmap simulate icub --part torso --per-gesture 30 -o torso.npz
    """
    import numpy as np

    from skinmap.io.output import staged_file
    from skinmap.touch.gestures import FOUR
    from skinmap.touch.recording import save_recordings
    from skinmap.touch.simulator import simulate

    loaded, names = open_robot(robot, parts)
    wanted = gestures or FOUR
    recordings = []
    with (
        staged_file(output) as stage,
        progress(len(names) * len(wanted) * per_gesture, "simulating") as advance,
    ):
        for name, rng in zip(names, np.random.default_rng(seed).spawn(len(names)), strict=True):
            recordings.append(
                simulate(
                    loaded.skin(name),
                    rng=rng,
                    per_gesture=per_gesture,
                    gestures=wanted,
                    progress=advance,
                )
            )
        save_recordings(recordings, stage)
    rows: list[dict[str, Any]] = [
        {
            "part": recording.part,
            "samples": len(recording.times),
            "touches": {name: recording.labels.count(name) for name in wanted},
        }
        for recording in recordings
    ]
    if as_json:
        emit({"robot": loaded.name, "seed": seed, "parts": rows, "files": [output]})
        return
    for row in rows:
        counts = ", ".join(f"{count} {name}" for name, count in row["touches"].items())
        click.echo(f"{row['part']}: {row['samples']} samples, {counts}")
    click.echo(str(output))
