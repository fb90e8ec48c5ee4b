"""The second paper's tables on simulated touches.

    python -m benchmarks.classify.baxter [small|paper]

Writes benchmarks/results/baxter_<network>.json. CPU time of one thread: about 20 minutes with the
small network, tuned, ten repeats; as much for each training of the paper's.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from importlib.metadata import version

from benchmarks.harness.record import RESULTS
from skinmap.classify.protocols.baxter import PART, ROBOT, evaluate_baxter
from skinmap.io.robots.manifest import load_robot
from skinmap.touch.prepared_skin import PreparedSkin


def main() -> None:
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", nargs="?", choices=["small", "paper"], default="small")
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--untuned", action="store_true", help="the settings of the package")
    options = parser.parse_args()
    skin = PreparedSkin(load_robot(ROBOT).skin(PART))
    start = time.process_time()
    found = evaluate_baxter(
        skin,
        seed=options.seed,
        repeats=options.repeats,
        network=options.network,
        methods=("bovw", "cnn", "raw_rbf") if options.network == "small" else ("cnn",),
        tuned=not options.untuned,
        progress=lambda what: print(
            what or "repeat", f"{time.process_time() - start:.0f} s", file=sys.stderr
        ),
    )
    versions = {name: version(name) for name in ("numpy", "scikit-learn", "mahotas", "torch")}
    found |= {"cpu_s": time.process_time() - start, "python": platform.python_version()} | versions
    target = RESULTS / f"baxter_{options.network}.json"
    target.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
