"""What `skinmap classify` does: names touches of recordings, event by event, and live ones."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray
from skinmap.cli.classify.classify_result import (
    ClassifyResult,
    ContactLoad,
    Health,
    Latency,
    LiveSummary,
    LiveTouch,
    NamedRow,
    NameSets,
    health_lines,
)
from skinmap.commands.options import open_robot, open_stream
from skinmap.errors import SkinMismatchError, UnknownNameError
from skinmap.io.recordings.touch_files import read_recordings
from skinmap.live.contacts.contact_motion import MotionBook, recorded_course
from skinmap.live.contacts.named_touch import UNNAMED, Moment, TouchEvent
from skinmap.live.loop import TouchLoop
from skinmap.live.publishing.publish import open_publisher
from skinmap.live.response.loads import (
    AROUND,
    TOO_LIGHT,
    ContactForce,
    PartForces,
    far_rest,
    heaviest_load,
    load_calibrations,
    steady,
)
from skinmap.live.response.pressures import load_responses
from skinmap.live.robot_skin import JoinedSkin
from skinmap.live.sources.open_source import open_source
from skinmap.live.sources.source import Counts, SourceEnded, is_live
from skinmap.recognition.answering import lacking
from skinmap.recognition.classifier import Prediction, TouchClassifier
from skinmap.recognition.naming import FINGERTIP, in_words, named_events
from skinmap.report.present import emit_line, object_of
from skinmap.touch.contacts.motion_features import MM, MOTION_FEATURES, motion_features
from skinmap.touch.contacts.rest import ENOUGH
from skinmap.touch.load_calibration import LoadCalibration
from skinmap.touch.prepared_skin import PreparedSkin, prepare_skins
from skinmap.touch.recording import JOIN, Recording
from skinmap.touch.simulation.gestures import FOUR

WAIT = 0.2  # so often a silent source lets an interruption through [s]
HEAD = (
    f"{'began':>11}  {'part':18} {'touch':14} {'sure':>5}  {'hand?':6}  {'lasted':>8}  "
    f"{'area':>16}  {'path':>9}"
)
THREE = "kind", "motion", "hand"  # answers of a touch
LATENCIES = 100_000  # the last ones, that the summary speaks of


def classify_live(
    classifier: TouchClassifier,
    spec: str,
    *,
    robot: str | None,
    parts: tuple[str, ...],
    seconds: float | None,
    seed: int,
    publish: Sequence[str],
    responses: Sequence[str],
    calibrations: Sequence[str],
    as_json: bool,
) -> None:
    """Name touches until the source ends, the seconds are over or the user interrupts.

    Raises
    ------
    SkinError
        A source, calibration or model that does not fit.
    """
    chosen = parts or None
    # A recording that nobody follows is named as fast as it goes.
    speed = float("inf") if Path(spec).exists() and not publish else 1.0
    loaded, source = open_stream(spec, robot, parts, seed=seed, speed=speed)
    with ExitStack() as opened:
        opened.enter_context(closing(source))
        skins = {part: PreparedSkin(loaded.skin(part)) for part in source.info.parts}
        followed = is_live(source)
        loop = TouchLoop(
            loaded,
            source,
            classifier=classifier,
            responses=load_responses(responses, skins),
            calibrations=load_calibrations(calibrations, skins),
            parts=chosen,
            skins=skins,
            singly=not followed,  # so that it ends at the very sample
        )
        if not followed and Path(spec).exists():  # what lies there can be looked at before
            loop.learn_rest(open_source(spec, robot=loaded, parts=chosen, speed=float("inf")))
        _note(classifier, loop.skins)
        run = _Run(loop, spec, classifier.name, paced=np.isfinite(speed), as_json=as_json)
        for one in publish:
            publisher = open_publisher(one, loop.dense_info(), robot=loaded, speed=source.speed)
            loop.subscribe(opened.enter_context(publisher).send)
        try:
            run.until(seconds)
        except KeyboardInterrupt:
            click.echo("interrupted", err=True)
    run.summarise()


def _rank(load: ContactForce) -> tuple[bool, float]:
    """Which load stands for a touch: one beyond the range, else the heaviest; never a light end."""
    if load.refused:
        return load.refused != TOO_LIGHT, -1.0
    return False, load.force.value


class _Heaviest:
    """Load of a live touch at its heaviest moment so far."""

    def __init__(self) -> None:
        self._recent: list[tuple[float, ContactForce]] = []
        self._when, self._top = float("-inf"), ContactForce.none(TOO_LIGHT)
        self._near: list[ContactForce] = []

    def add(self, now: float, load: ContactForce) -> None:
        """Take the load of a moment [s]."""
        kept = [one for one in self._recent if now - one[0] <= AROUND]
        self._recent = [*kept, (now, load)]
        if not self._near or _rank(load) > _rank(self._top):
            self._when, self._top, self._near = now, load, [one for _, one in self._recent]
        elif now - self._when <= AROUND:
            self._near.append(load)

    def load(self) -> ContactForce:
        """The heaviest; one that was refused stays refused."""
        if self._top.refused:
            return self._top
        known = [one for one in self._near if not one.refused]
        return known[steady(np.array([one.force.value for one in known]))]


class _Run:
    """Prints what the loop finds."""

    def __init__(
        self, loop: TouchLoop, spec: str, classifier: str, *, paced: bool, as_json: bool
    ) -> None:
        self.loop, self.spec, self.classifier, self.as_json = loop, spec, classifier, as_json
        self.paced = paced  # else many samples come at once, and wait for each other
        self.started = time.perf_counter()
        self.touches = self.withdrawn = 0
        self.latencies: deque[float] = deque(maxlen=LATENCIES)
        self.loads: dict[int, _Heaviest] = {}  # by number of the touch
        self.first = self.last = float("nan")

    def until(self, seconds: float | None) -> None:
        """Step until the source ends or has been followed for so long [s]."""
        started = time.perf_counter()
        stale = False
        while True:
            try:
                moment = self.loop.step(WAIT)
            except SourceEnded:
                break
            finally:
                self._tell_touches()
            if moment is not None:
                self._weigh(moment)
                if moment.stale != stale:
                    stale = moment.stale
                    what = "nothing comes from" if stale else "samples come again from"
                    click.echo(f"{what} {self.spec}", err=True)
                if not stale:
                    self.latencies.append(moment.latency)
                    self.first = moment.time if self.first != self.first else self.first
                    self.last = moment.time
            if seconds is not None and _passed(self, started) >= seconds:
                break
        self.loop.finish()
        self._tell_touches()

    def _weigh(self, moment: Moment) -> None:
        """Keep the heaviest force of each touch."""
        for touch in moment.touches:
            if touch.load is not None:
                self.loads.setdefault(touch.identity, _Heaviest()).add(moment.time, touch.load)

    def _tell_touches(self) -> None:

        self.withdrawn += len(self.loop.withdrawn())
        for touch in self.loop.finished():
            if touch.label == UNNAMED and not self.loop.live:
                continue  # all samples were named from, and nobody's touch was among these
            self.touches += 1
            heaviest = self.loads.pop(touch.identity, None)
            load = None if heaviest is None else heaviest.load()
            hand = "-" if touch.answers is None else touch.answers.hand.answer
            area = f"{touch.area_least * MM**2:4.0f} to {touch.area * MM**2:4.0f} mm2"
            if self.as_json:
                emit_line(LiveTouch.of(touch, load))
            else:
                if self.touches == 1:
                    click.echo(HEAD)
                name, sure = _shown(touch)
                click.echo(
                    f"{touch.began:9.2f} s  {touch.part:18} {name:14} "
                    f"{sure:5.2f}  {hand:6}  {touch.duration:6.2f} s  "
                    f"{area}  {touch.path_length * MM:6.1f} mm"
                    f"{motion_words(touch)}{'' if load is None else '  ' + load.in_words()}"
                )

    def summarise(self) -> None:
        """Print the last line."""
        late = np.array(self.latencies) * 1e3
        shares = [float(np.percentile(late, k)) if len(late) else None for k in (50, 99, 100)]
        summary = LiveSummary(
            source=self.spec,
            classifier=self.classifier,
            parts=list(self.loop.skins),
            touches=self.touches,
            withdrawn=self.withdrawn,
            seconds=self.last - self.first,
            rate_hz=self.loop.info.rate,
            latency_ms=Latency(median=shares[0], p99=shares[1], max=shares[2]),
            counts=Counts(**self.loop.totals()),
            health={part: Health(**found) for part, found in self.loop.health().items()},
        )
        if self.as_json:
            emit_line(object_of(summary))
            return
        for line in health_lines(summary.health):
            click.echo(line)
        if self.withdrawn:
            click.echo(f"{self.withdrawn} taken back: the taxels are stuck")
        median = "-" if shares[0] is None else f"{shares[0]:.1f}"
        each = 1e3 * (time.perf_counter() - self.started) / max(summary.counts.used, 1)
        pace = f"{median} ms from a sample to its labels (median)"
        click.echo(
            f"{self.touches} touches in {summary.counts.used} samples, "
            f"{summary.counts.faults() or '0 lost'}; "
            f"{pace if self.paced else f'{each:.2f} ms from one sample to the next (mean)'}"
        )


def _shown(touch: TouchEvent) -> tuple[str, float]:
    """Its label and confidence; of a hand's gesture that surely no hand made, the thing instead."""
    found = touch.answers
    if found is None or found.hand.answer != "other" or touch.label not in FOUR:
        return in_words(Prediction(touch.label, touch.confidence, touch.names)), touch.confidence
    if found.kind.answer in FOUR:
        return "not a hand", 1.0 - found.hand.probability
    return found.kind.answer, found.kind.probability


def motion_words(touch: TouchEvent) -> str:
    """Where it went and how fast, how often it was pressed, and whether it was cut off."""
    said = ""
    stays = touch.motion is not None and touch.motion.answer == "still"
    if touch.heading != "still" and not stays:
        said += f"  {touch.heading}, {touch.speed * MM:.0f} mm/s"
    if touch.presses > 1:
        said += f"  {touch.presses} times, {1.0 / touch.period:.1f} a second"
    return said + "  still touched" * touch.unfinished


def _passed(run: _Run, started: float) -> float:
    """Seconds of the stream; where it is live, or of the clock on the wall if nothing comes."""
    stream = run.last - run.first
    wall = time.perf_counter() - started if run.loop.live else 0.0
    return max(wall, stream if stream == stream else 0.0)


def _note(
    classifier: TouchClassifier,
    skins: Mapping[str, PreparedSkin],
    people: Mapping[str, Collection[str]] | None = None,
) -> None:
    """Say what a model does not answer itself, and on which parts, by whom, it has not learnt."""
    if lacks := lacking(classifier):
        click.echo(f"note: the model {lacks}", err=True)
    _note_coarse(skins.values())
    found = {
        part: classifier.difference(one.skin, tuple(people[part]) if people else ("",)).message
        for part, one in skins.items()
    }
    strange = [part for part, message in found.items() if message]
    if len(strange) > 1 and people is None:
        click.echo(f"note: skins differ from those learnt: {', '.join(strange)}", err=True)
        return
    for part in strange:
        click.echo(f"note: {found[part]}", err=True)


def _note_coarse(skins: Iterable[PreparedSkin]) -> None:
    """Say of each skin with taxels wider apart than a fingertip that it feels none between them."""
    for one in skins:
        if one.skin.spacing > FINGERTIP:
            click.echo(
                f"note: taxels of {one.skin.part!r} lie {one.skin.spacing * MM:.0f} mm apart, more "
                "than a fingertip: a press on one alone counts as a spike, as no contact",
                err=True,
            )


def name_recorded(
    classifier: TouchClassifier,
    path: Path,
    robot: str | None,
    parts: tuple[str, ...],
    calibrations: Sequence[str] = (),
) -> ClassifyResult:
    """Name the touches of each event and compare them with what was recorded."""
    recordings = read_recordings(path)
    loaded, wanted = open_robot(robot, parts)
    chosen = [one for one in recordings if one.part in wanted]
    if not chosen:
        known = [one.part for one in recordings]
        if parts:
            raise UnknownNameError("recorded part", parts[0], known)
        raise SkinMismatchError(
            f"the recording has parts {', '.join(known)}; {loaded.name} has none of them: name "
            "its robot by --robot"
        )
    skins = prepare_skins(loaded, chosen)
    classifier.check_skins(skins.values())
    people: dict[str, dict[str, None]] = {part: {} for part in skins}
    for one in chosen:
        people[one.part] |= dict.fromkeys(one.people)
    _note(classifier, skins, people)
    _note_labels(classifier, chosen)
    loads = load_calibrations(calibrations, skins)
    rows: list[NamedRow] = []
    right = 0
    for one in chosen:
        weigh = _weighing(one, skins[one.part], loads.get(one.part))
        found, hits = _name_events(classifier, skins[one.part], one, weigh)
        rows.extend(found)
        right += hits
    events = sum(len(one.labels) for one in chosen)
    return ClassifyResult(
        classifier=classifier.name,
        touches=rows,
        events=events,
        accuracy=right / events if events else None,
        sets=_sets(classifier, rows),
        health=_health(chosen, skins),
    )


def _sets(classifier: TouchClassifier, rows: Sequence[NamedRow]) -> NameSets | None:
    """How the promised coverage was kept; None where none was asked for."""
    if classifier.coverage is None:
        return None
    names = [row.names or [] for row in rows]
    held = [row.recorded_label in own for row, own in zip(rows, names, strict=True)]
    return NameSets(
        coverage=classifier.coverage,
        held=float(np.mean(held)) if held else None,
        mean_size=float(np.mean([len(own) for own in names])) if names else None,
    )


def _health(
    recordings: Sequence[Recording], skins: Mapping[str, PreparedSkin]
) -> dict[str, Health]:
    """Channels that hang or are noisy between the touches, by part."""
    health = {}
    for part, skin in skins.items():
        rests = [one.rest() for one in recordings if one.part == part]
        stuck, noisy = (
            skin.skin.channels[np.any(rows, axis=0)].tolist()
            for rows in ([rest.stuck for rest in rests], [rest.noisy for rest in rests])
        )
        if stuck or noisy:
            health[part] = Health(stuck=stuck, noisy=noisy, dead=[], unheard=[])
    return health


def _name_events(
    classifier: TouchClassifier,
    skin: PreparedSkin,
    recording: Recording,
    weigh: Callable[[int, BoolArray], ContactLoad | None],
) -> tuple[list[NamedRow], int]:
    """A row for each touch of each event, and how many events were understood in full."""
    rows, right = [], 0
    book = MotionBook(JoinedSkin({recording.part: skin}))
    for event, samples, named, understood in named_events(classifier, skin, recording):
        right += understood
        for number, (touch, recorded) in enumerate(named):
            taxels, said = touch.taxels, touch.prediction
            answers: dict[str, Any] = {one: getattr(said.answers, one, None) for one in THREE}
            row = NamedRow(
                part=recording.part,
                event=event,
                touch=number,
                label=said.label,
                confidence=said.confidence,
                names=None if said.names is None else list(said.names),
                recorded_label=recorded,
                **answers,
                channels=skin.skin.channels[taxels].tolist(),
                load=weigh(event, taxels) if taxels.any() else None,
                **_motion(skin, book, samples, taxels, recording.rate),
            )
            rows.append(row)
    return rows, right


def _weighing(
    recording: Recording, skin: PreparedSkin, calibration: LoadCalibration | None
) -> Callable[[int, BoolArray], ContactLoad | None]:
    """How touches of a recording are weighed, by event and taxels (n,)."""
    if calibration is None:
        return lambda event, taxels: None

    # A rest that is hardly recorded tells nothing of the calibration.
    offset, enough = recording.rest().offset, (recording.events < 0).sum() >= ENOUGH
    if enough and (reason := far_rest(calibration, offset, pressures=True)):
        return lambda event, taxels: ContactLoad(**ContactForce.none(reason).plain())
    forces = PartForces(skin, calibration.answered, calibration.covering)
    found = calibration.pressures(recording.pressures, recording.times)
    rows = recording.rows()

    def weigh(event: int, taxels: BoolArray) -> ContactLoad:
        own = heaviest_load(forces, calibration, found, rows[event], taxels, recording.rate)
        return ContactLoad(**own.plain())

    return weigh


def _motion(
    skin: PreparedSkin, book: MotionBook, samples: NDArray[np.uint8], taxels: BoolArray, rate: float
) -> dict[str, Any]:
    """What a row says of how a touch went on."""
    own = np.where(taxels, samples, 0).astype(np.uint8)
    found = motion_features(skin.geometry, own, rate)
    number = dict(zip(MOTION_FEATURES, found.tolist(), strict=True))
    presses = int(number["presses"])
    course = recorded_course(book, own, rate)
    return {
        "heading": course.heading,
        "up_mm": course.up * MM,
        "right_mm": course.right * MM,
        "way_mm": number["way_mm"],
        "speed_mm_s": number["speed_mm_s"],
        "presses": presses,
        "period_ms": number["period_ms"] if presses > 1 else None,
        "twist_deg": number["turned_deg"],
    }


def _note_labels(classifier: TouchClassifier, recordings: Sequence[Recording]) -> None:
    """Say which recorded labels the model lacks."""
    recorded = {kind for one in recordings for label in one.labels for kind in label.split(JOIN)}
    strange = sorted(recorded - set(classifier.labels))
    if strange:
        click.echo(
            f"note: recorded as {', '.join(strange)}, which the model lacks; "
            f"its labels are {', '.join(classifier.labels)}",
            err=True,
        )
