"""Check-ups of simulated skins from the first sample to the last word, and rests alone.

The contacts are those of `skinmap.touch` (Hertz pads laid in the log map, Gaussian foam), which is
not the model the doctor judges by; places are off by 4 mm an axis, gains spread by 15 to 40 %, 1 %
of the touches somewhere else, spikes, noise of 1.2 counts. A check-up ends after a minute of
samples. A fault is named right where it, and nothing else, is in the result.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import skinmap
from benchmarks.calibration.person import NAMES, Patient, SimulatedSkin
from calibration.wiring.boards import boards_of
from calibration.wiring.examination import Plan, examine_live
from calibration.wiring.findings import CheckupResult, findings
from calibration.wiring.history import changes_of, kept_part
from calibration.wiring.touches import judge_rest

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
            wanted["stuck"] += stands(one, trials) == [[a]]
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


def stands(rest: Any, trials: Trials) -> list[list[int]]:
    """Rows that stand still at rest, whatever their level."""
    found = judge_rest(rest, trials.boards)
    return [*found.rows("stuck"), *found.rows("dead")]


def raw_rest(n: int, noise: float, rng: np.random.Generator, samples: int = REST) -> Any:
    """Raw counts (t, n) round 240: noise, slow drift, and a little hum that all channels share."""
    drift = np.cumsum(rng.normal(0.0, 0.01, (samples, n)), axis=0)
    hum = 0.15 * noise * np.sin(2 * np.pi * 0.37 * np.arange(samples))[:, None]
    level = rng.uniform(235.0, 245.0, n)
    return np.rint(level + drift + hum + rng.normal(0.0, noise, (samples, n)))
