"""Reading our recordings in MCAP, also those that were cut off or damaged."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, InvalidArrayError, SkinError
from skinmap.io.recordings.mcap_head import (
    check_widths,
    head_number,
    head_value,
    head_words,
    read_head,
)
from skinmap.io.recordings.mcap_index import Content, Index, McapSamples
from skinmap.io.recordings.mcap_recording import JOINTS, REPAIRED, TABLES, TOPICS, TOUCHES
from skinmap.io.recordings.mcap_scan import Scan
from skinmap.io.recordings.recorded_stream import (
    NS,
    Kind,
    Loss,
    MarkedTouch,
    RecordedStream,
    StreamInfo,
    measured_rate,
    nanoseconds_of,
)
from skinmap.io.taxels.table import parse_csv
from skinmap.skin.taxels import TaxelTable

MAX_JOINTS = 10_000


def read_track(path: Path, *, kind: Kind | None = None) -> RecordedStream:
    """Open a Skinmap recording; a cut or damaged one with all that can be had of it.

    Parameters
    ----------
    path : Path
    kind : {"raw", "pressure"}, optional
        Pressures where they were recorded, else raw values.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, not MCAP, or MCAP of somebody else.
    """
    index = Index(path)
    head = read_head(index.found)
    widths = head_value(head, "widths", dict, path)
    kinds: list[Kind] = [each for each in ("pressure", "raw") if each in widths]
    if kind is None:
        filled = [each for each in kinds if _filled(index, each)]
        kind = (filled or kinds or ["raw"])[0]
    if kind not in widths:
        raise DataFormatError(f"holds no {kind} values, only {', '.join(kinds)}", path)
    parts = tuple(str(part) for part in head_value(head, "parts", list, path))
    columns = check_widths(widths[kind], parts, path)
    values = McapSamples(index, kind, sum(columns))
    rate, held = head_number(head, "rate", path), head_number(head, "chunk_seconds", path)
    joints, angles = _angles(index, values.stamps)
    return RecordedStream(
        StreamInfo(
            head.get("name", "") or path.name,
            parts,
            columns,
            rate,
            kind,
            head.get("robot", ""),
            head_words(head, "fingerprints", path),
            head.get("clock", "recording"),
        ),
        values.times,
        values,
        touches=_touches(index, values.stamps),
        joints=joints,
        angles=angles,
        tables=_tables(index.found),
        loss=_loss(index.found, values, rate or measured_rate(values.times), held, head, path),
        samples={
            part: int(count)
            for part, count in head_value(head, "samples", dict, path).items()
            if isinstance(count, int)
        },
    )


def _filled(index: Index, kind: Kind) -> bool:
    return any(len(index.of(topic)) for (each, _), topic in TOPICS.items() if each == kind)


def _objects(index: Index, topic: str) -> list[tuple[int, dict[str, Any]]]:
    """Time [ns] and content of each JSON message of a topic, in the order of time."""
    messages, content = index.of(topic), Content(index)
    found = []
    for row in messages.order().tolist():
        try:
            one = json.loads(content(messages, row))
        except (ValueError, RecursionError):
            one = None
        if not isinstance(one, dict):
            raise DataFormatError(f"message {row} of {topic} is damaged", index.path)
        found.append((messages.times[row], one))
    return found


def _touches(index: Index, stamps: IntArray) -> tuple[MarkedTouch, ...]:
    """Touches by what was said at their end, else at their beginning."""
    ends: dict[tuple[str, int, float], dict[str, Any]] = {}
    for _, one in _objects(index, TOUCHES):
        kinds: dict[str, Any] = {"part": str, "event": int, "began_s": int | float, "label": str}
        if not all(isinstance(one.get(key), kind) for key, kind in kinds.items()):
            raise DataFormatError("a touch without its part, event, time or label", index.path)
        key = (one["part"], one["event"], one["began_s"])
        if key not in ends or "ended_s" in one:
            ends[key] = one
    touches = []
    for (part, event, began), one in ends.items():
        subject, owners = one.get("subject", 0), one.get("owners")
        try:
            first = int(np.searchsorted(stamps, nanoseconds_of(began)))
            last = len(stamps) - 1
            if "ended_s" in one:
                ended = nanoseconds_of(one["ended_s"])
                last = int(np.searchsorted(stamps, ended, side="right")) - 1
        except (InvalidArrayError, TypeError):
            raise DataFormatError(f"touch {event} of {part!r} has no time", index.path) from None
        if not isinstance(subject, int) or not isinstance(owners, dict | None):
            raise DataFormatError(f"touch {event} of {part!r} is damaged", index.path)
        touches.append(MarkedTouch(part, event, one["label"], first, last, subject, owners))
    return tuple(touches)


def _angles(index: Index, stamps: IntArray) -> tuple[tuple[str, ...], FloatArray]:
    """Names of the joints and their angles (t, j), each from the last message before a sample."""
    rows = _objects(index, JOINTS)
    joints = tuple(dict.fromkeys(name for _, one in rows for name in one))
    if len(joints) > MAX_JOINTS:
        raise DataFormatError(f"{len(joints)} joints; no robot has so many", index.path)
    angles = np.full((len(stamps) if joints else 0, len(joints)), np.nan)
    place = {name: column for column, name in enumerate(joints)}
    for time, one in rows:
        row = int(np.searchsorted(stamps, time))
        for name, angle in one.items():
            if isinstance(angle, int | float):
                angles[row : row + 1, place[name]] = angle
    known = np.where(np.isnan(angles), 0, np.arange(1, len(angles) + 1)[:, None])
    latest = np.maximum.accumulate(known, axis=0) if len(angles) else known
    return joints, np.where(
        latest > 0, np.take_along_axis(angles, (latest - 1).clip(0), axis=0), np.nan
    )


def _tables(found: Scan) -> dict[str, TaxelTable]:
    """The skins in the file; a damaged one is left out, the samples do not need it."""
    tables = {}
    for name, data in found.attachments.items():
        if name.startswith(TABLES) and name.endswith(".csv"):
            part = name.removeprefix(TABLES).removesuffix(".csv")
            try:
                tables[part] = parse_csv(data.decode(), found.path)
            except (SkinError, UnicodeDecodeError) as error:
                found.damage.append(f"the table of {part!r}: {error}")
    return tables


def _loss(
    found: Scan,
    values: McapSamples,
    rate: float,
    held: float,
    head: dict[str, str],
    path: Path,
) -> Loss:
    """What is missing now, and what a repaired file remembers of the one it was made from."""
    if REPAIRED in head:
        before = Loss(True, head_number(head, REPAIRED, path), ("repaired before",))
    else:
        before = Loss()
    if found.finished and not found.damage:
        return before
    step = 1.0 / rate if rate > 0 else 0.0
    times, samples = values.times, values.samples
    missing = np.diff(samples) > 1
    seconds = float((np.diff(times)[missing] - step).clip(0.0).sum())
    seconds += step * float(samples[0] if len(samples) else 0)
    last = times[-1] if len(times) else 0.0
    promised = found.promised / NS - last
    if promised > 0 and len(times):
        seconds += float(promised)
    elif not found.finished:
        seconds += held
    if REPAIRED in head:
        seconds = max(seconds, before.seconds)  # the samples missing inside are in both
    return Loss(True, seconds, tuple(found.damage[:100]))
