"""A fault of a recording: its place, confidence, harm and remedy."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal, get_args

import numpy as np
from msgspec import UNSET, UnsetType

from skinmap.arrays import IntArray
from skinmap.rows import column, row

Kind = Literal[
    "duplicate", "lost", "order", "restart", "burst", "clocks", "stamps", "dead", "stuck", "noisy",
    "clipped", "quantised", "repeated_id", "copied", "sign", "module", "thermal", "drift", "rest",
    "repeated_recording", "repeated_reference", "leak", "labels", "place", "wiring",
]  # fmt: skip
KINDS: tuple[str, ...] = get_args(Kind)
Span = list[int]
MATTERS = 0.25  # harm from which a finding is more than a remark
# Harm to whoever trains or measures (0 to 1), and the remedy.
HARM: dict[str, tuple[float, str]] = {
    "leak": (0.95, "record every label in several sessions, and test on sessions left out"),
    "clocks": (0.9, "align the two clocks by the line given here before comparing them"),
    "labels": (0.85, "look at these touches again with `skinmap label`"),
    "wiring": (0.85, "exchange these channels in the map, or their wires"),
    "repeated_recording": (0.8, "use one of the two, never both sides of a split"),
    "order": (0.75, "sort the rows by time; --mend writes them so"),
    "restart": (0.7, "treat the stretches as recordings of their own"),
    "duplicate": (0.7, "drop the repeated rows; --mend writes a copy without them"),
    "repeated_reference": (0.7, "find the true reference of one of the two"),
    "sign": (0.65, "turn the sign of these channels, or leave them out"),
    "module": (0.65, "check cable and board; leave these rows of the module out"),
    "lost": (0.6, "treat what lies on both sides of each gap as separate stretches"),
    "stuck": (0.6, "leave the channels out in these rows"),
    "place": (0.6, "complete the table of taxels, or leave these channels out"),
    "copied": (0.55, "leave one of each pair out"),
    "repeated_id": (0.55, "correct the ids; only one channel of each id can be placed"),
    "thermal": (0.55, "leave these channels out: they are not taxels"),
    "dead": (0.5, "leave these channels out"),
    "noisy": (0.5, "leave these channels out, or filter them"),
    "clipped": (0.45, "treat readings at this value as a lower bound of the pressure"),
    "drift": (0.45, "subtract a rest that follows the drift"),
    "rest": (0.45, "subtract the rest of each stretch for itself"),
    "stamps": (0.4, "take times from the sensor, or from the row number and the rate"),
    "burst": (0.35, "spread these rows evenly in time"),
    "quantised": (0.3, "expect no finer response than this step"),
}


@row
class Finding:
    """One fault of a recording."""

    kind: Kind = column("Kind of the fault.")
    file: str | UnsetType = column("File that has it.", default=UNSET)
    files: list[str] | UnsetType = column("Files that have it together.", default=UNSET)
    channels: list[int] | None = column("Channels, from 0; null for all.", default=None)
    rows: list[Span] | None = column(
        "First and last row of each stretch, from 0 in the order of the file; of a gap the rows "
        "before and after it; null for all.",
        default=None,
    )
    seconds: list[list[float]] | None = column(
        "First and last time of each stretch [s]; null for all, or without times.", default=None
    )
    confidence: float = column("Confidence, 0 to 1.")
    harm: float = column("Harm to a model or a measurement, 0 to 1.")
    matters: bool = column("Whether it makes the recording unsound.")
    text: str = column("The fault in a sentence.")
    do: str = column("Remedy for the fault.")
    value: float | UnsetType = column("Value at which the channels are clipped.", default=UNSET)
    offset_rows: float | UnsetType = column("Skin row of the first reference row.", default=UNSET)
    slope: float | UnsetType = column("Skin rows in one reference row.", default=UNSET)
    residual_rows: float | UnsetType = column(
        "How far the pairs of rows lie from the line [rows].", default=UNSET
    )


def finding(
    kind: Kind,
    text: str,
    *,
    channels: Iterable[int] | None = None,
    rows: Iterable[Sequence[int]] | None = None,
    confidence: float = 0.99,
    harm: float | None = None,
    **more: Any,
) -> Finding:
    """A finding with the usual harm and remedy of its kind."""
    usual, do = HARM[kind]
    harm = usual if harm is None else harm
    return Finding(
        kind=kind,
        channels=None if channels is None else sorted({int(one) for one in channels}),
        rows=None if rows is None else [[int(a), int(b)] for a, b in rows],
        confidence=round(float(np.clip(confidence, 0.0, 1.0)), 3),
        harm=harm,
        matters=harm >= MATTERS,
        text=text,
        do=more.pop("do", do),
        **more,
    )


def spans_of(rows: Any, join: int = 1) -> list[Span]:
    """Stretches of rows (k,), which rise; rows at most `join` apart are one stretch."""
    rows = np.asarray(rows, np.int64)
    if len(rows) == 0:
        return []
    cuts = np.flatnonzero(np.diff(rows) > join)
    first = rows[np.concatenate([[0], cuts + 1])]
    last = rows[np.concatenate([cuts, [len(rows) - 1]])]
    return [[int(a), int(b)] for a, b in zip(first, last, strict=True)]


def subject(channels: Sequence[int] | IntArray, one: str, many: str) -> str:
    """Channels with the verb that fits their number: "Channel 5 is", "Channels 1 and 2 are"."""
    return f"{named(channels).capitalize()} {one if len(channels) == 1 else many}"


def named(channels: Sequence[int] | IntArray, most: int = 8) -> str:
    """Channels in words: "channel 5", "channels 1, 2 and 14 more"."""
    head = ", ".join(str(int(one)) for one in list(channels)[:most])
    rest = f" and {len(channels) - most} more" if len(channels) > most else ""
    return f"channel{'s' if len(channels) != 1 else ''} {head}{rest}"
