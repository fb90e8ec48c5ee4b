"""The area `page` of `make bench`: viewer_web.py, the page in Chromium beside viser."""

from __future__ import annotations

from typing import Any

from benchmarks.viewer import viewer_web


def measure(quick: bool, *, openings: int = 3) -> dict[str, Any]:
    """Figures of the page; where there is no Chromium the area fails and says so."""
    found = viewer_web.measure(quick, openings=1 if quick else openings)
    if found["chromium"] is None:
        raise RuntimeError("there is no Chromium to open the page in")
    return found
