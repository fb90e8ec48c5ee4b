"""Write docs/limits.md: measure every law of tests/extremes/limits and tabulate what came of it."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    """Measure all laws; 1 where one does not hold, and the page stays as it was."""
    sys.path.insert(0, str(ROOT / "tests" / "extremes"))
    from limits.law import measure
    from limits.page import LAWS, page

    try:
        measured = {law.name: measure(law) for law in LAWS}
    except AssertionError as error:
        print(f"limits: {error}", file=sys.stderr)
        return 1
    (ROOT / "docs" / "limits.md").write_text(page(measured), encoding="utf-8")
    print(f"docs/limits.md: {len(LAWS)} laws")
    return 0


if __name__ == "__main__":
    sys.exit(main())
