"""The loop: sample, pressures, contacts, labels, subscribers.

for moment in TouchLoop(skinmap.load_robot("icub"), open_source("sim"), classifier=model):
    moment.touches
"""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.io.robots.manifest import load_robot
from skinmap.live.contacts.contact_tracker import ContactTracker
from skinmap.live.contacts.named_touch import ContactEvent, Moment, NamedTouch, TouchEvent, taken
from skinmap.live.contacts.touch_history import Entry, TouchBook
from skinmap.live.namer import Namer
from skinmap.live.response.pressures import Response, Responses, RestGate
from skinmap.live.response.sample_checks import SampleChecks
from skinmap.live.robot_skin import JoinedSkin
from skinmap.live.sources.source import (
    SIMULATION,
    Block,
    Counts,
    Seekable,
    Source,
    SourceEnded,
    StreamInfo,
    blocks,
    check_skin,
    describe_skins,
    gather,
    is_live,
)
from skinmap.recognition.classifier import Prediction, TouchClassifier
from skinmap.recognition.model_file import load_classifier
from skinmap.skin.robot import Robot
from skinmap.summary import Summary, listed
from skinmap.touch.contacts.grouping import RULE, GroupingRule
from skinmap.touch.prepared_skin import PreparedSkin

if TYPE_CHECKING:
    from skinmap.live.response.loads import PartLoads
    from skinmap.touch.load_calibration import LoadCalibration

STALE = 0.5  # seconds without a sample that are shown; a source slower than that has three periods
ARRIVALS = 64  # blocks that the present rate is taken from


class Feed:
    """Reads a source and notices that nothing comes.

    Parameters
    ----------
    source : Source
    counts : Counts
        That it adds to.

    Attributes
    ----------
    stale : bool
        Whether nothing has come for a while.
    arrived : float
        `perf_counter` when the newest sample came [s].
    """

    def __init__(self, source: Source, counts: Counts) -> None:
        self.source, self._counts = source, counts
        self.stale = False
        self.arrived = time.perf_counter()
        self._heard = float("nan")  # until somebody listens
        self._arrivals: deque[tuple[float, int]] = deque(maxlen=ARRIVALS)
        self._came = 0
        self._speed = 1.0  # that the arrivals were at

    @property
    def rate(self) -> float:
        """Samples a second that came lately; 0 where none comes, NaN where unknown."""
        if self.stale:
            return 0.0
        if len(self._arrivals) < 2 or np.isinf(self._speed):
            return float("nan")
        (first, before), (last, after) = self._arrivals[0], self._arrivals[-1]
        return (after - before) / (last - first) if last > first else float("nan")

    def read(self, timeout: float) -> Block | None:
        """What has come; waits `timeout` [s] at most, and no longer than until it is stale.

        Raises
        ------
        SourceEnded
            A recording is over.
        UnreachableError
            The source died for good.
        """
        if np.isnan(self._heard):
            self._heard = time.perf_counter()
        until_stale = self._heard + self._patience() - time.perf_counter()
        wait = timeout if self.stale else min(timeout, max(until_stale, 0.0))
        block = self.source.read(wait)
        if block is not None:
            self.stale = False
            if self.source.speed != self._speed:
                self._speed = self.source.speed
                self._arrivals.clear()  # a rate over two speeds is that of neither
            self._heard, self.arrived = time.perf_counter(), block.arrived
            self._came += len(block)
            self._arrivals.append((block.arrived, self._came))
        return block

    def falls_silent(self) -> bool:
        """Whether nothing has come for too long, told once."""
        if self.stale or time.perf_counter() - self._heard < self._patience():
            return False
        self.stale = True
        self._counts.stale += self._came > 0  # what has not begun is not interrupted
        return True

    def _patience(self) -> float:
        """Seconds without a sample after which the source is called stale."""
        speed = self.source.speed
        # What is made when it is asked for is never silent, only slow.
        if speed == 0.0 or self.source.info.clock == SIMULATION:
            return float("inf")
        rate = self.source.info.rate * speed
        return max(STALE, 3.0 / rate) if rate > 0 else STALE


LEARN = 10.0  # as long as it may take to know that a taxel is stuck [s]
PACE = 100.0  # labels a second for each part at most
MAX_SAMPLES = 64  # samples that one step works on
NAMED = 10  # live ones at most from one naming to the next: who comes late still gets labels
ILL = ("stuck", "noisy", "dead", "unheard")  # states of taxels that feel little or nothing
logger = logging.getLogger(__name__)


class TouchLoop(Summary):
    """Turns what a source sends into touches with names.

    Parameters
    ----------
    robot : Robot, str or Path
        Whose skin it is; a name or a manifest loads it.
    source : Source
    classifier : TouchClassifier, str or Path, optional
        Trained, or a model file; without one every contact is a "touch" of confidence NaN.
    responses : mapping of str to Response, optional
        Response calibrations of parts that send raw values.
    calibrations : mapping of str to LoadCalibration, optional
        Load calibrations of parts: their touches have forces.
    parts : sequence of str, optional
        Only these of the source's parts.
    skins : mapping of str to PreparedSkin, optional
        Skins that are prepared already, by part.
    rule : GroupingRule
        When contacts are one grip.
    pace : float
        Labels a second for each part at most.
    singly : bool
        A moment for every sample; otherwise only of sources that play as fast as they are asked.
    live : bool, optional
        Whether this machine's clock may decide which samples are named from; of a live source by
        default.

    Attributes
    ----------
    skins : dict of str to PreparedSkin
        By part.
    feed : Feed
        What reads the source.
    counts : Counts
        Counts of samples by their fate.

    Raises
    ------
    UnknownNameError
        A part that the robot or the source lacks.
    SkinMismatchError
        A source, a calibration or a classifier of another skin.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> source = skinmap.open_source("sim", robot=robot, parts=["torso"], speed=float("inf"))
    >>> loop = skinmap.TouchLoop(robot, source)
    >>> for moment in loop:
    ...     if moment.touches:
    ...         break
    >>> moment.touches[0].part
    'torso'
    >>> loop.close()
    """

    def __init__(
        self,
        robot: Robot | str | Path,
        source: Source,
        *,
        classifier: TouchClassifier | str | Path | None = None,
        responses: Mapping[str, Response] | None = None,
        calibrations: Mapping[str, LoadCalibration] | None = None,
        parts: Sequence[str] | None = None,
        skins: Mapping[str, PreparedSkin] | None = None,
        rule: GroupingRule = RULE,
        pace: float = PACE,
        singly: bool = False,
        live: bool | None = None,
    ) -> None:
        if isinstance(robot, str | Path):
            robot = load_robot(robot)
        if isinstance(classifier, str | Path):
            classifier = load_classifier(classifier)
        self._singly, self._live = singly, live
        self.robot, self.counts = robot, Counts()
        self.source, self.info = source, source.info
        self.feed, info = Feed(source, self.counts), self.info
        check_skin(info, robot)
        wanted = info.only(parts or info.parts)[0].parts
        chosen = [part for part in info.parts if part in wanted]
        self.skins = {
            part: (skins or {}).get(part) or PreparedSkin(robot.skin(part)) for part in chosen
        }
        if classifier is not None:
            classifier.check_skins(self.skins.values())
        self._skin = JoinedSkin(self.skins)
        self._gather = gather(info, {part: one.skin for part, one in self.skins.items()})
        self._all = np.array_equal(self._gather, np.arange(info.channels))
        self._checks = SampleChecks(
            info, self.counts, seekable=self.source.seekable, taxels=self._gather
        )
        self._responses = Responses(self._skin, info, responses)
        self._loads: dict[str, PartLoads] = {}
        if calibrations:
            from skinmap.live.response.loads import PartLoads  # solvers, only where asked for

            known = [part for part in calibrations if part in self.skins]
            self._loads = {
                part: PartLoads(self.skins[part], calibrations[part], info.rate, info.kind)
                for part in known
            }
        self._gate = RestGate(self._skin, info.rate)
        self._tracker = ContactTracker(self._skin)
        self._book = TouchBook(self._skin)
        self._book.revise = self._revised
        self._namer: Namer | None = None
        if classifier is not None:
            self._namer = Namer(
                self._skin, classifier, rule=rule, rate=info.rate, pace=pace, live=self.live
            )
            self._book.part = self._namer.rename
        self._listeners: list[Callable[[Moment], object]] = []
        self._runs: deque[tuple[bool, FloatArray, NDArray[Any]]] = deque()
        zeros: NDArray[Any] = np.zeros(len(self._skin))
        self._block = np.full(1, np.nan), zeros[None], zeros[None]
        self._states: tuple[tuple[int, ...], dict[str, NDArray[Any]]] = ((), {})
        self._stuck = self._gate.rest.stuck
        self.naming = True
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
    def resting(self) -> bool:
        """Whether nothing is touched, and no touch may go on: what comes is named by itself."""
        return not self._tracker.tracks and not self._book.lasting

    @property
    def labels_given(self) -> int:
        """How often a touch was given a label so far."""
        return 0 if self._namer is None else self._namer.named

    def subscribe(self, listener: Callable[[Moment], object]) -> None:
        """Call a function, a publisher's `send` for one, with every moment; errors are logged."""
        self._listeners.append(listener)

    def happenings(self) -> list[ContactEvent]:
        """What happened to contacts since this was asked last."""
        return taken(self._tracker.events)

    def finished(self) -> list[TouchEvent]:
        """Touches that ended since this was asked last."""
        return taken(self._book.ended)

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
            A source that died for good.
        """
        if not self._runs:
            try:
                block = self.feed.read(timeout)
            except SourceEnded:
                self.finish()
                raise
            if block is None:
                return self._tell(self._show(stale=True)) if self.feed.falls_silent() else None
            self._runs.extend(self._checks.look(block))
        if not self._runs:
            return None
        self._work(*self._next_run())
        return self._tell(self._show())

    def learn_rest(self, ahead: Source) -> None:
        """Learn what taxels read at rest, and which hang, from the same samples read before.

        Parameters
        ----------
        ahead : Source
            Of the same skin, as fast as it is asked; its beginning is read, and it is closed.
        """
        checks = SampleChecks(self.info, Counts(), seekable=True, taxels=self._gather)
        end = float("nan")
        with closing(ahead):
            for block in blocks(ahead):
                end = float(block.times[0]) + LEARN if end != end else end
                for _, _, values in checks.look(block):
                    self._gate.apply(self._responses.apply(values[:, self._gather]))
                if block.times[-1] >= end:
                    return

    def touched_samples(
        self,
    ) -> Iterator[tuple[bool, FloatArray, NDArray[Any], NDArray[np.bool_]]]:
        """What is touched in each sample to come, without contacts and names: far faster.

        Yields
        ------
        anew : bool
            Whether the clock jumped before these samples.
        times : (t,) array of float
            [s]
        touched : (t, N) array
            Pressures [counts], 0 wherever nothing is touched; the parts' taxels joined.
        stuck : (N,) array of bool
            Taxels that hang by now.
        """
        for block in blocks(self.source):
            for anew, times, values in self._checks.look(block):
                pressures = self._responses.apply(values[:, self._gather])
                yield anew, times, self._gate.apply(pressures), self._gate.rest.stuck

    def seek(self, seconds: float) -> None:
        """Lead a recording to a time from its beginning [s]."""
        if isinstance(self.source, Seekable):
            self._runs.clear()
            self.source.seek(seconds)
            self._checks.forget()
            self._begin_anew()

    def totals(self) -> dict[str, int]:
        """What became of the samples, on the way here and here, by the names of `Counts`."""
        return self.counts.joined(self.source.counts).as_dict()

    def withdrawn(self) -> list[TouchEvent]:
        """Touches taken back since this was asked last: their taxels turned out to be stuck."""
        return taken(self._book.withdrawn)

    def states(self) -> Mapping[str, NDArray[np.str_]]:
        """State (n,) of the taxels of each part, see `Moment.states`; not to be changed."""
        changes = self._gate.changes, self._responses.changes, self._checks.unheard
        if changes != self._states[0]:
            words = np.full(len(self._skin), "ok", "<U7")
            for found in (self._gate.states(), self._responses.states()):
                for state, rows in found.items():
                    words[rows] = state
            words[self._checks.silent[self._gather]] = "unheard"
            self._states = changes, self._skin.split(words)
        return self._states[1]

    def health(self) -> dict[str, dict[str, list[int]]]:
        """Channels that are `stuck`, `noisy`, `dead` or `unheard`, by part.

        Parts without any are left out. A channel is unheard until it first sent a number and was
        seen at rest: what it sends before is not a touch.
        """
        return {
            part: {state: self.skins[part].skin.channels[words == state].tolist() for state in ILL}
            for part, words in self.states().items()
            if (words != "ok").any()
        }

    @property
    def zero_age(self) -> float | None:
        """Age of the zero of the forces [s]; None without a load calibration."""
        return max((one.age for one in self._loads.values()), default=None)

    def zero(self) -> None:
        """Take the zero of the forces anew, as soon as nothing touches for 0.8 s."""
        for one in self._loads.values():
            one.zero()

    def levels(self, part: str, taxel: int) -> dict[str, float]:
        """What a taxel (a dense row) of a part is judged by.

        Returns
        -------
        dict of str to float
            `baseline` and `threshold` [counts of pressure]; where the source sends raw values
            `raw at rest`, and `gain` [counts/N] where the response is calibrated by loads.
        """
        row = self._skin.slices[part].start + taxel
        rest = self._gate.rest
        known = {"baseline": float(rest.offset[row]), "threshold": float(rest.begins[row])}
        return known | self._responses.levels(row)

    def dense_info(self) -> StreamInfo:
        """How a publisher of the moments describes their pressures: dense rows of each part."""
        skins = [one.skin for one in self.skins.values()]
        info = self.info
        return describe_skins(info.name, self.robot.name, skins, info.rate, "pressure", info.clock)

    def finish(self) -> None:
        """End the touches that last, as `unfinished`: nothing more will be asked."""
        self._tracker.forget()
        self._book.forget(cut=True)

    def close(self) -> None:
        """Close the source; may be called twice."""
        self.source.close()

    @property
    def live(self) -> bool:
        """Whether the source is live: what is done with a sample may then depend on the clock."""
        return is_live(self.source) if self._live is None else self._live

    def _next_run(self) -> tuple[bool, FloatArray, NDArray[Any]]:
        """Samples that one step works on: a few at once, one where none is to be passed over."""
        anew, times, values = self._runs.popleft()
        most = 1 if self._singly or np.isinf(self.source.speed) else MAX_SAMPLES
        if len(times) > most:
            self._runs.appendleft((False, times[most:], values[most:]))
        return anew, times[:most], values[:most]

    def _work(self, anew: bool, times: FloatArray, values: NDArray[Any]) -> None:
        """Take a run of samples through response, contacts and names."""
        if anew:
            self._begin_anew()
        dense = values if self._all else values[:, self._gather]
        pressures = self._responses.apply(dense)
        live, last = self.live, len(times) - 1
        touched = self._gate.apply(pressures)
        for part, loads in self._loads.items():
            own = self._skin.slices[part]
            loads.take(dense[:, own], bool(touched[:, own].any()))
        for row, now in enumerate(times.tolist()):
            self._tracker.update(now, touched[row])
            tracks, swallowed = self._tracker.tracks, self._tracker.swallowed
            self._book.update(tracks, None, swallowed, time=now, pressures=touched[row])
            if self._namer is not None and self.naming:
                self._namer.push(now, touched[row], tracks, self._book.lasting)
            # Which samples come together is the clock's doing: only live ones are named by that.
            due = not live or row == last or row % NAMED == NAMED - 1
            if self._namer is not None and self.naming and tracks and due:
                labels = self._namer.name(now, tracks, live=live, speed=self.source.speed)
                self._book.update(tracks, labels, swallowed, time=now)
        if self._gate.rest.stuck is not self._stuck:
            self._stuck = self._gate.rest.stuck
            self._book.withdraw(self._stuck)
        self.counts.used += len(times)
        self._block = (times, pressures, dense)

    def _weighed(self, touches: tuple[NamedTouch, ...]) -> tuple[NamedTouch, ...]:
        """The touches with their forces, on parts that have a load calibration."""
        return tuple(
            replace(one, load=self._loads[one.part].force(one.taxels))
            if one.part in self._loads else one
            for one in touches
        )  # fmt: skip

    def _revised(self, entry: Entry) -> Prediction | None:
        if self._namer is None or not self.naming:
            return None
        return self._namer.revise(entry.identity, entry.part, entry.began, entry.seen)

    def _begin_anew(self) -> None:
        """The clock jumped: what was touched before is over."""
        self._tracker.forget()
        self._book.forget()
        if self._namer is not None:
            self._namer.forget()

    def _show(self, *, stale: bool = False) -> Moment:
        times, every, samples = self._block
        now = float(times[-1])
        slices = self._skin.slices.items()
        touches = self._weighed(self._book.show(self._tracker.tracks))
        latency = float("nan") if stale else time.perf_counter() - self.feed.arrived
        return Moment(
            now,
            self._skin.split(every[-1]),
            touches,
            self._skin.split(samples[-1]) if self.info.kind == "raw" else {},
            self.source.angles_at(now),
            stale=stale,
            rate=self.feed.rate,
            latency=latency,
            dropped=self.source.counts.dropped,
            states=self.states(),
            skins=self.skins,
            block=(
                times,
                {part: every[:, rows] for part, rows in slices},
                {part: samples[:, rows] for part, rows in slices if self.info.kind == "raw"},
            ),
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

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "robot": self.robot.name,
            "source": self.info.name,
            "parts": listed(self.skins),
            "classifier": "none" if self._namer is None else self._namer.classifier.name,
        }
