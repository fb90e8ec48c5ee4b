"""Makes the recordings in `selftouch/`: a simulated iCub that touches its own left forearm.

    python docs/examples/board/make_selftouch.py

The forearm's patch is 20 mm and 10 degrees from where the manifest has it, zeros of joints are off
by half a degree, a tenth of the taxels is dead. `truth.json` says what is to be found. Another
seed gives another robot: `python make_selftouch.py 3`.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[2]))

import skinmap  # noqa: E402
from benchmarks.calibration.self_touch_rows import FINGER, HAND, JOINTS, LEFT, RIGHT, TIP, world  # noqa: E402
from calibration.files.self_touch_files import write_touches  # noqa: E402

TOUCHES = 120
PROBES = f"""# A fingertip has no taxels: this says what it sits on, and where its tip may be.
[[probe]]
name = "{FINGER}"
link = "{HAND}"
tip_mm = {[1e3 * float(value) for value in TIP]}
"""


def make(folder: Path, seed: int = 0) -> None:
    """Write two recordings, the file of probes and the truth."""
    rng = np.random.default_rng([seed, 11])
    robot = skinmap.load_robot("icub")
    made = world(robot, ((RIGHT, LEFT), (FINGER, LEFT)), (LEFT,), rng, touches=TOUCHES)
    folder.mkdir(parents=True, exist_ok=True)
    used = [k for k in range(len(JOINTS)) if any(k in b.chain.joints for b in made.bodies.values())]
    for one in made.recordings:
        own = replace(one, angles=np.round(one.angles[:, used], 6))
        names = [JOINTS[k] for k in used]
        write_touches(own, names, folder / f"{one.name}.npz", robot=robot.name)
    (folder / "probes.toml").write_text(PROBES)
    truth = {
        "T_link_patch": {LEFT: made.bodies[LEFT].chain.mount.tolist()},
        "tips_mm": {FINGER: (1e3 * TIP).tolist()},
        "dead": {
            name: np.flatnonzero(body.gains == 0.0).tolist()
            for name, body in made.bodies.items()
            if len(body.gains)
        },
    }
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


if __name__ == "__main__":
    make(HERE / "selftouch", int(sys.argv[1]) if len(sys.argv) > 1 else 0)
