"""The wiring doctor on simulated skins: single faults, healthy ones, rests.

The contacts are those of `skinmap.touch` (Hertz pads laid in the log map, Gaussian foam), which is
not the model the doctor judges by; places are off by 4 mm an axis, gains spread by 15 to 40 %, 1 to
2 % of the taxels dead, 1 % of the touches somewhere else, spikes, noise of 1.2 counts. A fault
counts as found where it, and nothing else, was named.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

import skinmap
from benchmarks.calibration.person import Patient, Person
from calibration.wiring.boards import Boards, Wiring, boards_of
from calibration.wiring.doctor import Doctor
from calibration.wiring.faults import Fault
from calibration.wiring.rest import judge_rest
from calibration.wiring.touches import Baseline, make_touch

PARTS = (("left_forearm", 12), ("torso", 20), ("left_leg_upper", 28))  # and pokes asked for
STROKES = 18
MODULE_KINDS = (
    "swapped_modules", "turned_module", "mirrored_module", "mute_module", "swapped_chains",
    "reversed_chain", "mute_chain",
)  # fmt: skip
REST = 300  # samples: 6 s
TRUTH = "planted fault (simulated)"


class Trials:
    """Trials on one part, prepared once."""

    def __init__(self, part: str) -> None:
        robot = skinmap.load_robot("icub")
        self.part = part
        self.boards: Boards = boards_of(robot, part)
        self.patient = Patient(robot.skin(part))
        self.base = Doctor.of(self.boards)

    def faults(self, kind: str) -> list[Fault]:
        """All faults of a kind; of mirrored modules those that are not turned as well."""
        every = self.base.hypotheses.faults
        return [fault for fault in every if fault.kind == kind and fault.element < 4]

    def person(self, faults: Sequence[Fault], rng: np.random.Generator, **how: Any) -> Person:
        """Somebody, and a skin with these faults."""
        wiring = Wiring.as_mapped(self.boards)
        for fault in faults:
            wiring = fault.apply(wiring, self.boards)
        return Person(self.patient, rng, wiring.sources(self.boards), **how)

    def run(
        self,
        faults: Sequence[Fault],
        how: str,
        touches: int,
        seed: Sequence[int],
    ) -> tuple[Doctor, int]:
        """An examination; the doctor, and after how many touches the first fault was named."""
        person = self.person(faults, np.random.default_rng(list(seed)))
        doctor = self.base.again()
        rest = person.rest(REST)
        doctor.rest(judge_rest(rest, self.boards))
        level = Baseline.of(rest, "pressure")
        first = 0 if not doctor.found else -1
        for number in range(1, touches + 1):
            path, _ = doctor.next_place(how)
            samples = person.stroke(path) if how == "stroke" else person.poke(path[0])
            new = doctor.hear(make_touch(level.answers(samples), how, path))
            first = first or (number if new else 0)
        doctor.conclude()
        return doctor, first


def right(doctor: Doctor, faults: Sequence[Fault]) -> bool:
    """Whether these faults were named, and no other."""
    return {found.fault for found in doctor.found} == set(faults)


def wiring_rows(*, faulty: int = 35, healthy: int = 300, rests: int = 500) -> list[dict[str, Any]]:
    """All rows.

    Parameters
    ----------
    faulty : int
        Trials of each part and kind of touch.
    healthy : int
        Healthy skins for each kind of touch, over all parts.
    rests : int
        Rests of healthy skins, and of faulty ones.
    """
    every = [(Trials(part), pokes) for part, pokes in PARTS]
    rows = []
    for how in ("poke", "stroke"):
        false_alarms, done = 0, 0
        for number, (trials, pokes) in enumerate(every):
            touches = pokes if how == "poke" else STROKES
            rows += _fault_rows(trials, how, touches, faulty, number)
            share = healthy // 3 + (number < healthy % 3)
            for seed in range(share):
                doctor, _ = trials.run((), how, touches, (seed, number, 7))
                false_alarms += bool(doctor.found)
            done += share
        rows.append({"what": "healthy", "touch": how, "part": "all", "runs": done,
                     "false_alarms": false_alarms, "truth": TRUTH})  # fmt: skip
    rows += rest_rows(every[0][0], rests)
    return rows


def _fault_rows(
    trials: Trials, how: str, touches: int, faulty: int, number: int
) -> list[dict[str, Any]]:
    """A row for each kind, and one for all."""
    rows: list[dict[str, Any]] = []
    for place, kind in enumerate(MODULE_KINDS):
        choices = trials.faults(kind)
        found, wrong, when, seconds = 0, 0, [], 0.0
        runs = max(1, faulty // len(MODULE_KINDS))
        for seed in range(runs):
            rng = np.random.default_rng([seed, number, place])
            fault = choices[int(rng.integers(len(choices)))]
            start = time.process_time()
            doctor, first = trials.run((fault,), how, touches, (seed, number, place, 3))
            seconds += time.process_time() - start
            good = right(doctor, (fault,))
            found += good
            wrong += bool(doctor.found) and not good
            when += [max(first, 0)] if good and first else []
        rows.append({
            "what": kind, "touch": how, "part": trials.part, "touches": touches, "runs": runs,
            "found_percent": 100.0 * found / runs, "wrong_percent": 100.0 * wrong / runs,
            "touches_median": float(np.median(when)) if when else None,
            "ms_a_touch": 1e3 * seconds / runs / touches, "truth": TRUTH,
        })  # fmt: skip
    runs = sum(row["runs"] for row in rows)
    share = sum(row["runs"] * row["found_percent"] for row in rows) / runs
    rows.append({"what": "all", "touch": how, "part": trials.part, "touches": touches,
                 "runs": runs, "found_percent": share, "truth": TRUTH})  # fmt: skip
    return rows


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
            false_alarms += bool(len(found.stuck) or found.mute or len(found.pairs))
            a, b, c = rng.choice(len(trials.boards.table), 3, replace=False).tolist()
            module = int(rng.integers(len(trials.boards)))
            inside = trials.boards.columns[module]
            one = raw.copy()
            one[:, a] = one[0, a]
            wanted["stuck"] += judge_rest(one, trials.boards).stuck.tolist() == [a]
            one = raw.copy()
            one[:, inside[inside >= 0]] = 255
            wanted["mute"] += judge_rest(one, trials.boards).mute == (module,)
            one = raw.copy()
            one[:, c] = one[:, b]
            wanted["twice"] += judge_rest(one, trials.boards).pairs.tolist() == [sorted((b, c))]
        rows += [
            {"what": f"rest: {name}", "touch": "rest", "part": trials.part, "noise": noise,
             "runs": runs, "found_percent": 100.0 * count / runs, "truth": TRUTH}
            for name, count in wanted.items()
        ]  # fmt: skip
        rows.append({"what": "rest: healthy", "touch": "rest", "part": trials.part, "noise": noise,
                     "runs": runs, "false_alarms": false_alarms, "truth": TRUTH})  # fmt: skip
    return rows


def raw_rest(n: int, noise: float, rng: np.random.Generator, samples: int = REST) -> Any:
    """Raw counts (t, n) round 240: noise, slow drift, and a little hum that all channels share."""
    drift = np.cumsum(rng.normal(0.0, 0.01, (samples, n)), axis=0)
    hum = 0.15 * noise * np.sin(2 * np.pi * 0.37 * np.arange(samples))[:, None]
    level = rng.uniform(235.0, 245.0, n)
    return np.rint(level + drift + hum + rng.normal(0.0, noise, (samples, n)))
