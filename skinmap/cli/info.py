"""`skinmap info`: what a recording holds, and what it lacks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinmap.cli.shared.common import emit, json_option, profile_option

if TYPE_CHECKING:
    from skinmap.io.recordings.recorded_stream import RecordedStream
    from skinmap.skin.robot import Robot


@click.command("info")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--robot", help="Robot whose skin it must be; it also names a dumper's folders.")
@profile_option()
@json_option
def command(recording: Path, robot: str | None, as_json: bool) -> None:
    """Say what a recording holds: samples, rate, gaps, skin, and what was lost if it was cut off.

    RECORDING is MCAP, our .npz, XDF, a data.log or a folder of them. What can be had of a cut or
    damaged file is collected without being asked.

    \b
    Example:  skinmap info touch.mcap --json
    """
    from skinmap.cli.shared.common import open_robot
    from skinmap.live.sources.open_recording import open_track

    loaded = open_robot(robot, ())[0] if robot else None
    track = open_track(recording, robot=loaded)
    if loaded is not None:
        _check_skin(track, loaded)
    result = describe(track)
    if as_json:
        emit(result)
        return
    skin = result["skin"]
    taxels = f", {skin['taxels']} taxels" if skin["taxels"] else ""
    click.echo(
        f"{result['samples']} samples of {result['channels']} channels in "
        f"{result['seconds']:.2f} s ({result['rate_hz']:.4g} a second), {result['gaps']} gaps"
    )
    click.echo(f"{skin['robot'] or 'robot unknown'}: {', '.join(skin['parts'])}{taxels}")
    for touch in sorted({touch.label for touch in track.touches}):
        count = sum(one.label == touch for one in track.touches)
        click.echo(f"{count} touches marked {touch!r}")
    if result["recovered"]:
        click.echo(
            f"recovered; {result['lost_seconds']:.2f} s lost: {'; '.join(track.loss.damage)}"
        )


def describe(track: RecordedStream) -> dict[str, Any]:
    """The keys of `skinmap info --json`."""
    taxels = sum(len(table) for table in track.tables.values())
    return {
        "samples": len(track.times),
        "seconds": track.seconds,
        "channels": track.channels,
        "rate_hz": track.rate,
        "gaps": track.gaps,
        "recovered": track.loss.recovered,
        "lost_seconds": track.loss.seconds,
        "skin": {
            "robot": track.robot,
            "parts": list(track.parts),
            "taxels": taxels or None,
            "fingerprints": dict(track.fingerprints),
        },
    }


def _check_skin(track: RecordedStream, robot: Robot) -> None:
    from skinmap.live.sources.open_recording import stream_info
    from skinmap.live.sources.skins import check_skin

    check_skin(stream_info(track), robot)
