"""Make the files of `plane`: the iCub's right forearm pressed on a table, simulated.

    python docs/examples/board/make_plane.py [FOLDER]

The presses are those of `benchmarks/calibration/planes.py`: eight poses at random and 32 as the
calibration proposes them, mount off by 20 mm and 10 degrees, joints by 0.5 degrees, table and arm
by 1 mm. The files are the same with every run.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[2]))

from benchmarks.calibration.planes import bench, chosen  # noqa: E402

PART, SEED, PRESSES = "right_forearm", 1000, 40


def main(folder: Path) -> None:
    """Write both files."""
    folder.mkdir(parents=True, exist_ok=True)
    one = bench(PART, SEED)
    contacts, _ = chosen(one, [PRESSES])[PRESSES]
    channels = one.robot.skin(PART).channels
    active = contacts.active[PART]
    np.savez_compressed(
        folder / "presses.npz",
        joints=np.array(one.joints),
        angles=contacts.angles,
        **{
            f"ids_{PART}": np.concatenate([channels[np.flatnonzero(row)] for row in active]),
            f"ptr_{PART}": np.cumsum([0, *active.sum(axis=1)]),
        },
    )
    lines = [
        f"{channel},{x:.6f},{y:.6f},{z:.6f}"
        for channel, (x, y, z) in zip(channels.tolist(), one.places.tolist(), strict=True)
    ]
    text = "\n".join(["channel,x,y,z", *lines]) + "\n"
    (folder / "truth.csv").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "plane")
