"""Ask the advisory service of pip-audit for known holes in the pinned versions.

0: none known. 1: some, listed. 2: no answer, or packages that the service does not know, which is
said in one line: nothing was checked then, and a quiet pass would be a lie.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

PINS = Path(__file__).resolve().parents[1] / "constraints.txt"


def main() -> int:
    """Run pip-audit on constraints.txt."""
    command = ["-m", "pip_audit", "-r", str(PINS), "--no-deps", "--disable-pip", "-f", "json"]
    try:
        done = subprocess.run(
            [sys.executable, *command, "--progress-spinner", "off"],
            capture_output=True, text=True, timeout=600,
        )  # fmt: skip
        found = json.loads(done.stdout)["dependencies"]
    except (subprocess.TimeoutExpired, ValueError, KeyError):
        print("audit: the advisory service gave no answer; nothing was checked", file=sys.stderr)
        return 2
    return report(found)


def report(found: list[dict[str, Any]]) -> int:
    """Print what was found in the packages of pip-audit's JSON; the exit code."""
    known = [one for one in found if "skip_reason" not in one]
    holes = [(one, hole) for one in known for hole in one["vulns"]]
    for one, hole in holes:
        mended = ", ".join(hole["fix_versions"]) or "no version yet"
        print(f"{one['name']} {one['version']}: {hole['id']}, mended in {mended}")
    print(f"audit: {len(holes)} known holes in {len(known)} of {len(found)} packages checked")
    if len(known) < len(found):
        skipped = len(found) - len(known)
        print(f"audit: {skipped} packages are unknown to the service: not checked", file=sys.stderr)
    return 1 if holes else 2 if len(known) < len(found) else 0


if __name__ == "__main__":
    sys.exit(main())
