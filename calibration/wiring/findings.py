"""Result of a check-up, for people and programs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, cast

import msgspec

from skinmap.rows import column, row
from skinmap.summary import first_few

if TYPE_CHECKING:
    from calibration.wiring.boards import Boards, Fault
    from calibration.wiring.examination import Case, Examination
    from calibration.wiring.history import History
    from skinmap.arrays import IntArray

AROUND = 1.5  # pitches: the neighbours of a taxel, diagonal ones of a square too
FEWEST = 2  # of them lie further from a touch: a corner has no more
SAME_SURE = 0.95  # confidence in a taxel that stays silent
ODDS = 9.9  # of silence against a taxel that feels, where one in 1,000 is silent [nats]
ORDER = ("inconsistent", "faulty", "undecided", "healthy")  # worst first
MAX_NAMED = 8  # channels in a line
BROAD = "pokes press more channels at once than a fingertip does: press with one finger, or stroke"
WORDS = {
    "healthy": "no fault was found",
    "faulty": "faults were found",
    "undecided": "no fault so far, and not enough touches to exclude one",
    "inconsistent": "the answers do not come from where the touches were asked for: the places "
    "belong to another part, order or unit, or more is wrong than one thing at a time",
}
OF_TAXELS = {
    "dead": "never answers",
    "stuck": "stands still",
    "noisy": "is noisier than the others",
    "clipped": "is cut off",
    "quantised": "takes coarser steps than the others",
    "copied": "send the same signal: one is a copy of the other",
    "silent": "stays silent where its neighbours feel a touch",
}
State = Literal["healthy", "faulty", "undecided", "inconsistent"]


@row
class FaultRow:
    """One fault of the skin."""

    part: str | msgspec.UnsetType = column("Its part; not of alternatives.", default=msgspec.UNSET)
    kind: str = column(
        "Of modules and chains: swapped, turned, mirrored, reversed, mute; of channels: "
        "swapped_channels, dead, stuck, noisy, clipped, quantised, copied, silent, and since "
        "earlier check-ups weaker, stronger, noisier, moved, swapped_channels."
    )
    modules: list[int] = column("Modules that it is of.")
    chains: list[int] = column("Chains that it is of.")
    channels: list[int] = column("Channels that it is of.")
    words: str = column("Description of the fault in words.")
    confidence: float = column("Probability of the fault.")
    place_mm: list[float] | None = column(
        "Middle of its channels in the frame of the link [mm]; null where none has a place.",
        default=None,
    )
    since: str | None = column(
        "Time of the first check-up that shows it; null where it is not from the history.",
        default=None,
    )
    alternatives: list[FaultRow] | msgspec.UnsetType = column(
        "Other faults that would show the same, the most probable first; alternatives have none.",
        heading="", default=msgspec.UNSET,
    )  # fmt: skip


@row
class PartRow:
    """A part that was examined."""

    part: str = column("Name of the part.")
    status: State = column("State of this part.")
    healthy: float = column("Probability that nothing else is wrong with its wiring.")
    touches: int = column("Number of judged touches.")
    misfits: int = column("Touches not felt where they were asked for.")
    broad: int = column("Pokes that more channels answered than a fingertip presses.", default=0)
    rest_samples: int = column("Samples at rest that were judged.")
    rest_tells: bool = column("Whether there was noise enough at rest to judge channels by it.")


@row
class CheckupResult:
    """Is this skin sound, and which cable, board or taxel is not."""

    robot: str = column("Name of the robot.")
    source: str = column("Source that was examined.")
    status: State = column("The worst of the parts.")
    parts: list[PartRow] = column("One entry for each part.", heading="")
    faults: list[FaultRow] = column("Faults, those of cables and modules first.", heading="")
    touches: int = column("Number of judged touches.")
    skin_seconds: float = column("Duration on the clock of the skin [s].")
    next: str | None = column("Next place to touch; null where nothing is left to ask.")
    checkups: int = column("Check-ups in the history, with this one; 0 without a history.")
    notes: list[str] = column("Questions that stay open.")
    files: list[str] = column("Files that were written.")


def findings(examined: Examination) -> CheckupResult:
    """The result, without files."""
    from calibration.wiring.examination import next_touch, place_words

    cases = {case.part: case for case in examined.cases}
    faults = [one for case in cases.values() for one in _of_case(case)]
    parts = [_part_row(case, faults) for case in cases.values()]
    asked = next_touch(cases)
    return CheckupResult(
        robot=examined.robot,
        source=examined.source,
        status=min((one.status for one in parts), key=ORDER.index),
        parts=parts,
        faults=faults,
        touches=sum(one.touches for one in parts),
        skin_seconds=examined.skin_seconds,
        next=None if asked is None else place_words(cases[asked.part].boards, asked),
        checkups=0,
        notes=list(examined.notes),
        files=[],
    )


def with_changes(result: CheckupResult, cases: Sequence[Case], history: History) -> CheckupResult:
    """The result with what has changed since earlier check-ups."""
    boards = {case.part: case.boards for case in cases}
    known = {(one.part, c) for one in result.faults for c in one.channels}
    rows = [
        _taxel_row(boards[one.part], one.kind, [one.row], one.words, one.confidence, one.since)
        for one in history.changes
        if (one.part, int(boards[one.part].table.channels[one.row])) not in known
    ]  # fmt: skip
    new = [one for one in rows if one.kind != "recovered"]
    changed = {one.part for one in new}
    parts = [
        replace(one, status="faulty") if one.part in changed and one.status != "inconsistent"
        else one for one in result.parts
    ]  # fmt: skip
    return replace(
        result, faults=[*result.faults, *new], parts=parts, checkups=history.compared,
        status=min((one.status for one in parts), key=ORDER.index),
        notes=[*result.notes, *history.notes,
               *(one.words for one in rows if one.kind == "recovered")],
        files=history.files,
    )  # fmt: skip


def _of_case(case: Case) -> Iterator[FaultRow]:
    """Faults of cables and modules, then those of single channels."""
    named: set[int] = set()
    if case.doctor.status != "inconsistent":
        for found in case.doctor.found:
            one = _fault_row(case, found.fault, found.confidence, found.alternatives)
            named |= set(one.channels) if "mute" in one.kind else set()
            yield one
    single: list[tuple[str, list[int], str, float]] = []
    for own in case.rest.found if case.rest is not None else ():
        rows = own.channels or []
        text = OF_TAXELS[own.kind] + (f" at {own.value:g}" if isinstance(own.value, float) else "")
        for several in [rows] if own.kind == "copied" else [[one] for one in rows]:
            single.append((own.kind, several, text, own.confidence))
    for silent in _silent(case).tolist():
        single.append(("silent", [silent], OF_TAXELS["silent"], SAME_SURE))
    for kind, rows, text, sure in single:
        channels = set(case.boards.table.channels[rows].tolist())
        if not named & channels:
            named |= channels
            yield _taxel_row(case.boards, kind, rows, text, sure)


def _taxel_row(
    boards: Boards, kind: str, rows: list[int], text: str, sure: float, since: str | None = None
) -> FaultRow:
    table = boards.table
    channels = table.channels[rows].tolist()
    names = " and ".join(map(str, channels))
    return FaultRow(
        part=boards.part,
        kind=kind,
        modules=sorted(set(table.modules[rows].tolist())),
        chains=[],
        channels=channels,
        words=f"{'channels' if len(rows) > 1 else 'taxel'} {names} of {boards.part}: {text}",
        confidence=sure,
        since=since,
        place_mm=(1e3 * table.positions[rows].mean(axis=0)).tolist(),
        alternatives=[],
    )


def _part_row(case: Case, faults: Sequence[FaultRow]) -> PartRow:
    doctor, rest = case.doctor, case.rest
    ill = doctor.status != "inconsistent" and any(one.part == case.part for one in faults)
    return PartRow(
        part=case.part,
        status=cast("State", "faulty" if ill else doctor.status),
        healthy=doctor.healthy,
        touches=len(doctor.touches),
        misfits=doctor.misfits,
        broad=doctor.broad,
        rest_samples=0 if rest is None else rest.samples,
        rest_tells=rest is not None and rest.tells,
    )


def _fault_row(
    case: Case, fault: Fault, confidence: float, others: Sequence[tuple[Fault, float]]
) -> FaultRow:
    import numpy as np

    boards = case.boards

    def made(one: Fault, chance: float) -> FaultRow:
        channels = one.channels(boards)
        there = boards.table.positions[np.isin(boards.table.channels, channels)]
        return FaultRow(
            kind=one.kind, modules=one.numbers(boards), chains=list(one.chains), channels=channels,
            words=one.words(boards), confidence=chance,
            place_mm=(1e3 * there.mean(axis=0)).tolist() if len(there) else None,
        )  # fmt: skip

    alternatives = [made(*other) for other in others]
    return replace(made(fault, confidence), part=case.part, alternatives=alternatives)


def _silent(case: Case) -> IntArray:
    """Rows that never answered, though touches at them were felt by those around them.

    A taxel should answer as much as its neighbours that lie further from the touch. Each touch
    says so much for silence as it is improbable of a taxel that feels.
    """
    import numpy as np
    from scipy.special import ndtr

    from calibration.wiring.touches import DEAD, SPREAD, THRESHOLD

    places = case.doctor.wiring.places(case.boards)
    near = np.linalg.norm(places[:, None] - places[None], axis=2) < AROUND * case.boards.pitch
    np.fill_diagonal(near, False)
    answered = np.zeros(len(places), bool)
    doubt = np.zeros(len(places))
    for touch in case.doctor.touches:
        answered |= touch.response > THRESHOLD
        if not (touch.response > THRESHOLD).any():
            continue
        away = touch.away(places)
        further = near & (away[None] >= away[:, None])
        count = further.sum(axis=1)
        expected = further @ touch.response / np.maximum(count, 1)
        rows = np.flatnonzero((count >= FEWEST) & (expected > 2.0 * THRESHOLD))
        silent = DEAD + (1.0 - DEAD) * ndtr(np.log(THRESHOLD / expected[rows]) / SPREAD)
        doubt[rows] -= np.log(silent)
    return np.flatnonzero((doubt > ODDS) & ~answered)


def lines(result: CheckupResult) -> Iterator[str]:
    """What people read at the end, and on the page."""
    words = WORDS[result.status]
    if result.status == "inconsistent" and any(2 * one.broad > one.misfits for one in result.parts):
        words = BROAD
    yield f"{result.status}: {words}"
    for fault in result.faults:
        yield f"  {fault.words} ({100 * fault.confidence:.1f} %){_where(fault)}"
        for other in fault.alternatives or ():
            yield f"    or {other.words} ({100 * other.confidence:.1f} %)"
    for part in result.parts:
        rest = "" if part.rest_tells else "; the rest has too little noise to judge channels by"
        yield (
            f"  {part.part}: {part.touches} touches, {part.rest_samples} samples at rest, "
            f"no (other) fault of its wiring: {100 * part.healthy:.1f} %{rest}"
        )
    yield from (f"  note: {note}" for note in result.notes)
    if result.next is not None and result.status in ("undecided", "faulty"):
        yield f"  next: {result.next}"


def _where(fault: FaultRow) -> str:
    words = ""
    if fault.place_mm is not None:
        words = " at ({:.0f}, {:.0f}, {:.0f} mm)".format(*fault.place_mm)
    if len(fault.channels) > 2:
        words += f", channels {first_few(fault.channels, MAX_NAMED)}"
    return words
