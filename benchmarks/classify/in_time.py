"""Touches in time against what is asked of them: `python -m benchmarks.classify.in_time`.

Names with parts and people left out, with and without motion and of half a touch; direction and
speed of strokes on robots of several lattices and in MuJoCo; presses counted; what following the
motion of five contacts costs. Simulated, but for the time. Writes benchmarks/results/in_time.json.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks import ROOT
from benchmarks.harness import keep
from benchmarks.harness.record import write
from benchmarks.live.live_speed import in_time_rows
from skinmap import load_robot
from skinmap.cli.evaluate.protocol_time import strokes_row
from skinmap.errors import UnknownNameError
from skinmap.live.contacts.contact_motion import MotionBook
from skinmap.live.contacts.contact_tracker import ContactTracker
from skinmap.live.contacts.stroke_errors import stroke_errors
from skinmap.live.robot_skin import JoinedSkin
from skinmap.recognition.protocols.physics import OURS
from skinmap.report.result import plain
from skinmap.skin.checks import twin_parts
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate

OUT = ROOT / "benchmarks" / "results" / "in_time.json"
ROBOTS = (("kaspar", ("left_hand",)), ("ur10e-cyskin", ()))  # beside the iCub
CONTACTS = 5
SAMPLES = 300


def skins_of(robot: str, parts: tuple[str, ...] = ()) -> dict[str, PreparedSkin]:
    """Skins of a robot, one of each pair of mirror images."""
    loaded = load_robot(robot)
    firsts = twin_parts({part: loaded.skin(part) for part in parts or loaded.parts})
    return {part: PreparedSkin(loaded.skin(part)) for part in dict.fromkeys(firsts.values())}


def names(per_gesture: int, seeds: int) -> dict[str, Any]:
    """Names, presses, directions and speeds on the iCub, in three physics: evaluate's protocol."""
    words = ["--protocol", "time", "--per-gesture", str(per_gesture), "--seeds", str(seeds)]
    found = keep.run(["evaluate", *words])
    whole = next(
        row["mean"]
        for row in found["rows"]
        if (row["features"], row["tested_on"], row["seen"]) == ("and motion", OURS, 1.0)
    )
    lost = 100.0 * (found["still_alone"] - found["still_together"])
    return {**found, "named": whole, "still_lost_points": lost}


def other_robots(strokes: int, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Directions and speeds of strokes on other lattices."""
    rows: list[dict[str, Any]] = []
    for robot, parts in ROBOTS:
        try:
            skins = skins_of(robot, parts)
        except UnknownNameError:
            rows.append({"robot": robot, "missing": "no such robot here"})
            continue
        found = []
        for skin in skins.values():
            for seed in seeds:
                made = simulate(skin.skin, rng=seed, gestures=["stroke"], per_gesture=strokes)
                found += stroke_errors(skin, made)
        rows.append({"robot": robot, "parts": list(skins), **plain(strokes_row("ours", found))})
    return rows


def cost() -> dict[str, float]:
    """CPU time of following the motion of five contacts that move, a sample [ms]."""
    loaded = load_robot("icub")
    joined = JoinedSkin({part: PreparedSkin(loaded.skin(part)) for part in loaded.parts})
    tracker, book = ContactTracker(joined), MotionBook(joined)
    rng = np.random.default_rng(0)
    starts = [int(rng.integers(rows.start, rows.stop)) for rows in joined.slices.values()][
        :CONTACTS
    ]
    spent, contacts = [], []
    centres = joined.positions[starts]
    for k in range(SAMPLES):
        sample = np.zeros(len(joined))
        for centre, start in zip(centres, starts, strict=True):
            same = joined.part_of == joined.part_of[start]
            place = centre + np.array([0.0, 0.0, 0.015 * np.sin(k / 15.0)])
            away = np.linalg.norm(joined.positions - place, axis=1)
            sample[same & (away < 0.014)] = 120.0
        tracker.update(k / 50.0, sample)
        tracks = tracker.present
        began = time.process_time()
        book.update(k / 50.0, {one.identity: [one] for one in tracks}, sample)
        for one in tracks:
            book.motion(one.identity, one.part, one.normal)
        spent.append(time.process_time() - began)
        contacts.append(len(tracks))
    few = np.array(spent)[20:] * 1e3
    return {
        "taxels": len(joined), "contacts": float(np.median(contacts)),
        "median_ms": float(np.median(few)), "p95_ms": float(np.percentile(few, 95)),
    }  # fmt: skip


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--touches", type=int, default=24, help="of each gesture on each part")
    parser.add_argument("--seeds", type=int, default=2)
    chosen = parser.parse_args()
    seeds = list(range(chosen.seeds))
    icub = names(chosen.touches, chosen.seeds)
    found = {
        "made": icub.pop("made"), "touches": chosen.touches, "seeds": seeds, "cost": cost(),
        "sample_to_labels": in_time_rows(quick=False),
        "robots": other_robots(2 * chosen.touches, seeds), "icub": icub,
    }  # fmt: skip
    write(OUT, found)
    print(OUT.read_text())


if __name__ == "__main__":
    main()
