"""Real fingers and hands on real CySkins: named by simulated touches alone, counted, followed.

    python -m benchmarks.classify.real_fingers

writes benchmarks/results/real_fingers.json. The recordings are not ours to ship:
`../shared/data/cyskin` beside the repository has them, or nothing is measured.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness.keep import run
from benchmarks.harness.record import RESULTS, about, watched, write
from skinmap.cli.evaluate.protocol_real import ARCHIVE, FOLDER
from skinmap.io.recordings.cyskin_arrays import find_pressed, read_pressed
from skinmap.recognition.classifier import DEFAULT, TouchClassifier, classifiers
from skinmap.recognition.descriptors import recorded_touches
from skinmap.recognition.naming import name_touches
from skinmap.touch.contacts.grouping import GroupingRule
from skinmap.touch.contacts.rest import find_rest
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "cyskin"
RATE = 10.0  # samples a second
OUT = RESULTS / "real_fingers.json"
PER_GESTURE = 60
FINGERS = ("poke", "full_finger")  # what one finger may be called
FIRST = 3  # samples before anybody touches: the control


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
    data = read_pressed(*find_pressed(DATA, ARCHIVE, FOLDER))
    skin = PreparedSkin(data.skin)
    model = train(skin, seed=seed, variety=variety)
    fingers = [] if data.classes is None else data.classes.tolist()
    files = list(zip(fingers, data.files, strict=True))
    nothing = [name_file(model, skin, pressures) for count, pressures in files if count == 0]
    one_finger = [pressures for count, pressures in files if count == 1]
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


def evaluated(protocol: str) -> tuple[dict[str, Any], set[str]]:
    """What the command prints of the recordings, and the pieces of code behind it."""
    found = run(["evaluate", "--protocol", protocol, str(DATA)])
    pieces = set(found.pop("made")["code"].split())
    left_out = ("archive", "patch", "files")
    return {key: value for key, value in found.items() if key not in left_out}, pieces


def main() -> None:
    """Measure and write."""
    if not DATA.is_dir():
        raise SystemExit(f"no recordings at {DATA.name}: nothing measured")
    head = about("full")
    with watched() as pieces:
        named = [measure(variety=variety) for variety in (0.0, 1.0)]
    (fingers, of_fingers), (hands, of_hands) = evaluated("fingers"), evaluated("hands")
    code = " ".join(sorted(pieces | of_fingers | of_hands))
    write(OUT, {**head, "code": code, "named": named, "fingers": fingers, "hands": hands})


if __name__ == "__main__":
    main()
