"""What `skinmap wiring` does: rest, touches and verdict of a robot's parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from calibration.wiring.boards import CHAIN, Boards, Wiring, boards_of
from calibration.wiring.channel_map import check_free, corrected, write_map
from calibration.wiring.doctor import Doctor, Found
from calibration.wiring.evidence import THRESHOLD
from calibration.wiring.faults import Fault
from calibration.wiring.person import Patient, Person
from calibration.wiring.places_file import check_places, read_places
from calibration.wiring.rest import FEWEST, RestFindings, judge_rest
from calibration.wiring.samples import Baseline, find_touches, make_touch, untouched
from skinmap.arrays import FloatArray
from skinmap.errors import DataFormatError, InvalidArrayError, SkinMismatchError, UnknownNameError
from skinmap.skin.robot import Robot

MM = 1e3
ENOUGH = 0.02  # a place that would tell less is not worth a touch [nats]
TRIED = 3  # touches in which a taxel should have answered before it counts as mute
SURELY = 60.0  # counts that its neighbours answered with
REST_SECONDS = 8.0
REST_MOST = 3000  # samples of a recording's rest that are judged
HANDS = {"whole_hand", "forearm", "three_finger", "full_finger", "edge", "cylinder", "hand"}
ORDER = ("inconsistent", "faulty", "undecided", "healthy")  # worst first


class Marker(Protocol):
    """Shows on the body where to touch next: the viewer's, found by its entry point."""

    def show(self, part: str, path: FloatArray, words: str) -> None:
        """Mark a place (p, 3) of a part [m], with a line of words."""

    def feed(self, part: str, answers: FloatArray) -> None:
        """Show answers (n,) of a part [counts]."""

    def close(self) -> None:
        """End it."""


@dataclass(eq=False)
class Case:
    """One part under examination.

    Attributes
    ----------
    part : str
    doctor : Doctor
    rest : RestFindings or None
    places_known : bool
    """

    part: str
    doctor: Doctor
    rest: RestFindings | None = None
    places_known: bool = True

    @property
    def boards(self) -> Boards:
        """Of the part."""
        return self.doctor.boards


@dataclass(frozen=True, eq=False, slots=True)
class Examination:
    """Result of all parts.

    Attributes
    ----------
    source, robot, how : str
    cases : tuple of Case
    planted : mapping of str to tuple of Fault
        Of the simulated skin, by part.
    notes : tuple of str
        What could not be told.
    """

    source: str
    robot: str
    how: str
    cases: tuple[Case, ...]
    planted: Mapping[str, tuple[Fault, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def open_cases(robot: Robot, parts: Sequence[str], *, chain: int = CHAIN) -> dict[str, Case]:
    """A doctor for each part."""
    return {part: Case(part, Doctor.of(boards_of(robot, part, chain=chain))) for part in parts}


def take_rest(case: Case, samples: FloatArray) -> None:
    """Judge samples (t, n) at rest, where there are enough."""
    if len(samples) >= FEWEST:
        case.rest = judge_rest(samples, case.boards)
        case.doctor.rest(case.rest)


def next_touch(cases: Mapping[str, Case], how: str) -> tuple[str, FloatArray, float] | None:
    """Part and path (p, 3) [m] that tell most, and how much; None where nothing is left to ask."""
    best: tuple[str, FloatArray, float] | None = None
    for part, case in cases.items():
        path, gain = case.doctor.next_place(how)
        if best is None or gain > best[2]:
            best = part, path, gain
    return best if best is not None and best[2] > ENOUGH else None


# The simulated skin.


def examine_simulated(
    robot: Robot,
    parts: Sequence[str],
    planted: Sequence[str],
    *,
    how: str,
    most: int,
    seed: int,
    chain: int = CHAIN,
    told: Callable[[str], None] = lambda _: None,
    marker: Marker | None = None,
) -> Examination:
    """Plant faults in a simulated skin and let a simulated person touch where asked.

    `planted` are words as `calibration.wiring.faults.parse_fault` reads them, for the first part,
    or for another one as `part/swap:3,7`.
    """
    cases = open_cases(robot, parts, chain=chain)
    faults = _planted(planted, cases)
    people: dict[str, Person] = {}
    for number, (part, case) in enumerate(cases.items()):
        wiring = Wiring.as_mapped(case.boards)
        for fault in faults.get(part, ()):
            wiring = fault.apply(wiring, case.boards)
        rng = np.random.default_rng([seed, number])
        people[part] = Person(Patient(robot.skin(part)), rng, wiring.sources(case.boards))
    level: dict[str, Baseline] = {}
    for part, case in cases.items():
        rest = people[part].rest(round(50 * REST_SECONDS)).astype(np.float64)
        take_rest(case, rest)
        level[part] = Baseline.of(rest, "pressure")
    for number in range(1, most + 1):
        asked = next_touch(cases, how)
        if asked is None:
            break
        part, path, _ = asked
        words = place_words(cases[part].boards, path, how)
        told(f"{number}. {words}")
        if marker is not None:
            marker.show(part, path, words)
        person = people[part]
        sent = {"poke": person.poke, "hand": person.hold}.get(how)
        samples = person.stroke(path) if sent is None else sent(path[0])
        answers = level[part].answers(samples)
        _hear(cases[part], answers, how, path, told)
        if marker is not None:
            marker.feed(part, answers.max(axis=0))
    return _concluded("sim", robot.name, how, cases, faults, told)


def _planted(words: Sequence[str], cases: Mapping[str, Case]) -> dict[str, tuple[Fault, ...]]:
    from calibration.wiring.faults import parse_fault

    faults: dict[str, tuple[Fault, ...]] = {}
    for word in words:
        part, slash, rest = word.rpartition("/")
        part = part if slash else next(iter(cases))
        if part not in cases:
            raise UnknownNameError("part", part, cases)
        faults[part] = (*faults.get(part, ()), parse_fault(rest, cases[part].boards))
    return faults


def _hear(
    case: Case,
    answers: FloatArray,
    how: str,
    path: FloatArray | None,
    told: Callable[[str], None],
) -> None:
    touch = make_touch(answers, how, path)
    new = case.doctor.hear(touch)
    felt = touch.response > THRESHOLD
    modules = np.unique(case.boards.table.modules[felt]).tolist()
    told(f"   answered: {int(felt.sum())} channels of {_listed('module', modules)}")
    for found in new:
        told(f"   {found.fault.words(case.boards)} ({100 * found.confidence:.1f} %)")


def _concluded(
    source: str,
    robot: str,
    how: str,
    cases: Mapping[str, Case],
    planted: Mapping[str, tuple[Fault, ...]],
    told: Callable[[str], None],
    notes: Sequence[str] = (),
) -> Examination:
    for case in cases.values():
        for found in case.doctor.conclude():
            told(f"   {found.fault.words(case.boards)} ({100 * found.confidence:.1f} %)")
    return Examination(source, robot, how, tuple(cases.values()), planted, tuple(notes))


# Recordings.


def examine_recording(
    path: Path,
    robot: Robot,
    parts: Sequence[str],
    *,
    how: str,
    places: Path | None,
    unit: float = 1.0,
    chain: int = CHAIN,
    told: Callable[[str], None] = lambda _: None,
) -> Examination:
    """Examine a recording of touches by a person.

    Raises
    ------
    SkinMismatchError
        Samples of another length than the skin.
    DataFormatError
        No touches in it, NaN, or places that do not belong to it.
    """
    from skinmap.live.sources.open_recording import open_track
    from skinmap.live.sources.skins import check_skin

    track = open_track(path, robot=robot)
    for part in parts:
        if part not in track.parts:
            raise UnknownNameError(f"part in {path}", part, track.parts)
    there = tuple(parts) or track.parts
    info = track.info
    for part in there:
        robot.part(part)
    check_skin(info, robot)
    cases = open_cases(robot, there, chain=chain)
    notes: list[str] = []
    touches = 0
    for part, case in cases.items():
        values = np.asarray(track.values[:], np.float64)[:, info.part_slice(part)]
        if not np.isfinite(values).all():
            raise DataFormatError(f"samples of {part!r} hold NaN or infinity", path)
        if values.shape[1] != len(case.boards.table):
            values = values[:, case.boards.table.channels]
        marked = [t for t in track.touches if t.part == part and t.last >= t.first]
        touches += _examine_part(case, values, track, marked, (path, places, unit), how, told,
                                 notes)  # fmt: skip
    if touches == 0:
        notes.append("the recording holds no touch: only the rest was judged")
    return _concluded(path.name, robot.name, how, cases, {}, told, notes)


def _examine_part(
    case: Case,
    values: FloatArray,
    track: Any,
    marked: Sequence[Any],
    files: tuple[Path, Path | None, float],
    how: str,
    told: Callable[[str], None],
    notes: list[str],
) -> int:
    """Rest and touches of one part; how many touches."""
    path, places, unit = files
    first = Baseline.of(values[: max(10, min(len(values), 100))], track.kind)
    if len(marked):
        spans = np.array([[touch.first, touch.last] for touch in marked])
    else:
        spans = find_touches(Baseline.of(values, track.kind).answers(values))
    quiet = values[untouched(len(values), spans)][:REST_MOST]
    take_rest(case, quiet)
    base = Baseline.of(quiet, track.kind) if len(quiet) >= 10 else first
    labels = [touch.label for touch in marked] or [""] * len(spans)
    asked: list[FloatArray | None] = [None] * len(spans)
    case.places_known = places is not None
    if places is not None:
        rows = read_places(places, case.part, unit)
        check_places(rows, case.boards.table.positions, case.part, places)
        if all(row.span is not None for row in rows):
            spans = np.array([np.searchsorted(track.times, row.span or (0.0, 0.0)) for row in rows])
            spans[:, 1] = np.maximum(spans[:, 1] - 1, spans[:, 0])
            if spans.max(initial=0) >= len(values):
                raise DataFormatError(f"times of touches lie beyond {path.name}", places)
            labels = [""] * len(rows)
        elif len(rows) != len(spans):
            raise DataFormatError(
                f"places for {len(rows)} touches, {path.name} holds {len(spans)} on "
                f"{case.part!r}; give start_s,end_s where some were not felt", places,
            )  # fmt: skip
        asked = [row.path for row in rows]
    used = 0
    for (begin, end), label, place in zip(spans.tolist(), labels, asked, strict=True):
        kind = "hand" if label in HANDS else how
        if place is not None and len(place) > 1:
            kind = "stroke"
        if place is None and kind != "poke":
            continue  # without its place only a poke is small enough to tell something
        used += 1
        _hear(case, base.answers(values[begin : end + 1]), kind, place, told)
    if len(spans) > used:
        notes.append(f"{case.part}: {len(spans) - used} touches left out: too large to tell "
                     "anything without their places")  # fmt: skip
    if used and not case.places_known:
        notes.append(
            f"{case.part}: no places are known: a fault shows only where a touch lies across "
            "modules; mute modules, and swaps that no touch straddled, cannot be told"
        )
    return used


# Live.


def examine_live(
    source: Any,
    robot: Robot,
    parts: Sequence[str],
    *,
    how: str,
    most: int,
    patience: float,
    chain: int = CHAIN,
    told: Callable[[str], None] = lambda _: None,
    marker: Marker | None = None,
) -> Examination:
    """Ask a person at the robot to touch, one place after the other.

    Raises
    ------
    SkinMismatchError
        A stream of another skin.
    InvalidArrayError
        A stream that ends, or NaN in it.
    """
    from skinmap.live.sources.skins import check_skin

    info = source.info
    there = tuple(parts) or tuple(part for part in info.parts if part in robot.parts)
    for part in there:
        info.part_slice(part)
    check_skin(info, robot)
    cases = open_cases(robot, there, chain=chain)
    next_touch(cases, how)  # what takes seconds once, before anybody waits for it
    stream = _Stream(source, cases)
    notes: list[str] = []
    try:
        level = _rest_of(stream, cases, info, told)
        _ask(stream, cases, level, notes, how=how, most=most, patience=patience, told=told,
             marker=marker)  # fmt: skip
    except KeyboardInterrupt:
        told("interrupted")
        notes.append("interrupted: judged by what was touched until then")
    return _concluded(info.name, robot.name, how, cases, {}, told, notes)


def _rest_of(
    stream: _Stream, cases: Mapping[str, Case], info: Any, told: Callable[[str], None]
) -> dict[str, Baseline]:
    """Judge the rest at the beginning; what each part sends untouched."""
    told(f"do not touch the skin for {REST_SECONDS:.0f} s")
    rate = info.rate or 50.0
    samples = stream.some(round(REST_SECONDS * rate), patience=5.0 * REST_SECONDS)
    level = {}
    for part, case in cases.items():
        take_rest(case, samples[part])
        level[part] = Baseline.of(samples[part], info.kind)
    return level


def _ask(
    stream: _Stream,
    cases: Mapping[str, Case],
    level: Mapping[str, Baseline],
    notes: list[str],
    *,
    how: str,
    most: int,
    patience: float,
    told: Callable[[str], None],
    marker: Marker | None,
) -> None:
    """Name one place after the other, and hear what answers."""
    for number in range(1, most + 1):
        asked = next_touch(cases, how)
        if asked is None:
            break
        part, path, _ = asked
        words = place_words(cases[part].boards, path, how)
        told(f"{number}. {words}")
        if marker is not None:
            marker.show(part, path, words)
        heard = stream.touch(level, patience, marker)
        if heard is None:
            notes.append(f"nothing answered within {patience:.0f} s at: {words}")
            answers = np.zeros((1, len(cases[part].boards.table)))
        else:
            answers = heard[part]
        _hear(cases[part], answers, how, path, told)


class _Stream:
    """Samples of the parts under examination, touch by touch."""

    def __init__(self, source: Any, cases: Mapping[str, Case]) -> None:
        self.source, self.columns = source, {}
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
        values = np.asarray(block.values, np.float64)
        if values.shape[1] != self.source.info.channels:
            raise SkinMismatchError(
                f"{values.shape[1]} values in a sample, {self.source.info.channels} expected"
            )
        if not np.isfinite(values).all():
            return None  # a sample with holes is none
        return {part: values[:, columns] for part, columns in self.columns.items()}

    def some(self, count: int, *, patience: float) -> dict[str, FloatArray]:
        """So many samples.

        Raises
        ------
        InvalidArrayError
            Too few came.
        """
        import time

        blocks: list[dict[str, FloatArray]] = []
        end = time.monotonic() + patience
        while sum(len(next(iter(b.values()))) for b in blocks) < count:
            if time.monotonic() > end:
                raise InvalidArrayError("the source sends too few samples for a rest")
            if (block := self.read()) is not None:
                blocks.append(block)
        return {part: np.concatenate([b[part] for b in blocks]) for part in self.columns}

    def touch(
        self, level: Mapping[str, Baseline], patience: float, marker: Marker | None
    ) -> dict[str, FloatArray] | None:
        """Answers (t, n) by part from a touch's beginning to its end; None where none came."""
        import time

        kept: dict[str, list[FloatArray]] = {part: [] for part in self.columns}
        quiet, felt = 0, 0
        end = time.monotonic() + patience
        while time.monotonic() < end:
            block = self.read()
            if block is None:
                continue
            active = np.zeros(len(next(iter(block.values()))), bool)
            for part, values in block.items():
                above = (values - level[part].level) * level[part].sign
                active |= (above > THRESHOLD).any(axis=1)
                if marker is not None:
                    marker.feed(part, np.maximum(above[-1], 0.0))
            if active.any() or felt:
                for part, values in block.items():
                    kept[part].append(values)
                felt += int(active.sum())
                quiet = 0 if active[-1] else quiet + len(active)
            if felt and quiet > 12:
                if felt >= 3:
                    return {p: level[p].answers(np.concatenate(v)) for p, v in kept.items()}
                kept, felt, quiet = {part: [] for part in self.columns}, 0, 0  # a spike
        return None


# Words, rows and files.


def place_words(boards: Boards, path: FloatArray, how: str) -> str:
    """Where to touch, for people: the nearest taxels by channel and module."""
    spots = []
    for point in (path[0], path[-1]) if len(path) > 1 else (path[0],):
        away = np.linalg.norm(boards.table.positions - point, axis=1)
        order = np.argsort(away)
        nearest = int(order[0])
        other = next((int(row) for row in order[1:12]
                      if boards.table.modules[row] != boards.table.modules[nearest]
                      and away[row] < away[nearest] + 4e-3), None)  # fmt: skip
        x, y, z = (MM * point).tolist()
        words = f"module {boards.table.modules[nearest]}"
        if other is not None:
            words = f"between modules {boards.table.modules[nearest]} and " + str(
                boards.table.modules[other]
            )
        spots.append(f"{words} ({x:.0f}, {y:.0f}, {z:.0f} mm)")
    if how == "stroke":
        return f"stroke {boards.part} from {spots[0]} to {spots[-1]}"
    verb = "poke" if how == "poke" else "lay a hand on"
    return f"{verb} {boards.part}: {spots[0]}"


def _listed(word: str, numbers: Sequence[int]) -> str:
    if not numbers:
        return f"no {word}"
    plural = "s" if len(numbers) > 1 else ""
    return f"{word}{plural} {', '.join(map(str, numbers))}"


def fault_row(case: Case, found: Found) -> dict[str, Any]:
    """One fault for JSON."""
    boards = case.boards

    def row(fault: Fault, confidence: float) -> dict[str, Any]:
        return {
            "kind": fault.kind,
            "modules": fault.numbers(boards),
            "chains": list(fault.chains),
            "channels": fault.channels(boards),
            "words": fault.words(boards),
            "confidence": confidence,
        }

    others = [row(fault, chance) for fault, chance in found.alternatives]
    return {"part": case.part, **row(found.fault, found.confidence), "alternatives": others}


def mute_taxels(case: Case) -> list[int]:
    """Channels that stayed silent in every touch that their neighbours all felt."""
    places = case.doctor.wiring.places(case.boards)
    tried = np.zeros(len(places), np.int64)
    answered = np.zeros(len(places), bool)
    near = np.linalg.norm(places[:, None] - places[None], axis=2) < 1.3 * case.boards.pitch
    np.fill_diagonal(near, False)
    for touch in case.doctor.touches:
        strong = touch.response > SURELY
        answered |= touch.response > THRESHOLD
        tried += (near & strong[None]).sum(axis=1) >= 3
    return case.boards.table.channels[(tried >= TRIED) & ~answered].tolist()


def rest_row(case: Case) -> dict[str, Any] | None:
    """The rest for JSON; None where there was none."""
    rest, boards = case.rest, case.boards
    if rest is None:
        return None
    channels = boards.table.channels
    return {
        "samples": rest.samples,
        "tells": rest.tells,
        "stuck": channels[rest.stuck].tolist(),
        "mute_modules": [int(boards.numbers[module]) for module in rest.mute],
        "given_twice": channels[rest.pairs].tolist(),
        "too_calm": channels[rest.unsure].tolist(),
    }


def summary(examined: Examination, seed: int, seconds: float, files: list[str]) -> dict[str, Any]:
    """What the command prints as JSON."""
    cases = examined.cases
    statuses = {case.part: case.doctor.status for case in cases}
    worst = min(statuses.values(), key=ORDER.index)
    next_one = next_touch({case.part: case for case in cases if case.places_known}, examined.how)
    faults = [fault_row(case, found) for case in cases if statuses[case.part] != "inconsistent"
              for found in case.doctor.found]  # fmt: skip
    suspects = [
        fault_row(case, Found(fault, chance))
        for case in cases
        for fault, chance in case.doctor.suspects(3)
        if chance > 0.01 and not case.doctor.wiring.mute[list(fault.modules)].all()
    ]
    by_part = {case.part: case.boards for case in cases}
    return {
        "robot": examined.robot,
        "source": examined.source,
        "touch": examined.how,
        "status": worst,
        "parts": [
            {
                "part": case.part,
                "status": statuses[case.part],
                "healthy": case.doctor.healthy,
                "touches": len(case.doctor.touches),
                "misfits": case.doctor.misfits,
                "places_known": case.places_known,
                "mute_taxels": mute_taxels(case),
            }
            for case in cases
        ],
        "faults": faults,
        "suspects": suspects,
        "touches": sum(len(case.doctor.touches) for case in cases),
        "next": None
        if next_one is None
        else {
            "part": next_one[0],
            "words": place_words(by_part[next_one[0]], next_one[1], examined.how),
            "path_mm": (MM * next_one[1]).tolist(),
            "gain_nats": next_one[2],
        },
        "rest": {case.part: rest_row(case) for case in cases},
        "planted": [
            fault_row(case, Found(fault, 1.0))
            for case in cases
            for fault in examined.planted.get(case.part, ())
        ],
        "notes": list(examined.notes),
        "seed": seed,
        "seconds": seconds,
        "files": files,
    }


def map_files(cases: Sequence[Case], out: Path) -> dict[str, Path]:
    """The file of each part's map: `out` itself for one part, else a file in that folder."""
    if out.suffix.lower() == ".csv":
        if len(cases) > 1:
            raise InvalidArrayError(f"{len(cases)} parts do not go into one table: give a folder")
        return {cases[0].part: out}
    return {case.part: out / f"{case.part}.csv" for case in cases}


def write_maps(examined: Examination, out: Path) -> list[str]:
    """Write the corrected map of each part whose channels moved; the files' names."""
    files = map_files(examined.cases, out)
    written = []
    for case in examined.cases:
        if case.doctor.status == "inconsistent":
            continue
        table, moved, _ = corrected(
            case.boards, case.doctor.wiring, [found.fault for found in case.doctor.found]
        )
        if len(moved):
            files[case.part].parent.mkdir(parents=True, exist_ok=True)
            write_map(table, files[case.part])
            written.append(str(files[case.part]))
    return written


def check_out(parts: Sequence[str], out: Path) -> None:
    """Refuse before any work what could not be written after it."""
    if out.suffix.lower() == ".csv":
        check_free(out)
    else:
        for part in parts:
            check_free(out / f"{part}.csv")
