"""`skinmap replay`: a recording as if it happened now."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

import click

from skinmap.commands import options
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
@click.argument("recording", type=options.PATH)
@options.played_robot_option
@options.part_option
@options.publish_option("the samples")
@options.speed_option("recorded")
@click.option("--loop", is_flag=True, help="Start again at the end, until Ctrl-C.")
@options.seconds_option("Stop after this time [s].")
@options.prints(ReplayResult)
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
    from skinmap.live.publishing.publish import open_publisher, stream
    from skinmap.live.sources.open_source import open_recording

    loaded = options.open_robot(robot, ())[0] if robot else None
    source = open_recording(recording, robot=loaded, parts=parts or None, speed=speed, loop=loop)
    with closing(source), ExitStack() as ended:
        publisher = None
        if publish:
            opened = open_publisher(publish, source.info, robot=loaded, speed=speed)
            publisher = ended.enter_context(opened)
        began = time.perf_counter()
        sent, _ = stream(source, publisher, seconds)
        took = time.perf_counter() - began
    result = ReplayResult(samples=sent, seconds=took, published=publish)
    present(result, _lines, as_json=as_json)


def _lines(result: ReplayResult) -> Iterator[str]:
    yield f"{result.samples} samples in {result.seconds:.2f} s"
