"""A simulated person who touches a skin where asked, as well as people do.

Contacts are those of `skinmap.touch` (Hertz pads in the log map, Gaussian foam), not the doctor's
own model of a touch; spikes, dead taxels and gross misses are added.

Check-ups of simulated skins from the first sample to the last word, and rests alone.

The contacts are those of `skinmap.touch` (Hertz pads laid in the log map, Gaussian foam), which is
not the model the doctor judges by; places are off by 4 mm an axis, gains spread by 15 to 40 %, 1 %
of the touches somewhere else, spikes, noise of 1.2 counts. A check-up ends after a minute of
samples. A fault is named right where it, and nothing else, is in the result.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skinmap
from calibration.wiring import Fault, Wiring, boards_of
from calibration.wiring.boards import Boards, all_faults
from calibration.wiring.examination import Plan, examine_live
from calibration.wiring.findings import CheckupResult, findings
from calibration.wiring.history import changes_of, kept_part
from calibration.wiring.touches import judge_rest
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.geometry.log_maps import log_map
from skinmap.geometry.proximity import nearest_first
from skinmap.geometry.rigid import tangent_frames
from skinmap.live.sources.source import Block, Source, StreamInfo
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin
from skinmap.touch.simulation.gestures import poke
from skinmap.touch.simulation.simulator import Stage, prepare, touch_loads
from skinmap.touch.simulation.variety import FULL_SCALE

REACH = 0.13  # of the log map round a place [m]
NOISE = 1.2  # of a sample [counts]
POKE, PACE = 12, 0.13  # samples of a poke; speed of a stroke [m/s], sampled at 50 Hz
RATE, WAY = 50.0, 1.5  # samples a second; seconds on the way to the next place
NAMES = {
    "swap": "swapped_modules", "turn": "turned_module", "mirror": "mirrored_module",
    "mute": "mute_module", "chains": "swapped_chains", "reverse": "reversed_chain",
    "mute-chain": "mute_chain", "channels": "swapped_channels",
}  # fmt: skip
OF_TAXELS = ("dead", "stuck", "noisy", "clipped", "weak")  # `dead:5`, `weak:5,40` (percent)


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
            axes = tangent_frames(self.skin.normals[taxel])
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
    touches : numpy.random.Generator, optional
        Of the touches, where `rng` makes the same skin again.
    taxels : sequence of (str, int, float)
        Faults of single taxels, of `OF_TAXELS`.
    """

    def __init__(
        self,
        patient: Patient,
        rng: np.random.Generator,
        sources: IntArray | None = None,
        *,
        clumsiness: Clumsiness | None = None,
        touches: np.random.Generator | None = None,
        taxels: Sequence[tuple[str, int, float]] = (),
    ) -> None:
        self.patient, self.rng, self.taxels = patient, rng, taxels
        self.clumsiness = Clumsiness() if clumsiness is None else clumsiness
        n = len(patient.skin)
        self.sources = np.arange(n) if sources is None else np.asarray(sources)
        spread = rng.uniform(*self.clumsiness.gains)
        self.gains = np.exp(rng.normal(0.0, spread, n))
        self.dead = rng.random(n) < rng.uniform(*self.clumsiness.dead)
        self.baseline = rng.normal(0.0, 0.5, n)
        self.hand = float(rng.uniform(0.75, 1.0))
        self.force = float(np.exp(rng.normal(0.0, 0.15)))
        self.rng = rng if touches is None else touches
        for _, taxel, percent in (one for one in taxels if one[0] == "weak"):
            self.gains[taxel] *= 1.0 - percent / 100.0

    def poke(self, place: FloatArray) -> NDArray[np.uint8]:
        """Samples (t, n) of a poke at a place (3,), with its error."""
        uv, _, _ = self.patient.laid(self._aim(place))
        uv = uv - self.rng.normal(0.0, self.clumsiness.place, 2)
        load = touch_loads(self.patient.stage, poke(self.rng, self.hand), uv).sum(axis=0)
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
        counts = counts + self.baseline + self.rng.normal(0.0, NOISE, counts.shape)
        counts[:, self.dead] = 0.0
        sent = np.where(self.sources >= 0, counts[:, self.sources], 0.0)
        spikes = self.rng.random(sent.shape) < self.clumsiness.spikes
        sent[spikes] = self.rng.uniform(20.0, 255.0, int(spikes.sum()))
        for kind, taxel, _ in self.taxels:
            if kind == "noisy":
                sent[:, taxel] += self.rng.normal(0.0, 15.0, len(sent))
            elif kind != "weak":
                top = {"dead": 0.0, "stuck": 37.0, "clipped": 40.0}[kind]
                sent[:, taxel] = np.minimum(sent[:, taxel], top) if kind == "clipped" else top
        return np.asarray(np.rint(np.clip(sent, 0.0, 255.0)), np.uint8)


def _lay(patient: Patient, taxel: int, uv: FloatArray, point: FloatArray) -> FloatArray:
    """Where a point of the skin lies in the log map of a taxel: as its nearest taxels do."""
    away = np.linalg.norm(patient.skin.positions - point, axis=1)
    away = np.where(np.isfinite(uv[:, 0]), away, np.inf)
    near = nearest_first(away)[:3]
    weight = 1.0 / (away[near] + 1e-4)
    return np.asarray((weight[:, None] * uv[near]).sum(axis=0) / weight.sum())


class SimulatedSkin(Source):
    """A skin with planted faults, and a person who touches it wherever `show` points.

    Parameters
    ----------
    robot : Robot
    part : str
    plant : sequence of str
        Faults: `swap:3,7`, `turn:5,120`, `mirror:5`, `mute:4`, `chains:0,1`, `reverse:0`,
        `mute-chain:1`, `channels:12,15`, `dead:5`, `stuck:5`, `noisy:5`, `clipped:5`, `weak:5,40`.
    seed : int
        Of the touches; the skin is the same for all seeds.
    patient : Patient, optional
        The part, prepared before.
    """

    def __init__(
        self,
        robot: Robot,
        part: str,
        plant: Sequence[str] = (),
        seed: int = 0,
        *,
        patient: Patient | None = None,
    ) -> None:
        skin, boards = robot.skin(part), boards_of(robot, part)
        super().__init__(StreamInfo("sim", (part,), (len(skin),), RATE, robot=robot.name))
        wiring, taxels = Wiring.as_mapped(boards), []
        for word in plant:
            name, _, rest = word.partition(":")
            if name in OF_TAXELS:
                taxels.append(_taxel_fault(name, rest, boards))
            else:
                wiring = parse_fault(word, boards).apply(wiring, boards)
        self.person = Person(
            patient or Patient(skin), np.random.default_rng(7), wiring.sources(boards),
            clumsiness=Clumsiness(dead=(0.0, 0.0)), taxels=taxels,
            touches=np.random.default_rng([seed, 1]),
        )  # fmt: skip
        self._coming = self.person.rest(0)
        self._sent = 0

    def read(self, timeout: float) -> Block:
        """The next samples, at once."""
        if not len(self._coming):
            self._coming = self.person.rest(25)
        values, self._coming = self._coming[:10], self._coming[10:]
        times = (self._sent + np.arange(len(values))) / RATE
        self._sent += len(values)
        return Block(times, values, time.perf_counter())

    def close(self) -> None:
        """Nothing to give back."""

    def show(self, part: str, path: FloatArray, words: str) -> None:
        """Touch a place (p, 3) [m], after the way to it."""
        touched = self.person.stroke(path) if len(path) > 1 else self.person.poke(path[0])
        self._coming = np.concatenate([self.person.rest(round(WAY * RATE)), touched])

    def feed(self, part: str, answers: FloatArray) -> None:
        """The person does not look at answers."""


def _taxel_fault(name: str, rest: str, boards: Boards) -> tuple[str, int, float]:
    """A fault of one taxel from words such as `weak:88,40`."""
    words = rest.split(",")
    try:
        channel, percent = int(words[0]), float(words[1]) if len(words) > 1 else 40.0
    except ValueError:
        raise InvalidArrayError(f"{name}:{rest} is not a fault: a channel is expected") from None
    row = np.flatnonzero(boards.table.channels == channel)
    if not len(row) or not 0 < percent < 100:
        raise InvalidArrayError(f"{name}:{rest}: {boards.part!r} has no such channel or share")
    return name, int(row[0]), percent


def parse_fault(text: str, boards: Boards) -> Fault:
    """A fault from words such as `swap:3,7`, `turn:5,120`, `mirror:5`, `mute:4`, `chains:0,1`.

    Raises
    ------
    UnknownNameError, InvalidArrayError
        Another word, module or chain, or another number of them.
    """
    name, _, rest = text.partition(":")
    if name not in NAMES:
        raise UnknownNameError("fault", name, (*NAMES, *OF_TAXELS))
    values = [int(word) if word.isdecimal() else -1 for word in rest.split(",")]
    element = 0
    if name in ("turn", "mirror"):
        values, degrees = values[:1], values[1] if len(values) > 1 else 120 * (name == "turn")
        element = (0 if name == "turn" else 3) + degrees // 120
    for fault in all_faults(boards).faults if boards.turnable or not element else ():
        if fault.kind == NAMES[name] and fault.element == element:
            numbers = fault.channels(boards) if fault.slots else fault.numbers(boards)
            if sorted(fault.chains or numbers) == sorted(values):
                return fault
    raise InvalidArrayError(
        f"{text!r}: {boards.part!r} has no such modules, chains, turns or channels of a module, "
        f"and nothing is exchanged with itself; modules: {', '.join(map(str, boards.numbers))}"
    )


PARTS = ("left_forearm", "torso", "left_leg_upper")
KINDS = tuple(name for name in NAMES if name != "channels")
REST = 300  # samples: 6 s
WEAK, TAXELS = 30, 5  # percent by which taxels lose gain, and how many of a skin
TRUTH = "planted fault (simulated)"


class Trials:
    """Check-ups of one part, prepared once."""

    def __init__(self, part: str) -> None:
        self.robot = skinmap.load_robot("icub")
        self.part, self.boards = part, boards_of(self.robot, part)
        self.patient = Patient(self.robot.skin(part))

    def word(self, kind: str, rng: np.random.Generator) -> str:
        """A fault of a kind, in words."""
        if kind in ("chains", "reverse", "mute-chain"):
            chains, counts = np.unique(self.boards.chains, return_counts=True)
            chosen = rng.choice(chains[counts > 2], 2 if kind == "chains" else 1, replace=False)
        else:
            chosen = rng.choice(self.boards.numbers, 2 if kind == "swap" else 1, replace=False)
        more = f",{rng.choice([120, 240])}" if kind == "turn" else ""
        return f"{kind}:{','.join(map(str, sorted(chosen.tolist())))}{more}"

    def run(self, plant: list[str], seed: int, *, covers: bool = False) -> Any:
        """An examination of a skin with these faults."""
        skin = SimulatedSkin(self.robot, self.part, plant, seed, patient=self.patient)
        plan = Plan(markers=[skin], covers=covers)
        return examine_live(skin, self.robot, (self.part,), plan)


def right(result: CheckupResult, word: str) -> bool:
    """Whether the fault was named, and no other."""
    name, _, rest = word.partition(":")
    wanted = {int(one) for one in rest.split(",")[: 1 if name == "turn" else 2]}
    return [one.kind for one in result.faults] == [NAMES[name]] and wanted == set(
        result.faults[0].chains or result.faults[0].modules
    )


def checkup_rows(
    *, faulty: int = 35, healthy: int = 201, rests: int = 500, histories: int = 10
) -> list[dict[str, Any]]:
    """All rows.

    Parameters
    ----------
    faulty : int
        Check-ups of each part with a fault.
    healthy : int
        Of healthy skins, over all parts.
    rests : int
        Rests of healthy skins, and of faulty ones.
    histories : int
        Skins whose gains are followed.
    """
    every = [Trials(part) for part in PARTS]
    rows, false, seconds = [], 0, []
    for number, trials in enumerate(every):
        found, named, start = 0, 0, time.process_time()
        for seed in range(faulty):
            word = trials.word(KINDS[seed % len(KINDS)], np.random.default_rng([seed, number]))
            result = findings(trials.run([word], seed))
            found += result.status in ("faulty", "inconsistent")
            named += right(result, word)
            seconds.append(result.skin_seconds)
        rows.append({
            "what": "all", "touch": "checkup", "part": trials.part, "runs": faulty,
            "found_percent": 100.0 * found / faulty, "named_percent": 100.0 * named / faulty,
            "skin_seconds_median": float(np.median(seconds)),
            "seconds": (time.process_time() - start) / faulty, "truth": TRUTH,
        })  # fmt: skip
        for seed in range(healthy // 3 + (number < healthy % 3)):
            false += findings(trials.run([], 1000 + seed)).status in ("faulty", "inconsistent")
    rows.append({"what": "healthy", "touch": "checkup", "part": "all", "runs": healthy,
                 "false_alarms": false, "truth": TRUTH})  # fmt: skip
    return [*rows, *rest_rows(every[0], rests), gain_row(every[0], histories)]


def gain_row(trials: Trials, runs: int) -> dict[str, Any]:
    """Taxels that lose gain after the first check-up of a skin, judged after two more."""
    found = planted = false = sound = 0
    for seed in range(runs):
        rows = np.random.default_rng(seed).choice(len(trials.boards.table), TAXELS, replace=False)
        weak = [f"weak:{c},{WEAK}" for c in trials.boards.table.channels[rows]]
        several = [trials.run(one, 10 * seed + k, covers=True).cases[0]
                   for k, one in enumerate(([], weak, weak))]  # fmt: skip
        times = [f"2026-0{k + 1}-01T00:00:00+00:00" for k in range(3)]
        changes = changes_of(trials.boards.part, times, [kept_part(one) for one in several])
        named = {one.row for one in changes[0]}
        found += len(named & set(rows.tolist()))
        planted += TAXELS
        false += len(named - set(rows.tolist()))
        sound += len(trials.boards.table) - TAXELS
    return {"what": f"weaker by {WEAK} %", "touch": "history", "part": trials.part, "runs": runs,
            "found_percent": 100.0 * found / planted,
            "false_percent": 100.0 * false / sound, "truth": TRUTH}  # fmt: skip


def rest_rows(trials: Trials, runs: int) -> list[dict[str, Any]]:
    """Stuck taxels, mute modules and channels given twice, from the rest alone, raw values."""
    rows = []
    for noise in (0.5, 1.2):
        wanted = {"stuck": 0, "mute": 0, "twice": 0}
        false_alarms = 0
        for seed in range(runs):
            rng = np.random.default_rng([seed, round(10 * noise)])
            raw = raw_rest(len(trials.boards.table), noise, rng)
            found = judge_rest(raw, trials.boards)
            false_alarms += bool(found.mute or found.found)
            a, b, c = rng.choice(len(trials.boards.table), 3, replace=False).tolist()
            module = int(rng.integers(len(trials.boards)))
            inside = trials.boards.columns[module]
            one = raw.copy()
            one[:, a] = one[0, a]
            still = judge_rest(one, trials.boards)
            wanted["stuck"] += [*still.rows("stuck"), *still.rows("dead")] == [[a]]
            one = raw.copy()
            one[:, inside[inside >= 0]] = 255
            wanted["mute"] += judge_rest(one, trials.boards).mute == (module,)
            one = raw.copy()
            one[:, c] = one[:, b]
            wanted["twice"] += judge_rest(one, trials.boards).rows("copied") == [sorted((b, c))]
        rows += [
            {"what": f"rest: {name}", "touch": "rest", "part": trials.part, "noise": noise,
             "runs": runs, "found_percent": 100.0 * count / runs, "truth": TRUTH}
            for name, count in wanted.items()
        ]  # fmt: skip
        rows.append({"what": "rest: healthy", "touch": "rest", "part": trials.part, "noise": noise,
                     "runs": runs, "false_alarms": false_alarms, "truth": TRUTH})  # fmt: skip
    return rows


def raw_rest(n: int, noise: float, rng: np.random.Generator) -> Any:
    """Raw counts (t, n) round 240: noise, slow drift, and a little hum that all channels share."""
    drift = np.cumsum(rng.normal(0.0, 0.01, (REST, n)), axis=0)
    hum = 0.15 * noise * np.sin(2 * np.pi * 0.37 * np.arange(REST))[:, None]
    level = rng.uniform(235.0, 245.0, n)
    return np.rint(level + drift + hum + rng.normal(0.0, noise, (REST, n)))
