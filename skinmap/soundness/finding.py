"""A fault of a recording: its place, confidence, harm and remedy."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
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
HARM = tomllib.loads(Path(__file__).with_name("faults.toml").read_text(encoding="utf-8"))


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
    harm = HARM[kind]["harm"] if harm is None else harm
    return Finding(
        kind=kind,
        channels=None if channels is None else sorted({int(one) for one in channels}),
        rows=None if rows is None else [[int(a), int(b)] for a, b in rows],
        confidence=round(float(np.clip(confidence, 0.0, 1.0)), 3),
        harm=harm,
        matters=harm >= MATTERS,
        text=text,
        do=more.pop("do", HARM[kind]["do"]),
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
