"""The area `page` of `make bench`: viewer_web.py, the page in Chromium beside viser."""

from __future__ import annotations

import inspect
from typing import Any

import viewer_web


def measure(quick: bool, *, openings: int = 3) -> dict[str, Any]:
    """Figures of the page; opened once, for two seconds, in the quick form."""
    vars(viewer_web)["OPENINGS"] = 1 if quick else openings
    if quick:
        vars(viewer_web)["SECONDS"] = 2.0
    own: Any = viewer_web.measure
    found = own(quick) if inspect.signature(own).parameters else own()
    if found["chromium"] is None:
        raise RuntimeError("there is no Chromium to open the page in")
    return dict(found)
