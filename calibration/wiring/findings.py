"""What an examination found, for people and programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from calibration.wiring.answer_model import THRESHOLD
from calibration.wiring.channel_map import corrected, map_files, write_map
from calibration.wiring.command import (
    FaultRow,
    NextTouch,
    PartRow,
    RestRow,
    State,
    WiringResult,
)
from calibration.wiring.examination import MM, Case, Examination, next_touch, place_words
from calibration.wiring.faults import Fault
from calibration.wiring.touches import How
from skinmap.arrays import FloatArray

TRIED = 3  # touches in which a taxel should have answered before it counts as mute
SURELY = 60.0  # counts that its neighbours answered with
LEAST = 0.01  # suspects less probable are not told
SUSPECTS = 3  # of each part
ORDER = ("inconsistent", "faulty", "undecided", "healthy")  # worst first


def findings(examined: Examination, seed: int, out: Path | None) -> WiringResult:
    """All of it, with corrected maps where they were asked for; `seconds` are not known here."""
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
    planted = [
        _fault_row(case, fault, 1.0)
        for case in cases
        for fault in examined.planted.get(case.part, ())
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
        planted=planted,
        notes=list(examined.notes),
        seed=seed,
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
    )


def _next(cases: Sequence[Case], part: str, path: FloatArray, gain: float, how: str) -> NextTouch:
    boards = next(case.boards for case in cases if case.part == part)
    words = place_words(boards, path, how)
    return NextTouch(part=part, words=words, path_mm=(MM * path).tolist(), gain_nats=gain)


def _write(cases: Sequence[Case], out: Path) -> list[str]:
    """Write the corrected map of each part whose channels moved; the files' names."""
    files = map_files([case.part for case in cases], out)
    written = []
    for case in cases:
        if case.doctor.status == "inconsistent":
            continue
        faults = [found.fault for found in case.doctor.found]
        table, moved, _ = corrected(case.boards, case.doctor.wiring, faults)
        if len(moved):
            files[case.part].parent.mkdir(parents=True, exist_ok=True)
            write_map(table, files[case.part])
            written.append(str(files[case.part]))
    return written
