"""`skinmap replay`: a recording as if it happened now."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from skinmap.commands.options import (
    PATH,
    open_robot,
    part_option,
    prints,
    publish_option,
    seconds_option,
    speed_option,
)
from skinmap.commands.retired import NO_PROFILE, retired
from skinmap.report.present import present


@dataclass(frozen=True, kw_only=True, slots=True)
class ReplayResult:
    """Summary of a played recording.

    Attributes
    ----------
    samples, seconds
        Sent, and how long that took.
    published
        Address of the publication; null without one.
    """

    samples: int
    seconds: float
    published: str | None


@click.command("replay")
@click.argument("recording", type=PATH)
@click.option(
    "--robot",
    metavar="ROBOT",
    help="Robot whose skin it must be; it also names a dumper's folders.",
)
@part_option
@publish_option("the samples")
@speed_option("recorded")
@click.option("--loop", is_flag=True, help="Start again at the end, until Ctrl-C.")
@seconds_option("Stop after this time [s].")
@retired(profile=NO_PROFILE)
@prints(ReplayResult)
def command(
    recording: Path,
    robot: str | None,
    parts: tuple[str, ...],
    publish: str | None,
    speed: float,
    loop: bool,
    seconds: float | None,
    as_json: bool,
) -> None:
    """Play RECORDING in its own time, and publish it so that other programs can follow.

    \b
    Example:  skinmap replay touch.mcap --publish lsl:demo --loop
    """
    from skinmap.live.publishing.publish import open_publisher
    from skinmap.live.sources.open_recording import open_recording

    loaded = open_robot(robot, ())[0] if robot else None
    source = open_recording(recording, robot=loaded, parts=parts or None, speed=speed, loop=loop)
    publisher = None
    try:
        publisher = open_publisher(publish, source.info, robot=loaded) if publish else None
        sent, played = _play(source, publisher, seconds)
    finally:
        source.close()
        if publisher is not None:
            publisher.close()
    result = ReplayResult(samples=sent, seconds=played, published=publish)
    present(result, _lines, as_json=as_json)


def _play(source: Any, publisher: Any, seconds: float | None) -> tuple[int, float]:
    """Samples sent, and how long it took [s]."""
    import time

    from skinmap.live.sources.source import SourceEnded

    began, sent = time.perf_counter(), 0
    try:
        while seconds is None or time.perf_counter() - began < seconds:
            block = source.read(0.5)
            if block is None:
                continue
            sent += len(block)
            if publisher is not None:
                publisher.send_block(block)
    except (SourceEnded, KeyboardInterrupt):
        pass
    return sent, time.perf_counter() - began


def _lines(result: ReplayResult) -> Iterator[str]:
    yield f"{result.samples} samples in {result.seconds:.2f} s"
