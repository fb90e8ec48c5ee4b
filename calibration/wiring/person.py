"""Who touches where the doctor asks: a simulated person, or one at the robot.

A simulated person's contacts are those of `skinmap.touch` (Hertz pads in the log map, Gaussian
foam), not the doctor's own model of a touch; spikes, dead taxels, gross misses and islands of a
hand are added.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibration.wiring.answer_model import THRESHOLD
from calibration.wiring.boards import Wiring
from calibration.wiring.examination import (
    REST_SECONDS,
    Answers,
    Case,
    Examination,
    Plan,
    ask,
    concluded,
    next_touch,
    open_cases,
)
from calibration.wiring.faults import Fault, parse_fault
from calibration.wiring.touches import BEGINS, ENDS, Baseline
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError, SkinMismatchError, UnknownNameError
from skinmap.geometry.log_map import log_map
from skinmap.geometry.triangles import unit
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin
from skinmap.touch.gestures import Pad, poke, whole_hand
from skinmap.touch.sensing import FULL_SCALE, Sensing
from skinmap.touch.simulator import Stage, prepare, touch_loads

if TYPE_CHECKING:
    from skinmap.live.sources.source import Source

REACH = 0.13  # of the log map round a place [m]
POKE, PACE = 12, 0.13  # samples of a poke; speed of a stroke [m/s], sampled at 50 Hz


@dataclass(frozen=True, slots=True)
class Clumsiness:
    """What goes wrong when people touch.

    Attributes
    ----------
    place : float
        Error of a place, standard deviation an axis [m].
    misses : float
        Chance of a touch somewhere else.
    spikes : float
        Chance that a channel jumps within one sample.
    gains : tuple of float
        Range of the spread of a skin's gains.
    dead : tuple of float
        Range of the share of dead taxels.
    """

    place: float = 4e-3
    misses: float = 0.01
    spikes: float = 1e-4
    gains: tuple[float, float] = (0.15, 0.40)
    dead: tuple[float, float] = (0.01, 0.02)


class Patient:
    """One skin, prepared once; people and faults come and go."""

    def __init__(self, skin: Skin) -> None:
        self.skin = skin
        self.stage: Stage = prepare(skin, rng=np.random.default_rng(0))
        self._maps: dict[int, tuple[FloatArray, FloatArray]] = {}

    def around(self, taxel: int) -> tuple[FloatArray, FloatArray]:
        """Log map (n, 2) round a taxel, and its axes (2, 3)."""
        if taxel not in self._maps:
            normal = self.skin.normals[taxel]
            helper = np.eye(3)[np.argmin(np.abs(normal))]
            first = unit(np.cross(normal, helper)[None])[0]
            axes = np.stack([first, np.cross(normal, first)])
            uv, _ = log_map(
                self.skin.positions, self.skin.normals, self.stage.graph, taxel, REACH, frame=axes
            )
            self._maps[taxel] = uv, axes
        return self._maps[taxel]

    def laid(self, place: FloatArray) -> tuple[FloatArray, FloatArray, int]:
        """Log map about a place near the skin, axes, and the nearest taxel."""
        taxel = int(np.argmin(np.linalg.norm(self.skin.positions - place, axis=1)))
        uv, axes = self.around(taxel)
        return uv - axes @ (place - self.skin.positions[taxel]), axes, taxel


class Person:
    """Touches a patient's skin where asked, as well as people do.

    Parameters
    ----------
    patient : Patient
    rng : numpy.random.Generator
    sources : (n,) int, optional
        Taxel whose answer each channel really carries, -1 for none: the planted fault.
    clumsiness : Clumsiness
    noise : float
        Of a sample [counts].
    """

    def __init__(
        self,
        patient: Patient,
        rng: np.random.Generator,
        sources: IntArray | None = None,
        *,
        clumsiness: Clumsiness | None = None,
        noise: float = 1.2,
    ) -> None:
        self.patient, self.rng = patient, rng
        self.clumsiness = Clumsiness() if clumsiness is None else clumsiness
        n = len(patient.skin)
        self.sources = np.arange(n) if sources is None else np.asarray(sources)
        spread = rng.uniform(*self.clumsiness.gains)
        self.gains = np.exp(rng.normal(0.0, spread, n))
        self.dead = rng.random(n) < rng.uniform(*self.clumsiness.dead)
        self.sensing = Sensing(noise=noise)
        self.baseline = rng.normal(0.0, 0.5, n)
        self.hand = float(rng.uniform(0.75, 1.0))
        self.force = float(np.exp(rng.normal(0.0, 0.15)))

    def poke(self, place: FloatArray) -> NDArray[np.uint8]:
        """Samples (t, n) of a poke at a place (3,), with its error."""
        uv, _, _ = self.patient.laid(self._aim(place))
        uv = uv - self.rng.normal(0.0, self.clumsiness.place, 2)
        load = touch_loads(self.patient.stage, poke(self.rng, self.hand), uv).sum(axis=0)
        course = np.minimum(1.0, np.linspace(0.0, 3.0, POKE))[:, None]
        return self._sense(course * course[::-1] * load)

    def hold(self, place: FloatArray) -> NDArray[np.uint8]:
        """Samples of a hand laid on: islands of palm and fingers, some of them missing."""
        uv, _, _ = self.patient.laid(self._aim(place))
        angle = self.rng.uniform(0.0, 2.0 * np.pi)
        c, s = np.cos(angle), np.sin(angle)
        uv = (uv - self.rng.normal(0.0, 2.0 * self.clumsiness.place, 2)) @ np.array(
            [[c, s], [-s, c]]
        )
        palm, *fingers = whole_hand(self.rng, self.hand)
        pads = [finger for finger in fingers if self.rng.random() > 0.2]
        for _ in range(int(self.rng.integers(2, 8))):
            where = self.rng.normal(0.0, 0.4 * palm.radius, 2)
            spot = (float(where[0]), float(where[1]))
            radius = palm.radius * self.rng.uniform(0.25, 0.7)
            pads.append(Pad(spot, spot, radius, palm.strength * self.rng.uniform(0.5, 1.2)))
        load = touch_loads(self.patient.stage, pads, uv).sum(axis=0)
        course = np.minimum(1.0, np.linspace(0.0, 3.0, POKE))[:, None]
        return self._sense(course * course[::-1] * load)

    def stroke(self, path: FloatArray) -> NDArray[np.uint8]:
        """Samples of a fingertip led along a path (p, 3), with errors at both ends."""
        middle = path[len(path) // 2]
        missed = self._aim(middle)
        taxel = int(np.argmin(np.linalg.norm(self.patient.skin.positions - missed, axis=1)))
        uv, axes = self.patient.around(taxel)
        if missed is middle:
            line = np.array([_lay(self.patient, taxel, uv, point) for point in path])
        else:
            line = (path - middle) @ axes.T
        share = np.linspace(0.0, 1.0, len(line))[:, None]
        ends = self.rng.normal(0.0, self.clumsiness.place, (2, 2))
        line = line + ends[0] * (1.0 - share) + ends[1] * share
        length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        steps = max(12, round(length / (PACE * self.rng.uniform(0.8, 1.6)) * 50))
        pace = np.linspace(0.0, 1.0, steps) ** np.exp(self.rng.normal(0.0, 0.15))
        pads = poke(self.rng, self.hand)
        loads = np.zeros((steps, len(uv)))
        for row, at in enumerate(pace):
            spot = [np.interp(at, share[:, 0], line[:, axis]) for axis in (0, 1)]
            close = np.flatnonzero(np.abs(uv - spot).max(axis=1) < 30e-3)
            if len(close):
                shifted = uv[close] - spot
                loads[row, close] = touch_loads(self.patient.stage, pads, shifted).sum(axis=0)
        wobble = np.exp(np.cumsum(self.rng.normal(0.0, 0.05, steps)))[:, None]
        return self._sense(loads * wobble)

    def rest(self, samples: int) -> NDArray[np.uint8]:
        """Samples untouched."""
        return self._sense(np.zeros((samples, len(self.gains))))

    def _aim(self, place: FloatArray) -> FloatArray:
        if self.rng.random() >= self.clumsiness.misses:
            return place
        return self.patient.skin.positions[int(self.rng.integers(len(self.gains)))]

    def _sense(self, loads: FloatArray) -> NDArray[np.uint8]:
        counts = FULL_SCALE * self.force * loads * self.gains
        counts = counts + self.baseline + self.rng.normal(0.0, self.sensing.noise, counts.shape)
        counts[:, self.dead] = 0.0
        sent = np.where(self.sources >= 0, counts[:, self.sources], 0.0)
        spikes = self.rng.random(sent.shape) < self.clumsiness.spikes
        sent[spikes] = self.rng.uniform(20.0, 255.0, int(spikes.sum()))
        return np.asarray(np.rint(np.clip(sent, 0.0, 255.0)), np.uint8)


def _lay(patient: Patient, taxel: int, uv: FloatArray, point: FloatArray) -> FloatArray:
    """Where a point of the skin lies in the log map of a taxel: as its nearest taxels do."""
    away = np.linalg.norm(patient.skin.positions - point, axis=1)
    away = np.where(np.isfinite(uv[:, 0]), away, np.inf)
    near = np.argsort(away)[:3]
    weight = 1.0 / (away[near] + 1e-4)
    return np.asarray((weight[:, None] * uv[near]).sum(axis=0) / weight.sum())


def examine_simulated(
    robot: Robot, parts: Sequence[str], planted: Sequence[str], plan: Plan
) -> Examination:
    """Plant faults in a simulated skin and let a simulated person touch where asked.

    `planted` are words as `calibration.wiring.faults.parse_fault` reads them, for the first part,
    or for another one as `part/swap:3,7`.
    """
    cases = open_cases(robot, parts, plan)
    faults = _planted(planted, cases)
    people: dict[str, Person] = {}
    level: dict[str, Baseline] = {}
    for number, (part, case) in enumerate(cases.items()):
        wiring = Wiring.as_mapped(case.boards)
        for fault in faults.get(part, ()):
            wiring = fault.apply(wiring, case.boards)
        rng = np.random.default_rng([plan.seed, number])
        people[part] = Person(Patient(robot.skin(part)), rng, wiring.sources(case.boards))
        rest = people[part].rest(round(50 * REST_SECONDS)).astype(np.float64)
        case.take_rest(rest)
        level[part] = Baseline.of(rest, "pressure")

    def touched(part: str, path: FloatArray) -> Answers:
        person = people[part]
        sent = {"poke": person.poke, "hand": person.hold}.get(plan.how)
        samples = person.stroke(path) if sent is None else sent(path[0])
        answers = level[part].answers(samples)
        if plan.marker is not None:
            plan.marker.feed(part, answers.max(axis=0))
        return {part: answers}

    for _ in ask(cases, plan, touched):
        pass  # a simulated skin always answers
    return concluded("sim", robot, plan, cases, faults)


def _planted(words: Sequence[str], cases: Mapping[str, Case]) -> dict[str, tuple[Fault, ...]]:
    faults: dict[str, tuple[Fault, ...]] = {}
    for word in words:
        part, slash, rest = word.rpartition("/")
        part = part if slash else next(iter(cases))
        if part not in cases:
            raise UnknownNameError("part", part, cases)
        faults[part] = (*faults.get(part, ()), parse_fault(rest, cases[part].boards))
    return faults


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
