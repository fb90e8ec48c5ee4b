"""The wiring doctor on simulated skins: single faults, healthy ones, rests, two channels.

The contacts are those of `skinmap.touch` (Hertz pads laid in the log map, Gaussian foam), which is
not the model the doctor judges by; places are off by 4 mm an axis, gains spread by 15 to 40 %, 1 to
2 % of the taxels dead, 1 % of the touches somewhere else, spikes, noise of 1.2 counts. A fault
counts as found where it, and nothing else, was named. Alone, this prints the rows.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

import skinmap
from calibration.wiring.boards import Boards, Wiring, boards_of
from calibration.wiring.doctor import Doctor
from calibration.wiring.faults import Fault
from calibration.wiring.person import Patient, Person
from calibration.wiring.rest import judge_rest
from calibration.wiring.touches import Baseline, make_touch

PARTS = (("left_forearm", 12), ("torso", 20), ("left_leg_upper", 28))  # and pokes asked for
STROKES, HANDS = 18, 18
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
        *,
        rested: bool = True,
    ) -> tuple[Doctor, int]:
        """An examination; the doctor, and after how many touches the first fault was named."""
        person = self.person(faults, np.random.default_rng(list(seed)))
        doctor = self.base.again()
        rest = person.rest(REST)
        if rested:
            doctor.rest(judge_rest(rest, self.boards))
        level = Baseline.of(rest, "pressure")
        first = 0 if not doctor.found else -1
        for number in range(1, touches + 1):
            path, _ = doctor.next_place(how)
            sent = {"poke": person.poke, "hand": person.hold}.get(how)
            samples = person.stroke(path) if sent is None else sent(path[0])
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
    for how in ("poke", "stroke", "hand"):
        false_alarms, done = 0, 0
        for number, (trials, pokes) in enumerate(every):
            touches = {"poke": pokes, "stroke": STROKES, "hand": HANDS}[how]
            kinds = MODULE_KINDS if how != "hand" else ("swapped_modules", "mute_module")
            rows += _fault_rows(trials, how, touches, kinds, faulty, number)
            share = healthy // 3 + (number < healthy % 3)
            for seed in range(share):
                doctor, _ = trials.run((), how, touches, (seed, number, 7))
                false_alarms += bool(doctor.found)
            done += share
        rows.append({"what": "healthy", "touch": how, "part": "all", "runs": done,
                     "false_alarms": false_alarms, "truth": TRUTH})  # fmt: skip
    rows += rest_rows(every[0][0], rests)
    rows += [channel_row(trials, 48, max(2, faulty // 6)) for trials, _ in every[:2]]
    rows.append(pair_row(every[0][0], max(2, faulty // 3)))
    rows.append(alone_row(every[0][0], 12, max(2, faulty // 2)))
    return rows


def _fault_rows(
    trials: Trials, how: str, touches: int, kinds: Sequence[str], faulty: int, number: int
) -> list[dict[str, Any]]:
    """A row for each kind, and one for all."""
    rows: list[dict[str, Any]] = []
    for place, kind in enumerate(kinds):
        choices = trials.faults(kind)
        found, wrong, when, seconds = 0, 0, [], 0.0
        runs = max(1, faulty // len(kinds))
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


def channel_row(trials: Trials, most: int, runs: int) -> dict[str, Any]:
    """Two channels exchanged inside a module: no promise, how many pokes it takes."""
    choices = trials.faults("swapped_channels")
    when = []
    for seed in range(runs):
        rng = np.random.default_rng([seed, 11])
        fault = choices[int(rng.integers(len(choices)))]
        doctor, first = trials.run((fault,), "poke", most, (seed, 12))
        when += [first] if right(doctor, (fault,)) else []
    return {"what": "swapped_channels", "touch": "poke", "part": trials.part, "touches": most,
            "runs": runs, "found_percent": 100.0 * len(when) / runs,
            "touches_median": float(np.median(when)) if when else None,
            "truth": TRUTH}  # fmt: skip


def pair_row(trials: Trials, runs: int) -> dict[str, Any]:
    """Two faults of modules far apart, found one after the other in twice as many pokes."""
    found = 0
    centres = trials.boards.centres
    for seed in range(runs):
        rng = np.random.default_rng([seed, 13])
        while True:
            swap, turn = (
                trials.faults(kind)[int(rng.integers(len(trials.faults(kind))))]
                for kind in ("swapped_modules", "turned_module")
            )
            gap = np.linalg.norm(centres[list(swap.modules)] - centres[turn.modules[0]], axis=1)
            if gap.min() > 45e-3:
                break
        doctor, _ = trials.run((swap, turn), "poke", 24, (seed, 14))
        found += right(doctor, (swap, turn))
    return {"what": "swapped and turned", "touch": "poke", "part": trials.part, "touches": 24,
            "runs": runs, "found_percent": 100.0 * found / runs, "truth": TRUTH}  # fmt: skip


def alone_row(trials: Trials, touches: int, runs: int) -> dict[str, Any]:
    """Mute modules by touches alone, without what the rest says of them."""
    choices, found = trials.faults("mute_module"), 0
    for seed in range(runs):
        fault = choices[int(np.random.default_rng([seed, 15]).integers(len(choices)))]
        doctor, _ = trials.run((fault,), "poke", touches, (seed, 16), rested=False)
        found += right(doctor, (fault,))
    return {"what": "mute_module, no rest", "touch": "poke", "part": trials.part,
            "touches": touches, "runs": runs, "found_percent": 100.0 * found / runs,
            "truth": TRUTH}  # fmt: skip


if __name__ == "__main__":
    quick = {"faulty": 7, "healthy": 6, "rests": 10} if "--quick" in sys.argv else {}
    for row in wiring_rows(**quick):
        print(json.dumps(row), flush=True)
