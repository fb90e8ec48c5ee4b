"""`skinmap simulate --publish`: simulated touches as a live stream."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import click
import numpy as np

from skinmap.cli.simulate.result import StreamResult
from skinmap.commands.options import open_robot


def publish_touches(
    robot: str,
    parts: tuple[str, ...],
    spec: str,
    *,
    gestures: Sequence[str],
    seconds: float | None,
    raw: bool,
    seed: int,
    variety: float,
    sensing: Mapping[str, Any],
) -> StreamResult:
    """Stream touches until `seconds` have passed or Ctrl-C comes, then say what was sent."""
    from skinmap.live.publishing.publish import open_publisher, stream
    from skinmap.live.sources.simulator import SimulatedSource
    from skinmap.touch.gestures import gesture_set
    from skinmap.touch.variety import draw_sensing

    loaded, names = open_robot(robot, parts)
    answers = replace(draw_sensing(variety, rng=np.random.default_rng(seed)), **sensing)
    source = SimulatedSource(
        loaded,
        parts=names,
        seed=seed,
        kind="raw" if raw else "pressure",
        gestures=gesture_set(gestures),
        variety=variety,
        sensing=answers,
        seconds=float("inf") if seconds is None else seconds,
    )
    interrupted, began = False, time.perf_counter()
    try:
        info = source.info
        with open_publisher(spec, info, topics=(info.kind,), robot=loaded) as publisher:
            until = "ends by itself" if seconds is not None else "Ctrl-C ends it"
            click.echo(
                f"publishing {info.channels} channels of {loaded.name} at {info.rate:g} Hz as "
                f"{spec}; {until}",
                err=True,
            )
            began = time.perf_counter()
            try:
                stream(source, publisher)
            except KeyboardInterrupt:
                interrupted = True
            took = time.perf_counter() - began
            sent = publisher.sent
    finally:
        source.close()
    played = sent / info.rate
    labels = Counter(touch.label for touch in source.truth if touch.began < played)
    return StreamResult(
        robot=loaded.name,
        seed=seed,
        publish=spec,
        kind=info.kind,
        rate_hz=info.rate,
        parts=list(names),
        channels=info.channels,
        samples=sent,
        seconds=took,
        behind_s=max(0.0, took - played),
        touches=labels,
        interrupted=interrupted,
    )
