"""What an installation without extras takes on the disk, to benchmarks/results/installed.json.

    python scripts/installed_size.py

Sizes are those of the files that each distribution lists, of all that `skinmap` needs in turn.
"""

from __future__ import annotations

import json
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

RESULT = Path(__file__).resolve().parents[1] / "benchmarks" / "results" / "installed.json"


def sizes() -> dict[str, float]:
    """Megabytes by distribution."""
    found: dict[str, float] = {}
    wanted = ["skinmap"]
    while wanted:
        name = wanted.pop()
        if name in found:
            continue
        try:
            one = distribution(name)
        except PackageNotFoundError:  # of another system
            continue
        files = [Path(str(file.locate())) for file in one.files or []]
        own = sum(file.stat().st_size for file in files if file.is_file())
        found[name] = own / 1e6
        for text in one.requires or []:
            need = Requirement(text)
            if need.marker is None or need.marker.evaluate({"extra": ""}):
                wanted.append(need.name.lower().replace("_", "-"))
    return found


if __name__ == "__main__":
    told = {name: round(size, 1) for name, size in sorted(sizes().items(), key=lambda p: -p[1])}
    content = {"total_mb": round(sum(told.values()), 1), "packages_mb": told}
    RESULT.write_text(json.dumps(content, indent=1) + "\n")
    print(f"{content['total_mb']} MB in {len(told)} packages")
