"""Make this example again: a simulated person pokes a right forearm with modules 3 and 7 swapped.

PYTHONPATH=. python docs/examples/board/wiring/make_wiring.py
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

import skinmap
from benchmarks.calibration.person import Patient, Person
from calibration.wiring import Baseline, Doctor, Fault, Wiring, boards_of, make_touch
from skinmap.io.recordings.touch_files import save_recordings
from skinmap.touch.recording import Recording

PART, SWAPPED, POKES, SEED = "right_forearm", (3, 7), 16, 4


def main(folder: Path) -> None:
    """Write the recording, the places that were asked for, and the truth."""
    robot = skinmap.load_robot("icub")
    boards = boards_of(robot, PART)
    fault = Fault("swapped_modules", tuple(np.searchsorted(boards.numbers, SWAPPED).tolist()))
    sources = fault.apply(Wiring.as_mapped(boards), boards).sources(boards)
    person = Person(Patient(robot.skin(PART)), np.random.default_rng(SEED), sources)
    doctor = Doctor.of(boards)
    blocks, events, paths = [person.rest(300)], [np.full(300, -1)], []
    level = Baseline.of(blocks[0], "pressure")
    for number in range(POKES):
        path, _ = doctor.next_place("poke")
        samples = person.poke(path[0])
        doctor.hear(make_touch(level.answers(samples), "poke", path))
        paths.append(path)
        blocks += [samples, person.rest(25)]
        events += [np.full(len(samples), number), np.full(25, -1)]
    values, marks = np.concatenate(blocks), np.concatenate(events)
    times = np.arange(len(values)) / 50.0
    recording = Recording(PART, times, values, marks, ("poke",) * POKES)
    save_recordings([recording], folder / "pokes.mcap", robot=robot)
    places = ["touch,x,y,z"]
    for number, path in enumerate(paths, start=1):
        places += [f"{number}," + ",".join(map(repr, point)) for point in path.tolist()]
    (folder / "places.csv").write_text("\n".join(places) + "\n", encoding="utf-8")
    truth = {"part": PART, "kind": fault.kind, "modules": fault.numbers(boards), "simulated": True}
    (folder / "truth.json").write_text(json.dumps(truth, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
