"""The area `viewer` of `make bench`: viewer_speed.py, whose own file stays as it is."""

from __future__ import annotations

import inspect
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.harness.timing import quartiles
from benchmarks.viewer import viewer_speed


def measure(quick: bool, *, updates: int = 200_000, turns: int | None = None) -> dict[str, Any]:
    """Rows of frames, first picture, help and soak; the page is an area of its own.

    Parameters
    ----------
    quick : bool
    updates : int
        Of the soak.
    turns : int, optional
        At most so many turns of the frames, and so many fresh processes for a first picture.
    """
    if turns is not None:
        _at_most(turns)
    vars(viewer_speed)["web_rows"] = lambda *_, **__: "an area of its own"
    own: Any = getattr(viewer_speed, "measure", None)
    if own is not None:
        taken = inspect.signature(own).parameters
        length = {} if quick else {"soak": updates, "updates": updates}
        return _with_spread(dict(own(quick, **{k: v for k, v in length.items() if k in taken})))
    with tempfile.TemporaryDirectory() as folder:
        sys.argv = ["viewer_speed", "--out", folder]
        sys.argv += ["--quick"] if quick else ["--soak", str(updates)]
        viewer_speed.main()
        text = (Path(folder) / "viewer.json").read_text(encoding="utf-8")
    return _with_spread(dict(json.loads(text)))


def _with_spread(found: dict[str, Any]) -> dict[str, Any]:
    for row in found["first_picture"]:
        if len(row.get("runs", ())) > 1:
            each = [run["first_picture_s"] for run in row["runs"]]
            row["first_picture_quartiles_s"] = quartiles(each)
    return found


def _at_most(turns: int) -> None:
    """Let the functions that viewer_speed.py measures with take fewer turns."""
    module = vars(viewer_speed)
    frames, first = module.get("cpu_ms"), module.get("first_picture")
    if frames is not None:
        module["cpu_ms"] = lambda kinds, rounds, repeats: frames(
            kinds, rounds=min(rounds, turns), repeats=min(repeats, 5)
        )
    if first is not None:
        module["first_picture"] = lambda parts, links, repeats: first(
            parts, links, min(repeats, turns)
        )
