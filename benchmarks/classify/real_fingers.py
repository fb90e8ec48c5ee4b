"""Real fingers on a real CySkin, and nothing at all on it: what a model of simulated touches says.

The recordings are not ours to ship: `../shared/data/cyskin` beside the repository has them, or
nothing is measured. `python -m benchmarks.classify.real_fingers` prints one JSON object.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.classify.classifier import DEFAULT, TouchClassifier, classifiers
from skinmap.classify.descriptors import recorded_touches
from skinmap.classify.naming import name_touches
from skinmap.skin.skin import skin_from_points
from skinmap.touch.grouping import GroupingRule
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.rest import find_rest
from skinmap.touch.simulator import simulate

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "cyskin"
RATE = 10.0  # samples a second
SATURATION = 20_002  # raw value at which a taxel of this skin says no more
REST_SHARE = 25.0  # percentile over time that is rest: the touches of these files are short
PER_GESTURE = 60
FINGERS = ("poke", "full_finger")  # what one finger may be called
FIRST = 3  # samples before anybody touches: the control


@dataclass(frozen=True, eq=False, slots=True)
class File:
    """One recording: how many fingers touched, and pressures (t, n) of 0 to 255 counts."""

    fingers: int
    pressures: NDArray[np.uint8]


def read_patch(folder: Path = DATA) -> tuple[PreparedSkin, NDArray[np.int64]]:
    """The skin of n taxels that was recorded on, and their ids; -1 for one that has several."""
    sheet = json.loads((folder / "gesture_patch" / "curved_gesture_patch.json").read_text())
    taxels = sheet["skin"]["taxels"]
    ids = np.array([int(one["id"]) for one in taxels])
    known, count = np.unique(ids, return_counts=True)
    ids[np.isin(ids, known[count > 1])] = -1  # unconnected taxels repeat an id
    positions = np.array([one["x"] for one in taxels], np.float64)
    normals = np.array([one["n"] for one in taxels], np.float64)
    return PreparedSkin(skin_from_points(positions, normals, part="gesture_patch")), ids


def read_files(ids: NDArray[np.int64], folder: Path = DATA) -> list[File]:
    """All recordings on the taxels of the patch; each taxel's own rest taken away."""
    with np.load(folder / "fingers.npz") as arrays:
        values, of_file = arrays["values"], arrays["file_index"]
        fingers = arrays["file_class"]
        column = {int(one): k for k, one in enumerate(arrays["taxel_ids"])}
    columns = np.array([column.get(int(one), -1) for one in ids])
    found = []
    for number, count in enumerate(fingers.tolist()):
        raw = np.where(columns >= 0, values[of_file == number][:, columns], 0).astype(np.float64)
        pressed = np.clip(raw - np.percentile(raw, REST_SHARE, axis=0), 0.0, SATURATION)
        found.append(File(count, np.rint(pressed * 255.0 / SATURATION).astype(np.uint8)))
    return found


def train(skin: PreparedSkin, *, seed: int, variety: float = 1.0) -> TouchClassifier:
    """The default classifier, trained on touches simulated on the same patch and nothing else."""
    rng = np.random.default_rng(seed)
    recording = simulate(skin.skin, rng=rng, per_gesture=PER_GESTURE, variety=variety)
    return classifiers.get(DEFAULT)().fit(recorded_touches(skin, recording), rng=rng)


def name_file(
    model: TouchClassifier, skin: PreparedSkin, pressures: NDArray[Any], *, first: int | None = None
) -> list[str]:
    """The names of the touches of one recording, or its first samples; none without a touch."""
    rule = GroupingRule(rate=RATE)
    rest = find_rest(pressures)
    named = name_touches(model, skin, pressures[:first], rule=rule, rest=rest)
    return [one.prediction.label for one in named]


def measure(*, seed: int = 0, variety: float = 1.0) -> dict[str, Any]:
    """Shares of the recordings that are named as they should be, and all names given."""
    skin, ids = read_patch()
    files = read_files(ids)
    model = train(skin, seed=seed, variety=variety)
    nothing = [name_file(model, skin, one.pressures) for one in files if one.fingers == 0]
    one_finger = [one.pressures for one in files if one.fingers == 1]
    said = [name_file(model, skin, pressures) for pressures in one_finger]
    before = [name_file(model, skin, pressures, first=FIRST) for pressures in one_finger]
    return {
        "variety": variety,
        "recordings_without_a_touch": len(nothing),
        "named_a_touch": float(np.mean([bool(names) for names in nothing])),
        "recordings_of_one_finger": len(said),
        "one_contact_of_one_finger": float(
            np.mean([len(names) == 1 and names[0] in FINGERS for names in said])
        ),
        "names": dict(Counter("+".join(names) or "no_contact" for names in said)),
        "named_in_their_first_samples": float(np.mean([bool(names) for names in before])),
    }


if __name__ == "__main__":
    if not DATA.is_dir():
        raise SystemExit(f"no recordings at {DATA.name}: nothing measured")
    print(json.dumps([measure(variety=variety) for variety in (0.0, 1.0)], indent=1))
