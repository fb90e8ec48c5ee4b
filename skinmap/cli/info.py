"""`skinmap info`: a recording, or the installation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import click

from skinmap.cli.installation import InstallationInfo, installation, lines
from skinmap.commands.options import open_robot, prints
from skinmap.commands.retired import NO_PROFILE, retired
from skinmap.report.present import present


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordedSkin:
    """The recorded skin, as described in the file.

    Attributes
    ----------
    robot
        Name of the robot; empty where the file has none.
    parts
        In the order of the channels.
    taxels
        Over all parts; null where the file has no table of them.
    fingerprints
        By part, where known.
    """

    robot: str
    parts: list[str]
    taxels: int | None
    fingerprints: dict[str, str]


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordingInfo:
    """Content of a recording.

    Attributes
    ----------
    samples
        Of the whole recording.
    seconds
        From the first sample to the last.
    channels
        Values in a sample.
    rate_hz
        Samples a second; null for fewer than two.
    gaps
        Steps above 1.5 times the median.
    recovered
        Whether the file was cut off or damaged.
    lost_seconds
        Duration of samples that could not be recovered.
    skin
        The skin of the recording.
    """

    samples: int
    seconds: float
    channels: int
    rate_hz: float | None
    gaps: int
    recovered: bool
    lost_seconds: float
    skin: RecordedSkin


@click.command("info")
@click.argument("recording", required=False, type=click.Path(path_type=Path))
@click.option(
    "--robot",
    metavar="ROBOT",
    help="Robot whose skin it must be; it also names a dumper's folders.",
)
@retired(profile=NO_PROFILE)
@prints(RecordingInfo, InstallationInfo)
def command(recording: Path | None, robot: str | None, as_json: bool) -> None:
    """Describe a recording, or the installation.

    RECORDING is MCAP, our .npz, XDF, a data.log or a folder of them: its samples, rate, gaps, skin,
    and the time lost if it was cut off. A damaged file is read as far as possible.

    Without RECORDING: versions, extras and how to install them, display, OpenGL and the cache.

    \b
    Example:  skinmap info touch.mcap --json
    """
    if recording is None:
        if robot is not None:
            raise click.UsageError("--robot needs a RECORDING to check")
        present(installation(), lines, as_json=as_json)
        return
    result, touches, damage = work(recording, robot)
    present(result, lambda info: _lines(info, touches, damage), as_json=as_json)


def work(path: Path, robot: str | None) -> tuple[RecordingInfo, Counter[str], list[str]]:
    """What is in the file, its touches by label, and what is wrong with it in words."""
    from skinmap.live.sources.open_recording import open_track
    from skinmap.live.sources.skins import check_skin

    loaded = open_robot(robot, ())[0] if robot else None
    track = open_track(path, robot=loaded)
    if loaded is not None:
        check_skin(track.info, loaded)
    skin = RecordedSkin(
        robot=track.info.robot or track.manifest,
        parts=list(track.info.parts),
        taxels=sum(len(table) for table in track.tables.values()) or None,
        fingerprints=dict(track.info.fingerprints),
    )
    result = RecordingInfo(
        samples=len(track.times),
        seconds=track.seconds,
        channels=track.info.channels,
        rate_hz=track.info.rate,
        gaps=track.gaps,
        recovered=track.loss.recovered,
        lost_seconds=track.loss.seconds,
        skin=skin,
    )
    return result, Counter(touch.label for touch in track.touches), list(track.loss.damage)


def _lines(info: RecordingInfo, touches: Counter[str], damage: list[str]) -> Iterator[str]:
    rate = float("nan") if info.rate_hz is None else info.rate_hz
    yield (
        f"{info.samples} samples of {info.channels} channels in {info.seconds:.2f} s "
        f"({rate:.4g} a second), {info.gaps} gaps"
    )
    taxels = f", {info.skin.taxels} taxels" if info.skin.taxels else ""
    yield f"{info.skin.robot or 'robot unknown'}: {', '.join(info.skin.parts)}{taxels}"
    for label, count in sorted(touches.items()):
        yield f"{count} touches marked {label!r}"
    if info.recovered:
        yield f"recovered; {info.lost_seconds:.2f} s lost: {'; '.join(damage)}"
