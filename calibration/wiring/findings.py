"""What an examination found, for people and programs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

import msgspec

from skinmap.summary import first_few

if TYPE_CHECKING:
    from calibration.wiring.examination import Case, Examination
    from calibration.wiring.faults import Fault
    from calibration.wiring.touches import How
    from skinmap.arrays import FloatArray

TRIED = 3  # touches in which a taxel should have answered before it counts as mute
SURELY = 60.0  # counts that its neighbours answered with
LEAST = 0.01  # suspects less probable are not told
SUSPECTS = 3  # of each part
ORDER = ("inconsistent", "faulty", "undecided", "healthy")  # worst first
MAX_NAMED = 12  # channels in a line
WORDS = {
    "healthy": "the wiring is as the map has it",
    "faulty": "the wiring is not as the map has it",
    "undecided": "not certain yet: touch more",
    "inconsistent": "the answers do not come from where the touches were asked for: the places "
    "belong to another part, order or unit, or more is wrong than one thing at a time",
}
State = Literal["healthy", "faulty", "undecided", "inconsistent"]


@dataclass(frozen=True, kw_only=True, slots=True)
class FaultRow:
    """What may be wrong.

    Attributes
    ----------
    part
        Where; not of alternatives.
    kind
        Of modules, chains or channels.
    modules, chains, channels
        That it is of; channels are those that are mute or not where the map has them.
    words
        For people.
    confidence
        Probability.
    alternatives
        What else it may be, the most probable first; alternatives have none.
    """

    part: str | msgspec.UnsetType = msgspec.UNSET
    kind: str
    modules: list[int]
    chains: list[int]
    channels: list[int]
    words: str
    confidence: float
    alternatives: list[FaultRow] | msgspec.UnsetType = msgspec.UNSET


@dataclass(frozen=True, kw_only=True, slots=True)
class PartRow:
    """A part that was examined.

    Attributes
    ----------
    part
        Its name.
    status
        Of its wiring.
    healthy
        Probability that nothing else is wrong.
    touches
        How many.
    misfits
        Touches not felt where they were asked for.
    places_known
        Whether it is known where touches were asked for.
    mute_taxels
        Channels that stayed silent in every touch that their neighbours all felt.
    """

    part: str
    status: State
    healthy: float
    touches: int
    misfits: int
    places_known: bool
    mute_taxels: list[int]


@dataclass(frozen=True, kw_only=True, slots=True)
class NextTouch:
    """Where to touch next.

    Attributes
    ----------
    part
        Its name.
    words
        For people.
    path_mm
        In the link's frame: one point, or those of a stroke.
    gain_nats
        What it would tell.
    """

    part: str
    words: str
    path_mm: list[list[float]]
    gain_nats: float


@dataclass(frozen=True, kw_only=True, slots=True)
class RestRow:
    """What a part told untouched.

    Attributes
    ----------
    samples
        How many.
    tells
        Whether there was noise enough to judge.
    stuck
        Channels that never changed, though others did.
    mute_modules
        Modules of which no channel changed.
    given_twice
        Pairs of channels that say the same.
    too_calm
        Channels that changed too seldom to be compared.
    no_numbers
        Channels that sent no number in most samples.
    """

    samples: int
    tells: bool
    stuck: list[int]
    mute_modules: list[int]
    given_twice: list[list[int]]
    too_calm: list[int]
    no_numbers: list[int]


@dataclass(frozen=True, kw_only=True, slots=True)
class WiringResult:
    """Which cable is in the wrong socket.

    Attributes
    ----------
    robot
        Its name.
    source
        What was examined.
    touch
        How the skin was touched.
    status
        The worst of the parts.
    parts
        One by one.
    faults
        That were named.
    suspects
        That were not.
    touches
        How many.
    next
        Where to touch next; null where nothing is left to ask.
    rest
        By part; null where none was recorded.
    notes
        What cannot be told.
    seconds
        CPU time.
    files
        Corrected maps.
    """

    robot: str
    source: str
    touch: Literal["poke", "stroke"]
    status: State
    parts: list[PartRow]
    faults: list[FaultRow]
    suspects: list[FaultRow]
    touches: int
    next: NextTouch | None
    rest: dict[str, RestRow | None]
    notes: list[str]
    seconds: float
    files: list[str]


def findings(examined: Examination, out: Path | None) -> WiringResult:
    """All of it, with corrected maps where they were asked for; `seconds` are not known here."""
    from calibration.wiring.examination import next_touch

    cases = examined.cases
    parts = [_part_row(case) for case in cases]
    following = next_touch({case.part: case for case in cases if case.places_known}, examined.how)
    faults = [
        _fault_row(case, found.fault, found.confidence, found.alternatives)
        for case in cases
        if case.doctor.status != "inconsistent"
        for found in case.doctor.found
    ]
    suspects = [
        _fault_row(case, fault, chance)
        for case in cases
        for fault, chance in case.doctor.suspects(SUSPECTS)
        if chance > LEAST and not case.doctor.wiring.mute[list(fault.modules)].all()
    ]
    return WiringResult(
        robot=examined.robot,
        source=examined.source,
        touch=cast("How", examined.how),
        status=min((row.status for row in parts), key=ORDER.index),
        parts=parts,
        faults=faults,
        suspects=suspects,
        touches=sum(row.touches for row in parts),
        next=None if following is None else _next(cases, *following, examined.how),
        rest={case.part: _rest_row(case) for case in cases},
        notes=list(examined.notes),
        seconds=0.0,
        files=[] if out is None else _write(cases, out),
    )


def _part_row(case: Case) -> PartRow:
    doctor = case.doctor
    return PartRow(
        part=case.part,
        status=cast("State", doctor.status),
        healthy=doctor.healthy,
        touches=len(doctor.touches),
        misfits=doctor.misfits,
        places_known=case.places_known,
        mute_taxels=_mute_taxels(case),
    )


def _fault_row(
    case: Case, fault: Fault, confidence: float, others: Sequence[tuple[Fault, float]] = ()
) -> FaultRow:
    def row(one: Fault, chance: float) -> FaultRow:
        boards = case.boards
        return FaultRow(
            kind=one.kind, modules=one.numbers(boards), chains=list(one.chains),
            channels=one.channels(boards), words=one.words(boards), confidence=chance,
        )  # fmt: skip

    alternatives = [row(*other) for other in others]
    return replace(row(fault, confidence), part=case.part, alternatives=alternatives)


def _mute_taxels(case: Case) -> list[int]:
    """Channels that stayed silent in every touch that their neighbours all felt."""
    import numpy as np

    from calibration.wiring.answer_model import THRESHOLD

    places = case.doctor.wiring.places(case.boards)
    tried = np.zeros(len(places), np.int64)
    answered = np.zeros(len(places), bool)
    near = np.linalg.norm(places[:, None] - places[None], axis=2) < 1.3 * case.boards.pitch
    np.fill_diagonal(near, False)
    for touch in case.doctor.touches:
        strong = touch.response > SURELY
        answered |= touch.response > THRESHOLD
        tried += (near & strong[None]).sum(axis=1) >= 3
    return cast("list[int]", case.boards.table.channels[(tried >= TRIED) & ~answered].tolist())


def _rest_row(case: Case) -> RestRow | None:
    """The rest; None where there was none."""
    rest, boards = case.rest, case.boards
    if rest is None:
        return None
    channels = boards.table.channels
    return RestRow(
        samples=rest.samples,
        tells=rest.tells,
        stuck=channels[rest.stuck].tolist(),
        mute_modules=[int(boards.numbers[module]) for module in rest.mute],
        given_twice=channels[rest.pairs].tolist(),
        too_calm=channels[rest.unsure].tolist(),
        no_numbers=channels[rest.silent].tolist(),
    )


def _next(cases: Sequence[Case], part: str, path: FloatArray, gain: float, how: str) -> NextTouch:
    from calibration.wiring.examination import MM, place_words

    boards = next(case.boards for case in cases if case.part == part)
    words = place_words(boards, path, how)
    return NextTouch(part=part, words=words, path_mm=(MM * path).tolist(), gain_nats=gain)


def _write(cases: Sequence[Case], out: Path) -> list[str]:
    """Write the corrected map of each part whose channels moved; the files' names."""
    from calibration.wiring.channel_map import corrected, map_files, write_map

    files = map_files([case.part for case in cases], out)
    written = []
    for case in cases:
        if case.doctor.status == "inconsistent":
            continue
        faults = [found.fault for found in case.doctor.found]
        table, moved = corrected(case.boards, case.doctor.wiring, faults)
        if len(moved):
            files[case.part].parent.mkdir(parents=True, exist_ok=True)
            write_map(table, files[case.part])
            written.append(str(files[case.part]))
    return written


def lines(result: WiringResult) -> Iterator[str]:
    """What people read at the end."""
    yield f"{result.status}: {WORDS[result.status]}"
    for fault in result.faults:
        yield f"  {fault.part}: {_likely(fault)}"
        for other in fault.alternatives or ():
            yield f"    or {_likely(other)}"
    if result.status != "healthy":
        yield from (f"  perhaps {one.part}: {_likely(one)}" for one in result.suspects)
    for part, rest in result.rest.items():
        yield from (f"  {part}: {line}" for line in _rest_lines(rest))
    for row in result.parts:
        chance = f"nothing (else) wrong: {100 * row.healthy:.1f} %"
        yield f"  {row.part}: {row.touches} touches, {chance}"
        if row.mute_taxels:
            yield f"    channels that never answered: {first_few(row.mute_taxels, MAX_NAMED)}"
    yield from (f"  note: {note}" for note in result.notes)
    if result.next is not None and result.status in ("undecided", "faulty"):
        yield f"  next: {result.next.words}"


def _likely(fault: FaultRow) -> str:
    return f"{fault.words} ({100 * fault.confidence:.1f} %)"


def _rest_lines(rest: RestRow | None) -> Iterator[str]:
    if rest is None:
        yield "no rest was recorded"
        return
    if rest.no_numbers:
        one = len(rest.no_numbers) == 1
        who = f"channel {rest.no_numbers[0]} sends" if one else "these channels send"
        yield f"{who} no numbers" + ("" if one else f": {first_few(rest.no_numbers, MAX_NAMED)}")
    if not rest.tells:
        yield "at rest too few channels change to tell anything"
    if rest.stuck:
        yield f"stuck channels: {first_few(rest.stuck, MAX_NAMED)}"
    if rest.given_twice:
        yield f"given twice: {first_few([f'{a} = {b}' for a, b in rest.given_twice], MAX_NAMED)}"
