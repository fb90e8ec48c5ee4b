"""Contacts of a recording as a table: a row for each touch and sample, as CSV or Parquet."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from skinmap.imports import import_optional
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.moment import Moment
from skinmap.live.sources.playback import MarkedSpan
from skinmap.skin.robot import Robot

NEED = "a Parquet file needs pyarrow: pip install 'skinmap[lerobot]'"
KILO, MM, MM2 = 1e-3, 1e3, 1e6
COLUMNS = (
    "time", "id", "part", "link", "x_mm", "y_mm", "z_mm", "area_mm2", "area_low_mm2",
    "area_high_mm2", "force_n", "force_low_n", "force_high_n", "mean_kpa", "mean_low_kpa",
    "mean_high_kpa", "peak_kpa", "peak_low_kpa", "peak_high_kpa", "peak_counts", "label",
    "confidence", "kind", "motion", "hand", "refused",
    "marked",
)  # fmt: skip
Cell = str | int | float | None


def write_contacts(
    moments: Iterable[Moment],
    robot: Robot,
    path: Path,
    *,
    parquet: bool,
    marked: Sequence[MarkedSpan] = (),
) -> int:
    """Write the touches of all moments.

    Parameters
    ----------
    moments : iterable of Moment
        One for each sample, with touches and their names.
    robot : Robot
        Places are in the frames of its links.
    path : Path
    parquet : bool
        Whether to write Parquet instead of CSV; all rows are held in memory then.
    marked : sequence of (part, label, beginning, end)
        Marks of the recording itself [s]; the last column names those of a touch's part.

    Returns
    -------
    int
        Rows that were written.

    Raises
    ------
    MissingLibraryError
        Parquet without pyarrow.
    """
    rows = (
        [*row(moment.time, touch, robot), _marked(moment.time, touch.part, marked)]
        for moment in moments
        for touch in moment.touches
    )
    if not parquet:
        return _write_csv(rows, path)
    arrow = import_optional("pyarrow", NEED)
    held = [dict(zip(COLUMNS, one, strict=True)) for one in rows]
    table = arrow.Table.from_pylist(held, schema=_schema(arrow))
    import_optional("pyarrow.parquet", NEED).write_table(table, path)
    return len(held)


def row(time: float, touch: NamedTouch, robot: Robot) -> list[Cell]:
    """The cells of one touch; None for a number that is not known."""
    load = touch.load
    if load is None or load.refused:
        least, most = MM2 * touch.area_least, MM2 * touch.area
        numbers: list[Cell] = [None, least, most, *[None] * 9]
    else:
        ends = ((load.area, MM2), (load.force, 1.0), (load.mean, KILO), (load.peak, KILO))
        numbers = [factor * end for interval, factor in ends for end in interval]
    answers = touch.answers
    named: list[Cell] = [None] * 3
    if answers is not None:
        named = [answers.kind.answer, answers.motion.answer, answers.hand.answer]
    return [
        time, touch.identity, touch.part, robot.part(touch.part).link,
        *(MM * touch.centre).tolist(), *numbers, touch.peak, touch.label, touch.confidence, *named,
        "" if load is None else load.refused,
    ]  # fmt: skip


def _marked(time: float, part: str, marked: Sequence[MarkedSpan]) -> str:
    there = (label for of, label, begin, end in marked if of == part and begin <= time <= end)
    return " + ".join(dict.fromkeys(there))


def _write_csv(rows: Iterator[list[Cell]], path: Path) -> int:
    count = 0
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for one in rows:
            count += 1
            rest = (f"{cell:.7g}" if isinstance(cell, float) else cell for cell in one[1:])
            table.writerow([f"{one[0]:.6f}", *rest])  # times of a clock of Unix, to 1 us
    return count


def _schema(arrow: Any) -> Any:
    texts = {"part", "link", "label", "kind", "motion", "hand", "refused", "marked"}
    kinds = {"id": arrow.int64(), **{name: arrow.string() for name in texts}}
    return arrow.schema([(name, kinds.get(name, arrow.float64())) for name in COLUMNS])
