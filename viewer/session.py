"""What `skinmap view` needs before anything is drawn: skins, source, loop, names."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.classify.classifier import TouchClassifier
from skinmap.classify.model_file import load_classifier
from skinmap.errors import SkinError, UnknownNameError, UnreachableError
from skinmap.live.loop import TouchLoop
from skinmap.live.moment import Moment
from skinmap.live.sources.open_source import open_source
from skinmap.live.sources.source import Seekable, Source, SourceEnded
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.inputs import default_classifier
from viewer.playing.stepwise import OneByOne, stepwise

LIVE = 5.0  # how long a live source is watched for a picture or a movie [s]
MADE = 12.0  # how long recordings and the simulator are, for a picture [s]
LEAD = 1.0  # of a recording before the time asked for: touches are named from their past [s]
STEP = 0.2  # longest wait for a sample before the clock is looked at [s]
SILENCE = 5.0  # a live source that sends nothing for so long gives no picture [s]


@dataclass(eq=False)
class Session:
    """A robot, some of its parts, and what is to be shown on them.

    Attributes
    ----------
    robot : Robot
    parts : tuple of str
        Parts asked for.
    source : str
        As for `skinmap.live.open_source`.
    model : Path or None
        Names the touches; without one a small classifier is trained.
    seed : int
    speed, loop
        Of recordings.
    responses : mapping of str to ResponseCalibration
    covariances : mapping of str to (n, 3, 3) array
    """

    robot: Robot
    parts: tuple[str, ...]
    source: str = "sim"
    model: Path | None = None
    seed: int = 0
    speed: float = 1.0
    loop: bool = False
    responses: Mapping[str, Any] = field(default_factory=dict)
    covariances: Mapping[str, FloatArray] = field(default_factory=dict)
    skins: dict[str, PreparedSkin] = field(default_factory=dict)

    def prepare(self) -> None:
        """Prepare the skins that are shown."""
        self.skins = {part: PreparedSkin(self.robot.skin(part)) for part in self.parts}

    @property
    def healths(self) -> dict[str, Any]:
        """Health states by part, from the response calibrations."""
        return {part: response.health for part, response in self.responses.items()}

    def open(self, *, hurry: bool = False) -> Source:
        """Open the source; `hurry` for as fast as it is asked."""
        speed = math.inf if hurry else self.speed
        return open_source(
            self.source,
            robot=self.robot,
            parts=self.parts if self.simulated else None,
            seed=self.seed,
            speed=speed,
            loop=self.loop and not hurry,
        )

    def touch_loop(self, source: Source, classifier: TouchClassifier | None) -> TouchLoop:
        """The loop on a source, for the parts shown that it has.

        Raises
        ------
        UnknownNameError
            A source without any of the parts.
        """
        shared = [part for part in source.info.parts if part in self.skins]
        if not shared:
            source.close()
            raise UnknownNameError(
                f"part in {source.info.name!r}", ", ".join(self.parts), source.info.parts
            )
        return TouchLoop(
            self.robot,
            source,
            classifier=classifier,
            responses={p: r for p, r in self.responses.items() if p in shared},
            parts=shared,
            skins=self.skins,
            reopen=lambda: stepwise(self.open()),
        )

    def classifier(self) -> TouchClassifier:
        """The model asked for, or a small one, trained here and now."""
        if self.model is not None:
            return load_classifier(self.model)
        return default_classifier(self.skins, np.random.default_rng(self.seed))

    def live(self) -> TouchLoop:
        """A loop for a player; without a model its touches have no names until `train` is over."""
        ready = None if self.model is None else load_classifier(self.model)
        return self.touch_loop(stepwise(self.open()), ready)

    def train(self, loop: TouchLoop, failed: Callable[[str], None]) -> threading.Thread:
        """Train a small classifier beside a running loop, which names touches from then on.

        Parameters
        ----------
        loop : TouchLoop
        failed : callable
            Told in a line why there will be no names.
        """

        def work() -> None:
            try:
                loop.name_with(default_classifier(self.skins, np.random.default_rng(self.seed)))
            except SkinError as error:
                failed(f"touches stay without names: {error}")

        thread = threading.Thread(target=work, name="training", daemon=True)
        thread.start()
        return thread

    @property
    def simulated(self) -> bool:
        """Whether the simulator is the source."""
        return self.source.partition(":")[0] == "sim"

    def moments(self, seconds: float | None, *, start: float = 0.0) -> Iterator[Moment]:
        """Moments for a picture or a movie, without a player.

        Those of recordings and of the simulator come sample by sample, as fast as they are
        worked on; those of a live source as they come.

        Parameters
        ----------
        seconds : float or None
            How long; None for all of a recording, and a while of anything else.
        start : float
            Seconds of a recording, or of the simulator, that are left out.

        Raises
        ------
        UnreachableError
            A live source that sends nothing.
        """
        source = self.open(hurry=True)
        recording = isinstance(source, Seekable)
        if isinstance(source, Seekable) and start > LEAD:
            source.seek(start - LEAD)
            start = LEAD
        length = LIVE if seconds is None else seconds
        if seconds is None and (recording or self.simulated):
            length = math.inf if recording else MADE
        loop = self.touch_loop(OneByOne(source), self.classifier())
        try:
            live = not (recording or self.simulated)
            for moment in _between(loop, start, length, live=live):
                # How quick samples were worked through says nothing of the source.
                yield moment if live else replace(moment, rate=math.nan, latency=math.nan)
        finally:
            loop.close()


def _between(loop: TouchLoop, start: float, length: float, *, live: bool) -> Iterator[Moment]:
    """Moments of a loop from `start` to `start + length` [s] after its first one."""
    first = math.nan
    deadline = time.monotonic() + SILENCE
    while True:
        try:
            moment = loop.step(STEP)
        except SourceEnded:
            return
        if live and time.monotonic() > deadline:
            if math.isnan(first):
                raise UnreachableError(f"source {loop.info.name!r} sends nothing")
            return
        if moment is None or moment.stale:
            continue
        if math.isnan(first):
            first = moment.time
            deadline = time.monotonic() + start + length
        if moment.time - first > start + length:
            return
        if moment.time - first >= start:
            yield moment
