"""What `skinmap view` shows and how: the robot, its source and names; the scene that looks so."""

from __future__ import annotations

import itertools
import math
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError, SkinMismatchError, UnknownNameError, UnreachableError
from skinmap.live.contacts.named_touch import Moment
from skinmap.live.loop import TouchLoop
from skinmap.live.sources.open_source import open_recording, open_source
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import Seekable, Source, SourceEnded, is_live
from skinmap.live.touched_taxels import Touched, recordings_of, touched_in
from skinmap.recognition.classifier import TouchClassifier
from skinmap.recognition.model_file import load_classifier
from skinmap.recognition.named_classifiers import default_model
from skinmap.skin.robot import Robot
from skinmap.touch.load_calibration import LoadCalibration
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.drawing.body.bare_body import Links
from viewer.interaction.mouse import Selection
from viewer.interaction.view_file import SavedView, apply_view, check_view
from viewer.layers import Layers
from viewer.playing.player import LoopFeed
from viewer.scene import LazyMaps, Scene

LIVE = 5.0  # how long a live source is watched for a picture or a movie [s]
MADE = 12.0  # how long recordings and the simulator are, for a picture [s]
LEAD = 1.0  # of a recording before the time asked for: touches are named from their past [s]
STEP = 0.2  # longest wait for a sample before the clock is looked at [s]
SHOWN = {"moved": "rest moved", "swapped_channels": "feels elsewhere"}  # changes as layers have
SAME = 1e-6  # times that differ by less are the same [s]
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
        Names the touches; the one that comes with Skinmap by default.
    seed : int
    speed : float
        Of recordings.
    responses : mapping of str to ResponseCalibration
    covariances : mapping of str to (n, 3, 3) array
    loads : sequence of str
        Load calibrations, each "FOLDER" or "PART=FOLDER".
    checkups : Path or None
        The folder of a history of check-ups, for the layer "changed".
    origin : float
        Time of the source's beginning in its moments' clock [s], once some came.
    touched_in : Path or None
        The recording, or a folder of some, that the layer "touched" counts.
    """

    robot: Robot
    parts: tuple[str, ...]
    source: str = "sim"
    model: Path | None = None
    seed: int = 0
    speed: float = 1.0
    responses: Mapping[str, Any] = field(default_factory=dict)
    covariances: Mapping[str, FloatArray] = field(default_factory=dict)
    loads: Sequence[str] = ()
    checkups: Path | None = None
    skins: dict[str, PreparedSkin] = field(default_factory=dict)
    origin: float = math.nan
    touched_in: Path | None = None
    _touched: Touched | None = None
    _history: dict[str, tuple[list[str], list[Any]]] = field(default_factory=dict)
    _recording: Playback | None = None
    calibrations: dict[str, LoadCalibration] = field(default_factory=dict)

    def prepare(self) -> None:
        """Prepare the skins that are shown, and read their load calibrations and check-ups."""
        self.skins = {part: PreparedSkin(self.robot.skin(part)) for part in self.parts}
        if self.loads:
            from skinmap.live.response.loads import load_calibrations

            self.calibrations = load_calibrations(self.loads, self.skins)
        if self.checkups is not None:
            self._history = self._read_history(self.checkups)

    def _read_history(self, folder: Path) -> dict[str, tuple[list[str], list[Any]]]:
        """The times and check-ups of each part that has two or more."""
        from calibration.wiring.history import checkups_of, earlier_checkups

        kept, name = earlier_checkups(folder), self.robot.name
        found = {part: checkups_of(kept, name, part, self.robot.skin(part).channels.tolist())
                 for part in self.parts}  # fmt: skip
        several = {part: own for part, own in found.items() if len(own[0]) > 1}
        if not several:
            here = Counter(f"{one.robot} {part}" for one in kept for part in one.parts)
            raise SkinMismatchError(
                f"{folder}: fewer than two check-ups of each part of {name!r} that is shown; "
                f"here are {', '.join(f'{count} of {own}' for own, count in here.items())}"
            )
        return several

    @property
    def title(self) -> str:
        """The robot and its source."""
        return f"{self.robot.name}, {(self.touched_in or Path(self.source)).name}"

    def open(self, *, hurry: bool = False) -> Source:
        """Open the source; `hurry` for as fast as it is asked."""
        speed = math.inf if hurry else self.speed
        if self._recording is not None:  # what is long is read once
            return self._recording.again(speed)
        source = open_source(
            self.source,
            robot=self.robot,
            parts=self.parts if self.simulated else None,
            seed=self.seed,
            speed=speed,
        )
        if isinstance(source, Playback):
            self._recording = source
        return source

    def changed(self) -> tuple[str, dict[str, list[str]]]:
        """The day of the first check-up, and the change of each taxel since, by part."""
        from calibration.wiring.history import changes_of

        found = {}
        for part, (times, kept) in self._history.items():
            kinds = ["as before"] * len(kept[0].channels)
            for one in reversed(changes_of(part, times, kept)[0]):  # a changed gain comes first
                if one.kind != "recovered":
                    kinds[one.row] = SHOWN.get(one.kind, one.kind)
            found[part] = kinds
        return min((times[0][:10] for times, _ in self._history.values()), default=""), found

    def touched(self) -> Touched | None:
        """Where the skins were touched in the recordings; None without any."""
        if self.touched_in is None or self._touched is not None:
            return self._touched
        self._touched = touched_in(
            recordings_of(self.touched_in),
            self.robot,
            self.skins,
            lambda path: open_recording(path, robot=self.robot, speed=math.inf),
            responses=self.responses,
        )
        return self._touched

    def touch_loop(
        self, source: Source, classifier: TouchClassifier | None, *, singly: bool = False
    ) -> TouchLoop:
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
            calibrations={p: load for p, load in self.calibrations.items() if p in shared},
            parts=shared,
            skins=self.skins,
            singly=singly,
        )

    def classifier(self) -> TouchClassifier:
        """The model asked for, or the one that comes with Skinmap."""
        return default_model() if self.model is None else load_classifier(self.model)

    def live(self) -> TouchLoop:
        """A loop for a player; of a recording it knows what hangs before the first sample."""
        loop = self.touch_loop(self.open(), self.classifier())
        if isinstance(loop.source, Seekable):
            self.learn_rest(loop)
        return loop

    def learn_rest(self, loop: TouchLoop) -> None:
        """Tell a loop what its taxels are at rest, from the beginning of the same samples.

        So a moment has the same names whether it is gone to or played to.
        """
        loop.learn_rest(self.open(hurry=True))

    @property
    def repeats(self) -> bool:
        """Whether the same comes whenever it is opened: of recordings and of the simulator."""
        return self.simulated or Path(self.source).exists()

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
        InvalidArrayError
            A recording that is shorter.
        """
        source = self.open(hurry=True)
        live, recording = is_live(source), isinstance(source, Seekable)
        length = LIVE if live else math.inf if recording else MADE
        end = start + (length if seconds is None else seconds)
        loop = self.touch_loop(source, self.classifier(), singly=True)
        if self.repeats:
            self.learn_rest(loop)
        try:
            before = _led(source, start)
            if isinstance(source, Playback):  # its last sample lasts as long as a sample does
                start = min(start, source.last)
            heard = _heard(loop, end)
            if recording and start > 0.0 and (first := next(heard, None)) is not None:
                self.origin = first.time - before if math.isnan(self.origin) else self.origin
                led, _ = LoopFeed(loop).lead(start, LEAD)  # named as a play to there names
                heard = itertools.chain(led[-1:], heard)
            for moment in heard:
                if math.isnan(self.origin):
                    self.origin = moment.time - before
                passed = moment.time - self.origin
                if passed > end + SAME:
                    return
                if passed >= start - SAME:
                    # How quick samples were worked through says nothing of the source, and
                    # a picture is not live: no delay to a screen either.
                    rate = moment.rate if live else math.nan
                    yield replace(moment, rate=rate, latency=math.nan)
        finally:
            loop.close()


def _led(source: Source, start: float) -> float:
    """Lead a recording to a little before a time; seconds from its beginning that come next.

    Raises
    ------
    InvalidArrayError
        A time behind its end.
    """
    if not isinstance(source, Seekable):
        return 0.0
    if start >= source.duration and start > 0.0:
        raise InvalidArrayError(
            f"no moment at {start:g} s: {source.info.name!r} lasts {source.duration:.2f} seconds"
        )
    source.seek(max(start - LEAD, 0.0))
    return source.position


def _heard(loop: TouchLoop, seconds: float) -> Iterator[Moment]:
    """Moments of a loop to its end; of a live source for so many seconds of this machine."""
    deadline = time.monotonic() + SILENCE
    silent = True
    while True:
        try:
            moment = loop.step(STEP)
        except SourceEnded:
            return
        if loop.live and time.monotonic() > deadline:
            if silent:
                raise UnreachableError(f"source {loop.info.name!r} sends nothing")
            return
        if moment is None or moment.stale:
            continue
        if silent:
            silent, deadline = False, time.monotonic() + seconds
        yield moment


@dataclass(frozen=True, slots=True)
class Look:
    """How the scene is shown.

    Attributes
    ----------
    layer, style : str or None
        None for what the view says, or the scene's own.
    angles : mapping of str to float
        Joint angles [rad].
    links : iterable of str, "all" or "skin"
        What is drawn of the body.
    size : (int, int) or None
        Width and height of the picture [px]; each kind of picture has its own without.
    ranges
        As `viewer.layers.Layers` takes them.
    view : SavedView or None
        A movie's camera turns to the touches where its mode is "auto", and keeps its view without.
    """

    layer: str | None = None
    style: str | None = None
    angles: dict[str, float] | None = None
    links: Links = "all"
    size: tuple[int, int] | None = None
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    view: SavedView | None = None


def look_beside(look: Look, session: Session, other: Session) -> Look:
    """How another session is shown beside one: without pose and view where the robots differ."""
    same = session.robot.name == other.robot.name
    return look if same else replace(look, view=None, angles=None)


def new_scene(session: Session, look: Look, *, size: tuple[int, int], off_screen: bool) -> Scene:
    """The scene that a user asked for.

    Raises
    ------
    UnknownNameError, SkinMismatchError
        A layer that does not exist, or a view of another robot.
    """
    if look.view is not None:
        check_view(look.view, session.robot)
    scene = Scene(
        session.robot,
        {part: skin.mesh for part, skin in session.skins.items()},
        LazyMaps(session.skins),
        data=new_layers(session, look),
        angles=look.angles or None,
        links=look.links,
        close=set(session.parts) != set(session.robot.parts),
        window_size=look.size or size,
        off_screen=off_screen,
    )
    if look.view is not None:
        selection = Selection()
        apply_view(scene, look.view, selection)
        for part, taxels in selection.items():
            scene.select(part, taxels)
    elif not off_screen:
        scene.framing.mode = "still"  # a camera that turns by itself is asked for (key a)
    if look.layer is not None:
        scene.set_layer(look.layer)
    if look.style is not None:
        scene.set_style(look.style)
    return scene


def new_layers(session: Session, look: Look) -> Layers:
    """What the skin can show, with limits as asked for."""
    return Layers(
        session.skins,
        covariances=session.covariances,
        healths={part: one.health for part, one in session.responses.items()},
        ranges=look.ranges,
        touched=session.touched,
        loads=session.calibrations,
        changed=session.changed,
    )
