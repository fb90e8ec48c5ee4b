"""A recording of a day: how soon it is there, how quickly its touches and names are found.

    python -m benchmarks.viewer.viewer_day [--quick]

The torso of the iCub at 50 samples a second, touched for a second or two in each minute (simulated
touches, repeated), at rest between. Two files are opened: as it is written, and a copy that was cut
off before its overview, which has none and no index. All times are of one run, by the wall clock;
the machine's load average is kept with them.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import skinmap
from benchmarks.harness.record import afresh, command
from benchmarks.harness.timing import peak_mb, timed
from skinmap.io.mcap.writing import McapRecording
from viewer.playing.overview import fill_overview
from viewer.playing.player import Player
from viewer.view_options import Look, Session, new_scene
from viewer.window import Window

RATE, EVERY = 50, 60  # samples a second; a touch each so many seconds
JUMPS = 40
WATCHED = 120.0  # of names found in the background: speeds are those of so long at most [s]


def write_day(path: Path, hours: float) -> int:
    """Write the recording; its touches."""
    robot = skinmap.load_robot("icub")
    skin = robot.skin("torso")
    made = skinmap.simulate(skin, per_gesture=6, rng=0)
    touches = [samples for _, _, samples in made.touches()]
    rest = np.zeros((1, len(skin)), np.uint8)
    file = McapRecording(
        path, parts=["torso"], widths={"pressure": [len(skin)]}, rate=RATE, robot=robot.name,
        manifest=robot.origin, skins={"torso": skin}, chunk_seconds=10.0,
    )  # fmt: skip
    count, every = int(hours * 3600) // EVERY, EVERY * RATE
    for number in range(count):
        values = np.repeat(rest, every, axis=0)
        block, begin = touches[number % len(touches)], (20 + number % 15) * RATE
        values[begin : begin + len(block)] = block
        for row, sample in enumerate(values, number * every):
            file.add("pressure", row / RATE, sample)
    file.close()
    return count


def measured(path: Path, hours: float) -> dict[str, Any]:
    """Open a file as `skinmap view` does, and watch it."""
    started, spent_before = time.perf_counter(), time.process_time()
    robot = skinmap.load_robot("icub")
    session = Session(robot, ("torso",), source=str(path))
    session.prepare()
    scene = new_scene(session, Look(size=(1024, 768)), size=(1024, 768), off_screen=True)
    found: dict[str, Any] = {}
    with Player(session.live(), paused=True) as player:
        filled = time.perf_counter()
        thread = fill_overview(session, player)
        assert thread is not None
        window = Window(scene, player)
        while not window.drawn:
            window.turn()
            time.sleep(0.005)
        found["first_picture_s"] = round(time.perf_counter() - started, 2)
        found["first_picture_cpu_s"] = round(time.process_time() - spent_before, 2)
        while len(player.spans()) < 0.9 * hours * 3600 / EVERY and thread.is_alive():
            time.sleep(0.05)
        spent = time.perf_counter() - filled
        found["all_touches_s"] = round(time.perf_counter() - started, 2)
        found["touches_times_real_time"] = round(hours * 3600 / max(spent, 1e-3))
        before = time.perf_counter()
        names = sum(row[3] != "touch on torso" for row in player.spans())
        while thread.is_alive() and time.perf_counter() - before < WATCHED:
            time.sleep(0.1)
        rows = player.spans()
        named = sum(row[3] != "touch on torso" for row in rows) - names
        seconds = time.perf_counter() - before
        found["names_times_real_time"] = round(named * EVERY / seconds)
        found["spans"] = len(rows)
        jumps = []
        for wanted in np.random.default_rng(0).uniform(0.0, player.duration - 1.0, JUMPS):
            begun = time.perf_counter()
            player.seek(float(wanted))
            while player.moment is None or abs(player.moment.time - wanted) > 0.011:
                player.wait(player.number, 5.0)
            jumps.append(time.perf_counter() - begun)
        found["jump_median_s"] = round(float(np.median(jumps)), 3)
        found["jump_largest_s"] = round(max(jumps), 3)
    scene.close()
    found["peak_rss_gb"] = round(peak_mb() / 1024, 2)
    return found


def measure(quick: bool) -> dict[str, Any]:
    """Write, and measure each file in a process of its own."""
    hours = 0.1 if quick else 24.0
    with tempfile.TemporaryDirectory() as folder:
        day, bare = Path(folder) / "day.mcap", Path(folder) / "bare.mcap"
        touches, _, seconds = timed(lambda: write_day(day, hours))
        kept: dict[str, Any] = {
            "hours": hours, "touches": touches,
            "written_s": round(seconds), "file_mb": day.stat().st_size // 10**6,
        }  # fmt: skip
        data = day.read_bytes()
        bare.write_bytes(data[: data.rindex(b"overview.csv") - 60])  # as after kill -9
        del data
        for name, path in (("with_overview", day), ("without_overview", bare)):
            kept[name] = afresh(measured, path, hours)
    return kept


if __name__ == "__main__":
    command(measure, __doc__, "viewer_day")
