"""What is asked for, and what it costs: time and memory by parts, taxels, mesh detail and layers.

Each case runs in fresh processes that have only imported (needs_cases.py), which take turns;
memory is the largest resident size above that after the imports. Writes
benchmarks/results/needs.json, and docs/needs.md with its picture from it (`--page` writes the page
from the file alone).
"""

from __future__ import annotations

import json
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness.forked import Cases
from benchmarks.harness.record import RESULTS, command
from benchmarks.harness.timing import quartiles
from benchmarks.scale.needs_cases import ALL_LAYERS, AS_READ, GROUPS, IMPORTS, LAYERS

TURNS = 5
PROGRAM = (sys.executable, "-m", "benchmarks.scale.needs_cases")
PARTS = (1, 3, 13)
TAXELS = (1_000, 3_000, 10_000, 30_000)
CELLS_MM = (16, 8, 4, 2, 1, AS_READ)
# What is measured, its cases, and its words in the page.
WHATS: dict[str, tuple[tuple[Any, ...], str]] = {
    "parts loaded": (PARTS, "Taxels, normals and links of so many parts of the iCub"),
    "parts prepared": (PARTS, "The same with surface meshes and flat maps"),
    "parts shown": (PARTS, "The same in a scene, on the links that carry them; first picture"),
    "taxels": (TAXELS, "One sheet of so many taxels, meshed and flattened"),
    "mesh detail": (
        CELLS_MM,
        "All links of the iCub in cells of so many mm, or as read; first picture",
    ),
    "layers": (
        (*LAYERS, ALL_LAYERS),
        "The right forearm in a scene, one layer shown or four in turn; pictures",
    ),
}


def measure(quick: bool, *, turns: int = TURNS) -> dict[str, Any]:
    """One row a case: medians and quartiles over fresh processes.

    Parameters
    ----------
    quick : bool
        One turn, the first and the last case of each.
    turns : int
        Fresh processes for each case.
    """
    chosen = {
        what: [str(case) for case in (every[:: len(every) - 1] if quick else every)]
        for what, (every, _) in WHATS.items()
    }
    cases = [(what, case) for what, every in chosen.items() for case in every]
    runs: dict[tuple[str, str], list[dict[str, float]]] = {key: [] for key in cases}
    with ExitStack() as stack:
        groups = {name: stack.enter_context(Cases(PROGRAM, name)) for name in IMPORTS}
        for _ in range(1 if quick else turns):
            for what, case in cases:
                runs[what, case].append(groups[GROUPS[what]].ask(what, case))
    return {"cases": [_row(*key, found) for key, found in runs.items()]}


def _row(what: str, case: str, runs: list[dict[str, float]]) -> dict[str, Any]:
    cpu, wall, mb = (quartiles([run[key] for run in runs]) for key in ("cpu_s", "wall_s", "mb"))
    several = len(runs) > 1
    return {
        "what": what,
        "case": case,
        "taxels": runs[0].get("taxels"),
        "triangles": runs[0].get("triangles"),
        "cpu_s": cpu[1],
        "wall_s": wall[1],
        "mb": mb[1],
        "imports_mb": float(np.median([run["imports_mb"] for run in runs])),
        "spread_s": cpu if several else None,
        "spread_mb": mb if several else None,
        "turns": len(runs),
    }


def main() -> None:
    """Measure and write both files, or write the page alone."""
    target: Path | None = RESULTS / "needs.json"
    if "--page" not in sys.argv:
        target = command(measure, __doc__, "needs")
    if target == RESULTS / "needs.json":
        from benchmarks.scale.needs_page import write_page

        write_page(json.loads(target.read_text(encoding="utf-8")))


if __name__ == "__main__":
    main()
