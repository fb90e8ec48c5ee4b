"""Do thresholds hide light touches? Force of a fingertip against the share of them that is felt.

`python -m benchmarks.classify.detection` presses fingertips (simulated, elastic bed) on the torso
of the iCub on sensors drawn at full variety, and asks whether the gate of each taxel's own rest
lets them pass; beside it the share in which any taxel exceeds the level of a touch.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

import skinmap
from skinmap.geometry.log_map import log_map
from skinmap.touch.contacts import ACTIVE
from skinmap.touch.elastic_bed import bed_loads
from skinmap.touch.grouping import group_touches
from skinmap.touch.hands import FLESH, Body
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.rest import felt, find_rest
from skinmap.touch.simulator import REACH, prepare
from skinmap.touch.variety import draw_foam, draw_sensing

FORCES = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)  # [N]
TRIALS = 150
SKINS = 10
REST, HELD = 100, 25  # samples at rest before, and of the touch


def measure(part: str = "torso", *, seed: int = 0) -> dict[str, Any]:
    """Shares felt by force, and of samples at rest that are taken for a touch."""
    skin = PreparedSkin(skinmap.load_robot("icub").skin(part))
    rng = np.random.default_rng(seed)
    passed = np.zeros((len(FORCES), 2))
    false: list[float] = []
    for _ in range(SKINS):
        sensing = draw_sensing(1.0, rng=rng)
        stage = prepare(skin.skin, rng=rng, sensing=sensing, variety=1.0)
        quiet = stage.sensors.read(np.zeros((REST, len(skin))), rng=rng)
        rest = find_rest(quiet, quiet=np.ones(REST, bool))
        more = stage.sensors.read(np.zeros((REST, len(skin))), rng=rng)
        false.append(float(felt(more, rest, skin.geometry.beside).any(axis=1).mean()))
        for row, force in enumerate(FORCES):
            for _ in range(TRIALS // SKINS):
                source = int(rng.integers(len(skin)))
                uv, _ = log_map(skin.skin.positions, skin.skin.normals, stage.graph, source, REACH)
                uv = uv + rng.normal(0.0, 0.3 * stage.spacing, 2)
                flesh = float(np.exp(rng.uniform(*np.log(FLESH))))
                tip = Body((0.0, 0.0), (0.0, 0.0), rng.uniform(5e-3, 9e-3), 0.0, force, flesh)
                (load,) = bed_loads([tip], draw_foam(1.0, sensing.foam, rng), uv, skin.skin)
                samples = stage.sensors.read(np.tile(load, (HELD, 1)), rng=rng)
                own = felt(samples, rest, skin.geometry.beside)
                near = load > 0
                passed[row, 0] += bool(group_touches(skin.geometry, own, levels=rest.begins))
                passed[row, 1] += bool((samples[:, near] > ACTIVE).any(axis=1).mean() > 0.5)
    count = SKINS * (TRIALS // SKINS)
    return {
        "part": part,
        "touches_of_each_force": count,
        "rows": [
            {"force_n": force, "felt": gate / count, "any_taxel_active": bare / count}
            for force, (gate, bare) in zip(FORCES, passed.tolist(), strict=True)
        ],
        "samples_at_rest_taken_for_a_touch": float(np.mean(false)),
    }


if __name__ == "__main__":
    print(json.dumps(measure(), indent=1))
