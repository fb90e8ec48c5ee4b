"""One check-up: the rest of a skin, then touches one after the other, to the last word."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy.spatial import cKDTree

from calibration.files.tables import check_places, read_places
from calibration.wiring.boards import Boards, boards_of
from calibration.wiring.doctor import CLEAR, Doctor
from calibration.wiring.places import AGAIN
from calibration.wiring.touches import (
    BEGINS,
    ENDS,
    LEAST_REST,
    THRESHOLD,
    Baseline,
    RestFindings,
    find_touches,
    judge_rest,
    make_touch,
    untouched,
    without_holes,
    without_spikes,
)
from skinmap.arrays import BoolArray, FloatArray
from skinmap.errors import DataFormatError, InvalidArrayError, SkinMismatchError, check_known
from skinmap.geometry.proximity import nearest_first
from skinmap.report.present import singular
from skinmap.skin.robot import Robot

if TYPE_CHECKING:
    from skinmap.io.recordings.recorded_stream import RecordedStream
    from skinmap.live.sources.source import Source

MM = 1e3
ENOUGH = 0.005  # a place that would tell less is not worth a touch [nats]
REST_SECONDS, SECONDS = 5.0, 60.0  # untouched, and in all, on the clock of the skin [s]
COST = {"poke": 2.0, "stroke": 2.5}  # of a touch and the way to it [s]
PATIENCE = 15.0  # that a touch is waited for [s]
BESIDE, OFTEN = 8e-3, 2  # taxels so near a stroke are felt [m]; strokes that measure a gain
DATED = 1e9  # later times of a recording are seconds of Unix (since September 2001)
MAX_REST = 3000  # samples of a recording's rest that are judged


class Marker(Protocol):
    """Shows on the body where to touch next: the viewer's, found by its entry point."""

    def show(self, part: str, path: FloatArray, words: str) -> None:
        """Mark a place (p, 3) of a part [m], with a line of words."""

    def feed(self, part: str, answers: FloatArray) -> None:
        """Show answers (n,) of a part [counts]."""

    def close(self) -> None:
        """End it."""


@dataclass(frozen=True, eq=False, kw_only=True, slots=True)
class Plan:
    """How a skin is examined.

    Attributes
    ----------
    told : callable
        Gets a line for people now and then.
    markers : sequence of Marker
        Get each place that is asked for.
    covers : bool
        Whether a skin without faults is stroked all over, to measure gains.
    """

    told: Callable[[str], None] = lambda _: None
    markers: Sequence[Marker] = ()
    covers: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Asked:
    """A touch to ask for: its part, kind, path (p, 3) [m] and worth [nats]."""

    part: str
    how: str
    path: FloatArray
    gain: float


@dataclass(eq=False)
class Case:
    """One part under examination."""

    part: str
    doctor: Doctor
    rest: RestFindings | None = None
    beside: BoolArray | None = None  # (strokes, n) taxels that each stroke passes

    @property
    def boards(self) -> Boards:
        """Of the part."""
        return self.doctor.boards

    def take_rest(self, samples: FloatArray) -> None:
        """Judge samples (t, n) at rest, where there are enough."""
        if len(samples) >= LEAST_REST:
            self.rest = judge_rest(samples, self.boards)
            self.doctor.rest(self.rest)

    def without_noisy(self, base: Baseline) -> Baseline:
        """A baseline above which noisy channels never rise: they would answer all the time."""
        noisy = [row for one in (self.rest.rows("noisy") if self.rest else []) for row in one]
        sign = base.sign.copy()
        sign[..., noisy] = 0.0
        return replace(base, sign=sign)


@dataclass(frozen=True, eq=False, slots=True)
class Examination:
    """Result of all parts.

    Attributes
    ----------
    source, robot : str
    cases : tuple of Case
    skin_seconds : float
        Duration on the clock of the skin [s].
    notes : tuple of str
        Questions that stay open.
    recorded : datetime, optional
        Beginning of a recording whose clock has a date.
    """

    source: str
    robot: str
    cases: tuple[Case, ...]
    skin_seconds: float
    notes: tuple[str, ...] = ()
    recorded: datetime | None = None


def open_cases(robot: Robot, parts: Sequence[str]) -> dict[str, Case]:
    """A doctor for each part."""
    return {part: Case(part, Doctor.of(boards_of(robot, part))) for part in parts}


def next_touch(cases: Mapping[str, Case], *, covers: bool = False) -> Asked | None:
    """The touch that tells most a second; None where nothing is left to ask."""
    best: Asked | None = None
    for part, case in cases.items():
        clear = covers and case.doctor.healthy >= CLEAR and not case.doctor.found
        for how in ("stroke",) if clear else ("stroke", "poke"):
            path, gain = _uncovered(case) if clear else case.doctor.next_place(how)
            if best is None or gain / COST[how] > best.gain / COST[best.how]:
                best = Asked(part, how, path, gain)
    return best if best is not None and best.gain > ENOUGH else None


def _uncovered(case: Case) -> tuple[FloatArray, float]:
    """The stroke that passes most taxels whose gain is not measured yet, and their share."""
    case.doctor.next_place("stroke")
    positions, paths = case.boards.table.positions, case.doctor.places["stroke"].paths
    if case.beside is None:
        tree = cKDTree(positions)
        beside = np.zeros((len(paths), len(positions)), bool)
        for own, path in zip(beside, paths, strict=True):
            own[[row for near in tree.query_ball_point(path, BESIDE) for row in near]] = True
        case.beside = beside
    felt = np.sum([one.response > THRESHOLD for one in case.doctor.touches], axis=0)
    share = (case.beside & (felt < OFTEN)).mean(axis=1)
    asked = [one.middle for one in case.doctor.touches]
    for row, path in enumerate(paths):
        if asked and np.linalg.norm(path[len(path) // 2] - asked, axis=1).min() < AGAIN:
            share[row] *= 0.5
    best = int(np.argmax(share))
    return paths[best], float(share[best])


def _ask(
    cases: Mapping[str, Case], plan: Plan, stream: _Stream, level: dict[str, Baseline]
) -> Iterator[str]:
    """Name one place after the other, and hear what answers; gives the places where nothing did."""
    for number in count(1):
        asked = next_touch(cases, covers=plan.covers) if stream.seconds < SECONDS else None
        if asked is None:
            return
        words = place_words(cases[asked.part].boards, asked)
        plan.told(f"{number}. {words}")
        for marker in plan.markers:
            marker.show(asked.part, asked.path, words)
        heard = stream.touch(level, plan)
        if heard is None:
            yield words
            heard = {asked.part: np.zeros((1, len(cases[asked.part].boards.table)))}
        _hear(cases[asked.part], heard[asked.part], asked.how, asked.path, plan)


def _hear(case: Case, above: FloatArray, how: str, path: FloatArray, plan: Plan) -> None:
    touch = make_touch(without_spikes(above), how, path, above)
    new = case.doctor.hear(touch)
    felt = touch.response > THRESHOLD
    modules = np.unique(case.boards.table.modules[felt]).tolist()
    which = f"module{'s' * (len(modules) > 1)} {', '.join(map(str, modules))}"
    answered = f"   answered: {int(felt.sum())} channels of {which if modules else 'no module'}"
    plan.told(singular(answered))
    for found in new:
        plan.told(f"   {found.fault.words(case.boards)} ({100 * found.confidence:.1f} %)")


def conclude(cases: Mapping[str, Case], plan: Plan) -> tuple[Case, ...]:
    """The cases, with what is certainly wrong though not sure which fault it is."""
    for case in cases.values():
        for found in case.doctor.conclude():
            plan.told(f"   {found.fault.words(case.boards)} ({100 * found.confidence:.1f} %)")
    return tuple(cases.values())


def examine_recording(
    path: Path, robot: Robot, parts: Sequence[str], plan: Plan, *, places: Path | None
) -> Examination:
    """Examine a recording of touches by a person.

    Parameters
    ----------
    path : Path
    robot : Robot
        That was recorded.
    parts : sequence of str
        Parts to examine; all that were recorded by default.
    plan : Plan
    places : Path or None
        A table of where the touches were asked for [m].

    Returns
    -------
    Examination
        A case for each part.

    Raises
    ------
    SkinMismatchError
        Samples of another length than the skin.
    DataFormatError
        Places that do not belong to it.
    """
    from skinmap.live.sources.open_source import open_track
    from skinmap.live.sources.source import check_skin

    track = open_track(path, robot=robot)
    for part in parts:
        check_known(f"part in {path}", [part], track.parts)
    there = tuple(parts) or track.parts
    info = track.info
    for part in there:
        robot.part(part)
    check_skin(info, robot)
    cases = open_cases(robot, there)
    for part, case in cases.items():
        values = np.zeros((len(track.times), info.widths[info.parts.index(part)]))
        for rows, block in track.blocks():
            values[rows] = block[:, info.part_slice(part)]
        if values.shape[1] != len(case.boards.table):
            values = values[:, case.boards.table.channels]
        _examine_part(case, values, track, path, places, plan)
    touched = any(case.doctor.touches for case in cases.values())
    notes = () if touched else ("no touch, or no --places of them: only the rest was judged",)
    began, ended = (float(track.times[end]) if len(track.times) else 0.0 for end in (0, -1))
    recorded = datetime.fromtimestamp(began, UTC) if DATED < began < time.time() else None
    done = conclude(cases, plan)
    return Examination(path.name, robot.name, done, ended - began, notes, recorded)


def _examine_part(
    case: Case,
    values: FloatArray,
    track: RecordedStream,
    path: Path,
    places: Path | None,
    plan: Plan,
) -> None:
    """Rest and touches of one part; touches only where their places are known."""
    marked = [t for t in track.touches if t.part == case.part and t.last >= t.first]
    spans = np.array([[touch.first, touch.last] for touch in marked]).reshape(-1, 2)
    quiet = untouched(len(values), spans)
    base = Baseline.along(without_holes(values), quiet, track.kind, track.info.rate)
    if not marked:
        spans = find_touches(base.answers(values))
        quiet = untouched(len(values), spans)
    case.take_rest(values[quiet][:MAX_REST])
    above = case.without_noisy(base).above(values)
    if places is None:
        return
    rows = read_places(places, case.part)
    check_places(rows, case.boards.table.positions, case.part, places)
    if all(row.span is not None for row in rows):
        spans = np.array([np.searchsorted(track.times, row.span or (0.0, 0.0)) for row in rows])
        spans[:, 1] = np.maximum(spans[:, 1] - 1, spans[:, 0])
        if spans.max(initial=0) >= len(values):
            raise DataFormatError(f"times of touches lie beyond {path.name}", places)
    elif len(rows) != len(spans):
        raise DataFormatError(
            f"places for {len(rows)} touches, {path.name} holds {len(spans)} on {case.part!r}; "
            "give start_s,end_s where some were not felt",
            places,
        )
    for (begin, end), row in zip(spans.tolist(), rows, strict=True):
        how = "stroke" if len(row.path) > 1 else "poke"
        _hear(case, above[begin : end + 1], how, row.path, plan)


def place_words(boards: Boards, asked: Asked) -> str:
    """Where to touch, for people: the nearest taxels by channel and module."""
    spots, path, modules = [], asked.path, boards.table.modules
    for point in (path[0], path[-1]) if len(path) > 1 else (path[0],):
        away = np.linalg.norm(boards.table.positions - point, axis=1)
        order = nearest_first(away)
        nearest = int(order[0])
        other = next((int(row) for row in order[1:12]
                      if modules[row] != modules[nearest]
                      and away[row] < away[nearest] + 4e-3), None)  # fmt: skip
        x, y, z = (MM * point).tolist()
        words = f"module {modules[nearest]}"
        if other is not None:
            words = f"between modules {modules[nearest]} and {modules[other]}"
        spots.append(f"{words} ({x:.0f}, {y:.0f}, {z:.0f} mm)")
    if asked.how == "stroke":
        return f"stroke {boards.part} from {spots[0]} to {spots[-1]}"
    return f"poke {boards.part}: {spots[0]}"


def examine_live(source: Source, robot: Robot, parts: Sequence[str], plan: Plan) -> Examination:
    """Ask a person at the robot to touch, one place after the other.

    Parameters
    ----------
    source : Source
        Samples of the robot.
    robot : Robot
    parts : sequence of str
        Parts to examine; all that the source has by default.
    plan : Plan

    Returns
    -------
    Examination
        A case for each part; on Ctrl-C by what was touched until then.

    Raises
    ------
    SkinMismatchError
        A stream of another skin.
    InvalidArrayError
        A stream that ends, or sends no numbers at all.
    """
    from skinmap.live.sources.source import check_skin

    info = source.info
    there = tuple(parts) or tuple(part for part in info.parts if part in robot.parts)
    for part in there:
        info.part_slice(part)
    check_skin(info, robot)
    cases = open_cases(robot, there)
    next_touch(cases)  # what takes seconds once, before anybody waits for it
    stream = _Stream(source, cases)
    notes: list[str] = []
    try:
        level = stream.rest(cases, plan)
        for words in _ask(cases, plan, stream, level):
            notes.append(f"nothing answered within {PATIENCE:.0f} s at: {words}")
    except KeyboardInterrupt:
        plan.told("interrupted")
        notes.append("interrupted: judged by the touches until then")
    done = conclude(cases, plan)
    return Examination(info.name, robot.name, done, stream.seconds, tuple(notes))


class _Stream:
    """Samples of the parts under examination, touch by touch."""

    def __init__(self, source: Source, cases: Mapping[str, Case]) -> None:
        self.source, self.rate = source, source.info.rate or 50.0
        self.seconds = 0.0  # that were read
        self.columns = {}
        for part, case in cases.items():
            rows = np.arange(source.info.channels)[source.info.part_slice(part)]
            channels = case.boards.table.channels
            self.columns[part] = rows if len(rows) == len(channels) else rows[channels]

    def read(self) -> dict[str, FloatArray] | None:
        """Samples by part, or None."""
        from skinmap.live.sources.source import SourceEnded

        try:
            block = self.source.read(0.2)
        except SourceEnded:
            raise InvalidArrayError("the source ended before the examination did") from None
        if block is None or len(block) == 0:
            return None
        self.seconds += len(block) / self.rate
        values = np.asarray(block.values, np.float64)
        if values.shape[1] != self.source.info.channels:
            raise SkinMismatchError(
                f"{values.shape[1]} values in a sample, {self.source.info.channels} expected"
            )
        return {part: values[:, columns] for part, columns in self.columns.items()}

    def rest(self, cases: Mapping[str, Case], plan: Plan) -> dict[str, Baseline]:
        """Judge the rest at the beginning; what each part sends untouched.

        Raises
        ------
        InvalidArrayError
            Too few samples came.
        """
        plan.told(f"do not touch the skin for {REST_SECONDS:.0f} s")
        blocks: list[dict[str, FloatArray]] = []
        end = time.monotonic() + 5.0 * REST_SECONDS
        while sum(len(next(iter(b.values()))) for b in blocks) < round(REST_SECONDS * self.rate):
            if time.monotonic() > end:
                raise InvalidArrayError("the source sends too few samples for a rest")
            if (block := self.read()) is not None:
                blocks.append(block)
        samples = {part: np.concatenate([b[part] for b in blocks]) for part in self.columns}
        for part, case in cases.items():
            case.take_rest(samples[part])
        level = {part: Baseline.of(one, self.source.info.kind) for part, one in samples.items()}
        return {part: case.without_noisy(level[part]) for part, case in cases.items()}

    def touch(self, level: dict[str, Baseline], plan: Plan) -> dict[str, FloatArray] | None:
        """Samples (t, n) above rest by part from a touch's beginning to its end; None for none."""
        kept: dict[str, list[FloatArray]] = {part: [] for part in self.columns}
        last = {part: np.zeros(len(columns)) for part, columns in self.columns.items()}
        quiet, felt = 0, 0
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            block = self.read()
            if block is None:
                continue
            active = np.zeros(len(next(iter(block.values()))), bool)
            for part, values in block.items():
                above = level[part].above(values)
                # A channel that answers in one sample only is a spike; large skins have many.
                held = np.minimum(above, np.vstack([last[part], above[:-1]]))
                last[part] = above[-1]
                active |= (held > THRESHOLD).any(axis=1)
                for marker in plan.markers:
                    marker.feed(part, np.maximum(above[-1], 0.0))
            if not active.any() and not felt:
                for part, values in block.items():
                    level[part] = level[part].followed(values, self.rate)
            else:
                for part, values in block.items():
                    kept[part].append(values)
                felt += int(active.sum())
                quiet = 0 if active[-1] else quiet + len(active)
            if felt and quiet > ENDS:
                found = {p: level[p].above(np.concatenate(v)) for p, v in kept.items()}
                top = max(without_spikes(one).max() for one in found.values())
                if felt >= BEGINS and top > THRESHOLD:
                    return found
                kept, felt, quiet = {part: [] for part in self.columns}, 0, 0  # a spike
        return None
