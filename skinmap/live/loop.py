"""The loop: sample, pressures, contacts, labels, subscribers.

for moment in TouchLoop(skinmap.load_robot("icub"), open_source("sim"), classifier=model):
    moment.touches
"""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.classify.classifier import TouchClassifier
from skinmap.errors import SkinMismatchError, UnknownNameError, UnreachableError
from skinmap.live.events import ContactEvent, TouchEvent
from skinmap.live.identity import ContactTracker
from skinmap.live.joined import JoinedSkin
from skinmap.live.moment import Moment
from skinmap.live.namer import Namer
from skinmap.live.response import Response, Responses
from skinmap.live.sample_checks import Counts, SampleChecks
from skinmap.live.skins import check_skin
from skinmap.live.source import Block, Seekable, Source, SourceEnded, StreamInfo
from skinmap.live.touch_book import TouchBook
from skinmap.skin.robot import Robot
from skinmap.touch.grouping import RULE, GroupingRule
from skinmap.touch.prepared import PreparedSkin

STALE = 0.5  # seconds without a sample that are shown; a source slower than that has three periods
RETRY = 0.5  # between two tries to open a dead source again [s]
PACE = 100.0  # labels a second for each part at most
MOST = 64  # samples that one step works on: who comes late still gets labels meanwhile
ARRIVALS = 64  # blocks that the present rate is taken from
logger = logging.getLogger(__name__)


class TouchLoop:
    """Turns what a source sends into touches with names.

    Parameters
    ----------
    robot : Robot
        Whose skin it is.
    source : Source
    classifier : TouchClassifier, optional
        Trained; without one every contact is a "touch" of confidence NaN.
    responses : mapping of str to Response, optional
        Response calibrations of parts that send raw values.
    parts : sequence of str, optional
        Only these of the source's parts.
    skins : mapping of str to PreparedSkin, optional
        Skins that are prepared already, by part.
    rule : GroupingRule
        When contacts are one grip.
    pace : float
        Labels a second for each part at most.
    reopen : callable, optional
        Opens the source again where it died for good.

    Attributes
    ----------
    skins : dict of str to PreparedSkin
        By part.
    source : Source
        The present one.
    counts : Counts
        What became of the samples.

    Raises
    ------
    UnknownNameError
        A part that the robot or the source lacks.
    SkinMismatchError
        A source, a calibration or a classifier of another skin.
    """

    def __init__(
        self,
        robot: Robot,
        source: Source,
        *,
        classifier: TouchClassifier | None = None,
        responses: Mapping[str, Response] | None = None,
        parts: Sequence[str] | None = None,
        skins: Mapping[str, PreparedSkin] | None = None,
        rule: GroupingRule = RULE,
        pace: float = PACE,
        reopen: Callable[[], Source] | None = None,
    ) -> None:
        self.robot, self.source, self.counts = robot, source, Counts()
        self._reopen = reopen
        info = source.info
        check_skin(info, robot)
        chosen = _chosen(info, parts)
        self.skins = {
            part: (skins or {}).get(part) or PreparedSkin(robot.skin(part)) for part in chosen
        }
        if classifier is not None:
            check_classifier(classifier, self.skins.values())
        self._skin = JoinedSkin(self.skins)
        self._gather = gather(info, self.skins)
        self._all = np.array_equal(self._gather, np.arange(info.channels))
        self._checks = SampleChecks(info, self.counts, seekable=isinstance(source, Seekable))
        self._responses = Responses(self._skin, info, responses)
        self._tracker = ContactTracker(self._skin)
        self._book = TouchBook(self._skin)
        self._namer: Namer | None = None
        self._new_namer = partial(Namer, self._skin, rule=rule, rate=info.rate, pace=pace)
        if classifier is not None:
            self._namer = self._new_namer(classifier)
        self._next_namer: Namer | None = None
        self._listeners: list[Callable[[Moment], object]] = []
        self._runs: deque[tuple[bool, FloatArray, NDArray[Any]]] = deque()
        self._arrivals: deque[tuple[float, int]] = deque(maxlen=ARRIVALS)
        self._arrived = time.perf_counter()
        self._stale = False
        self._dead = False
        self._next_try = 0.0
        zeros = np.zeros(len(self._skin))
        self._last: tuple[float, FloatArray, NDArray[Any]] = (float("nan"), zeros, zeros)
        self.moment: Moment | None = None

    def __iter__(self) -> Iterator[Moment]:
        while True:
            try:
                moment = self.step(STALE)
            except SourceEnded:
                return
            if moment is not None:
                yield moment

    @property
    def info(self) -> StreamInfo:
        """What the source says of itself."""
        return self.source.info

    @property
    def labels_given(self) -> int:
        """How often a touch was given a label so far."""
        return 0 if self._namer is None else self._namer.named

    def subscribe(self, listener: Callable[[Moment], object]) -> None:
        """Call a function, a publisher's `send` for one, with every moment; errors are logged."""
        self._listeners.append(listener)

    def happenings(self) -> list[ContactEvent]:
        """What happened to contacts since this was asked last."""
        return _emptied(self._tracker.events)

    def finished(self) -> list[TouchEvent]:
        """Touches that ended since this was asked last."""
        return _emptied(self._book.ended)

    def step(self, timeout: float) -> Moment | None:
        """Work on what has come; wait for it at most `timeout` [s].

        Returns
        -------
        Moment or None
            Of the newest sample; None where nothing came and nothing changed. A source that
            plays as fast as it is asked gives a moment for every sample.

        Raises
        ------
        SourceEnded
            A recording is over. Touches that lasted are over, too.
        UnreachableError
            A source that died, and nobody said how to open it again.
        """
        if self._next_namer is not None:
            self._namer, self._next_namer = self._next_namer, None
        if not self._runs:
            block = self._read(timeout)
            if block is None:
                return self._silence()
            self._runs.extend(self._checks.look(block))
            self._note_arrival(block)
        if not self._runs:
            return None
        self._work(*self._next_run())
        self._stale = False
        return self._tell(self._show())

    def seek(self, seconds: float) -> None:
        """Lead a recording to a time from its beginning [s]."""
        if isinstance(self.source, Seekable):
            self._runs.clear()
            self.source.seek(seconds)
            self._begin_anew()

    def totals(self) -> dict[str, int]:
        """What became of the samples, on the way here and here, by the names of `Counts`.

        Beside them "dropped" (nobody took them in time) and "refused" (messages that were none).
        A source that numbers its samples knows better how many are lost than their times do.
        """
        own = self.counts.as_dict()
        theirs = getattr(self.source, "counts", None)

        def count(name: str) -> int:
            return int(getattr(theirs, name, 0))

        own["received"] = max(own["received"], count("received"))
        own["lost"] = max(own["lost"], count("lost"))
        own["late"] += count("backwards")
        own["repeated"] += count("repeated")
        own["nan"] += count("not_finite")
        own["out_of_range"] += count("out_of_range")
        own["restarts"] = max(own["restarts"], count("restarted"))
        own["reconnects"] += count("reconnected")
        return {**own, "dropped": count("dropped"), "refused": count("refused")}

    def dense_info(self) -> StreamInfo:
        """How a publisher of the moments describes their pressures: dense rows of each part."""
        from skinmap.classify.trained_skin import remember

        info = self.info
        return StreamInfo(
            info.name,
            tuple(self.skins),
            tuple(map(len, self.skins.values())),
            info.rate,
            "pressure",
            self.robot.name,
            {part: remember(skin.skin).fingerprint for part, skin in self.skins.items()},
            info.clock,
        )

    def finish(self) -> None:
        """End the touches that last: nothing more will be asked."""
        self._tracker.forget()
        self._book.update([])

    def name_with(self, classifier: TouchClassifier) -> None:
        """Name touches with another classifier from the next step on; any thread may ask.

        Raises
        ------
        SkinMismatchError
            A classifier of another skin.
        """
        check_classifier(classifier, self.skins.values())
        self._next_namer = self._new_namer(classifier)

    def close(self) -> None:
        """Close the source; may be called twice."""
        self.source.close()

    @property
    def plays_ahead(self) -> bool:
        """Whether the source plays as fast as it is asked: then no sample is passed over."""
        return bool(np.isinf(getattr(self.source, "speed", 1.0)))

    def _read(self, timeout: float) -> Block | None:
        if self._dead and not self._revive(timeout):
            return None
        now = time.perf_counter()
        until_stale = self._arrived + self._patience() - now
        wait = timeout if self._stale else min(timeout, max(until_stale, 0.0))
        try:
            return self.source.read(wait)
        except SourceEnded:
            self.finish()
            raise
        except UnreachableError:
            if self._reopen is None:
                raise
            logger.warning("source %r died; trying to open it again", self.info.name)
            self._dead, self._next_try = True, 0.0
            return None

    def _revive(self, timeout: float) -> bool:
        """Open a dead source again, no more than twice a second."""
        wait = self._next_try - time.perf_counter()
        if wait > 0:
            time.sleep(min(wait, timeout))
            if wait > timeout:
                return False
        self._next_try = time.perf_counter() + RETRY
        self.source.close()
        try:
            source = self._reopen() if self._reopen is not None else self.source
        except UnreachableError:
            return False
        if (source.info.parts, source.info.widths) != (self.info.parts, self.info.widths):
            source.close()
            raise SkinMismatchError(f"stream {source.info.name!r} came back with another skin")
        check_skin(source.info, self.robot)
        self.source, self._dead = source, False
        self.counts.reconnects += 1
        return True

    def _patience(self) -> float:
        """Seconds without a sample after which the source is called stale."""
        speed = float(getattr(self.source, "speed", 1.0))
        if speed == 0.0:
            return float("inf")
        rate = self.info.rate * speed
        return max(STALE, 3.0 / rate) if rate > 0 else STALE

    def _silence(self) -> Moment | None:
        """A moment that says so when nothing has come for a while, once."""
        if self._stale:
            return None
        if not self._dead and time.perf_counter() - self._arrived < self._patience():
            return None
        self._stale = True
        self.counts.stale += 1
        return self._tell(self._show(stale=True))

    def _next_run(self) -> tuple[bool, FloatArray, NDArray[Any]]:
        """Samples that one step works on: a few at once, one where none is to be passed over."""
        anew, times, values = self._runs.popleft()
        most = 1 if self.plays_ahead else MOST
        if len(times) > most:
            self._runs.appendleft((False, times[most:], values[most:]))
        return anew, times[:most], values[:most]

    def _work(self, anew: bool, times: FloatArray, values: NDArray[Any]) -> None:
        """Take a run of samples through response, contacts and names."""
        if anew:
            self._begin_anew()
        dense = values if self._all else values[:, self._gather]
        pressures, forces = self._responses.apply(dense)
        for row, now in enumerate(times.tolist()):
            self._tracker.update(now, pressures[row], None if forces is None else forces[row])
            tracks = self._tracker.tracks
            if self._namer is not None:
                self._namer.push(now, pressures[row], tracks)
            self._keep_book()
        self.counts.used += len(times)
        self._last = (float(times[-1]), pressures[-1], dense[-1])
        if self._namer is not None and self._tracker.tracks:
            self._namer.name(float(times[-1]), self._tracker.tracks)
            self._keep_book()

    def _keep_book(self) -> None:
        labels = None if self._namer is None else self._namer.labels
        for touch in self._book.update(self._tracker.tracks, labels, self._tracker.swallowed):
            if self._namer is not None:
                self._namer.drop(touch)

    def _begin_anew(self) -> None:
        """The clock jumped: what was touched before is over."""
        self._tracker.forget()
        self._book.update([])
        if self._namer is not None:
            self._namer.forget()

    def _note_arrival(self, block: Block) -> None:
        self._arrived = time.perf_counter()
        self._block_arrived = block.arrived
        self._arrivals.append((block.arrived, self.counts.received))

    def _rate(self) -> float:
        """Samples a second that came lately."""
        if len(self._arrivals) < 2:
            return float("nan")
        (first, before), (last, after) = self._arrivals[0], self._arrivals[-1]
        return (after - before) / (last - first) if last > first else float("nan")

    def _show(self, *, stale: bool = False) -> Moment:
        now, pressures, raw = self._last
        touches, contacts = self._book.show(self._tracker.tracks)
        latency = float("nan") if stale else time.perf_counter() - self._block_arrived
        return Moment(
            now,
            self._skin.split(pressures),
            touches,
            self._skin.split(raw) if self.info.kind == "raw" else {},
            stale=stale,
            rate=0.0 if stale else self._rate(),
            latency=latency,
            dropped=int(getattr(getattr(self.source, "counts", None), "dropped", 0)),
            contacts=contacts,
        )

    def _tell(self, moment: Moment) -> Moment:
        self.moment = moment
        for listener in self._listeners:
            try:
                listener(moment)
            except Exception:  # a listener's fault must not stop the loop
                self.counts.failed += 1
                logger.exception("a subscriber failed")
        return moment


def gather(info: StreamInfo, skins: Mapping[str, PreparedSkin]) -> IntArray:
    """(N,) place in a stream's sample of each taxel of some parts, in dense rows."""
    places = []
    for part, skin in skins.items():
        rows = info.part_slice(part)
        dense = rows.stop - rows.start == len(skin)
        places.append(rows.start + (np.arange(len(skin)) if dense else skin.skin.channels))
    return np.concatenate(places)


def check_classifier(classifier: TouchClassifier, skins: Any) -> None:
    """Refuse a classifier that cannot name touches on one of some skins.

    Raises
    ------
    SkinMismatchError
        It reads taxels by their number, and learnt another skin.
    """
    for skin in skins:
        difference = classifier.difference(skin.skin)
        if not difference.may_go_on:
            raise SkinMismatchError(f"{classifier.name!r} cannot go on: {difference.message}")


def _chosen(info: StreamInfo, parts: Sequence[str] | None) -> tuple[str, ...]:
    for part in parts or ():
        if part not in info.parts:
            raise UnknownNameError(f"part in stream {info.name!r}", part, info.parts)
    return tuple(part for part in info.parts if not parts or part in parts)


def _emptied(queue: deque[Any]) -> list[Any]:
    found = []
    while queue:
        found.append(queue.popleft())
    return found
