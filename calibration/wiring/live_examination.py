"""A live examination: a person at the robot touches where asked, one place after the other."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from calibration.wiring.answer_model import THRESHOLD
from calibration.wiring.examination import (
    REST_SECONDS,
    Case,
    Examination,
    Plan,
    ask,
    concluded,
    next_touch,
    open_cases,
)
from calibration.wiring.touches import BEGINS, ENDS, Baseline
from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.skin.robot import Robot

if TYPE_CHECKING:
    from skinmap.live.sources.source import Source


def examine_live(source: Source, robot: Robot, parts: Sequence[str], plan: Plan) -> Examination:
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
    cases = open_cases(robot, there, plan)
    next_touch(cases, plan.how)  # what takes seconds once, before anybody waits for it
    stream = _Stream(source, cases)
    notes: list[str] = []
    try:
        level = stream.rest(cases, plan)
        for words in ask(cases, plan, lambda *_: stream.touch(level, plan)):
            notes.append(f"nothing answered within {plan.patience:.0f} s at: {words}")
    except KeyboardInterrupt:
        plan.told("interrupted")
        notes.append("interrupted: judged by what was touched until then")
    return concluded(info.name, robot, plan, cases, {}, notes)


class _Stream:
    """Samples of the parts under examination, touch by touch."""

    def __init__(self, source: Source, cases: Mapping[str, Case]) -> None:
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
        blocks: list[dict[str, FloatArray]] = []
        end = time.monotonic() + patience
        while sum(len(next(iter(b.values()))) for b in blocks) < count:
            if time.monotonic() > end:
                raise InvalidArrayError("the source sends too few samples for a rest")
            if (block := self.read()) is not None:
                blocks.append(block)
        return {part: np.concatenate([b[part] for b in blocks]) for part in self.columns}

    def rest(self, cases: Mapping[str, Case], plan: Plan) -> dict[str, Baseline]:
        """Judge the rest at the beginning; what each part sends untouched."""
        plan.told(f"do not touch the skin for {REST_SECONDS:.0f} s")
        rate = self.source.info.rate or 50.0
        samples = self.some(round(REST_SECONDS * rate), patience=5.0 * REST_SECONDS)
        for part, case in cases.items():
            case.take_rest(samples[part])
        return {part: Baseline.of(samples[part], self.source.info.kind) for part in cases}

    def touch(self, level: Mapping[str, Baseline], plan: Plan) -> dict[str, FloatArray] | None:
        """Answers (t, n) by part from a touch's beginning to its end; None where none came."""
        kept: dict[str, list[FloatArray]] = {part: [] for part in self.columns}
        quiet, felt = 0, 0
        end = time.monotonic() + plan.patience
        while time.monotonic() < end:
            block = self.read()
            if block is None:
                continue
            active = np.zeros(len(next(iter(block.values()))), bool)
            for part, values in block.items():
                above = (values - level[part].level) * level[part].sign
                active |= (above > THRESHOLD).any(axis=1)
                if plan.marker is not None:
                    plan.marker.feed(part, np.maximum(above[-1], 0.0))
            if active.any() or felt:
                for part, values in block.items():
                    kept[part].append(values)
                felt += int(active.sum())
                quiet = 0 if active[-1] else quiet + len(active)
            if felt and quiet > ENDS:
                if felt >= BEGINS:
                    return {p: level[p].answers(np.concatenate(v)) for p, v in kept.items()}
                kept, felt, quiet = {part: [] for part in self.columns}, 0, 0  # a spike
        return None
