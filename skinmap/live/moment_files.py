"""Moments of a recording as a file of rerun, and as a table of contacts (CSV or Parquet)."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.imports import import_optional
from skinmap.live.contacts.named_touch import Moment, NamedTouch, words_of
from skinmap.live.sources.playback import MarkedSpan
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin

NEED = "a file of rerun needs the package rerun-sdk: pip install 'skinmap[rerun]'"
TIMELINE = "time"  # from the first sample of the recording [s]
PERIOD = 0.099  # between two colours of a part at least [s]: its viewer shows no more of so many
AT_ONCE = 200  # rows that are sent together
RADIUS, TOUCH_RADIUS = 0.002, 0.005  # of taxels and centres of touches [m]
BODY = 0xA6B0BBFF  # red, green, blue, opacity
# From untouched to hardest pressed: light, yellow, red, dark.
STOPS = (0.0, 0.25, 0.65, 1.0)
SHADES = ((244, 242, 236), (253, 195, 112), (220, 74, 38), (92, 10, 46))


def write_rerun(
    moments: Iterable[Moment],
    robot: Robot,
    skins: Mapping[str, Skin],
    path: Path,
    *,
    name: str = "recording",
    marked: Sequence[MarkedSpan] = (),
) -> int:
    """Write a file that rerun's viewer opens.

    Parameters
    ----------
    moments : iterable of Moment
        One for each sample, with touches and their names.
    robot : Robot
    skins : mapping of str to Skin
        Of the parts that were recorded.
    path : Path
    name : str
        Of the recording in rerun's viewer.
    marked : sequence of (part, label, beginning, end)
        Marks of the recording itself [s]: a log of their own.

    Returns
    -------
    int
        Samples that were written.

    Raises
    ------
    MissingLibraryError
        The package `rerun-sdk` is not installed.
    """
    rerun = import_optional("rerun", NEED)
    stream = rerun.RecordingStream("skinmap", recording_id=name)
    stream.save(str(path))
    writer = _Writer(rerun, stream, robot, skins)
    count = 0
    try:
        writer.body()
        for moment in moments:
            writer.moment(moment)
            count += 1
        writer.marks(marked)
        writer.flush()
    finally:
        stream.disconnect()
    return count


class _Writer:
    """What is sent to a stream of rerun, entity by entity."""

    def __init__(self, rerun: Any, stream: Any, robot: Robot, skins: Mapping[str, Skin]) -> None:
        self.rerun, self.stream, self.robot, self.skins = rerun, stream, robot, skins
        # Times and rows that wait to be sent together.
        self._waiting: dict[str, list[tuple[float, Any]]] = {}
        self._coloured = dict.fromkeys(skins, -np.inf)
        self._told: set[tuple[str, int, str]] = set()
        self._touched: set[str] = set()
        self._angles: Mapping[str, float] = {}
        self._first = np.nan
        steps = np.linspace(0.0, 1.0, 256)
        table = np.stack([np.interp(steps, STOPS, shade) for shade in zip(*SHADES, strict=True)])
        red, green, blue = table.round().astype(np.uint32)
        self._table = red << 24 | green << 16 | blue << 8 | 0xFF

    def body(self) -> None:
        """Links in their natural pose, and the taxels on them."""
        self._pose(self.robot.pose, static=True)
        body = self.robot.body
        for link in body.visible_links:
            mesh = body.mesh(link)
            self.stream.log(
                f"world/{link}/mesh",
                self.rerun.Mesh3D(
                    vertex_positions=np.asarray(mesh.vertices, np.float32),
                    triangle_indices=np.asarray(mesh.faces, np.uint32),
                    albedo_factor=BODY,
                ),
                static=True,
            )
        for part, skin in self.skins.items():
            self.stream.log(
                self._at(part, "taxels"),
                self.rerun.Points3D(
                    np.asarray(skin.positions, np.float32),
                    radii=RADIUS,
                    labels=[str(channel) for channel in skin.channels.tolist()],
                    show_labels=False,
                ),
                static=True,
            )

    def moment(self, moment: Moment) -> None:
        """One sample."""
        self._first = moment.time if np.isnan(self._first) else self._first
        now = moment.time - self._first
        if moment.angles and dict(moment.angles) != self._angles:
            self._angles = dict(moment.angles)
            self.stream.set_time(TIMELINE, duration=now)
            self._pose({**self.robot.pose, **self._angles})
        for part, pressures in moment.pressures.items():
            if part not in self.skins:
                continue
            self._keep(f"plots/{part}/largest", now, float(np.nanmax(pressures, initial=0.0)))
            mine = [touch.area for touch in moment.touches if touch.part == part]
            self._keep(f"plots/{part}/area_mm2", now, 1e6 * float(np.nansum(mine)))
            if abs(now - self._coloured[part]) >= PERIOD:
                self._coloured[part] = now
                counts = np.clip(np.nan_to_num(pressures), 0, 255).astype(np.uint8)
                self._keep(self._at(part, "taxels"), now, self._table[counts], AT_ONCE)
            self._touches(part, now, moment)

    def marks(self, marked: Sequence[MarkedSpan]) -> None:
        """Labels that the recording itself has."""
        for part, label, begin, end in marked:
            self.stream.set_time(TIMELINE, duration=begin - self._first)
            text = f"{label} on {part}, {end - begin:.2f} s"
            self.stream.log("marked", self.rerun.TextLog(text, level="INFO"))

    def flush(self) -> None:
        """Send what waits."""
        for entity in list(self._waiting):
            self._send(entity)

    def _at(self, part: str, what: str) -> str:
        return f"world/{self.robot.part(part).link}/{part}/{what}"

    def _pose(self, angles: Mapping[str, float], *, static: bool = False) -> None:
        for link, T in self.robot.body.poses(dict(angles)).items():
            place = self.rerun.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3])
            self.stream.log(f"world/{link}", place, static=static)

    def _keep(self, entity: str, now: float, row: Any, most: int = 64 * AT_ONCE) -> None:
        """Keep a value or the colours of taxels until `most` can be sent together."""
        self._waiting.setdefault(entity, []).append((now, row))
        if len(self._waiting[entity]) >= most:
            self._send(entity)

    def _send(self, entity: str) -> None:
        times, rows = zip(*self._waiting.pop(entity), strict=True)
        index = self.rerun.TimeColumn(TIMELINE, duration=list(times))
        if isinstance(rows[0], float):
            columns = self.rerun.Scalars.columns(scalars=list(rows))
        else:
            colours = self.rerun.Points3D.columns(colors=np.concatenate(rows))
            columns = colours.partition(list(map(len, rows)))
        self.stream.send_columns(entity, [index], columns)

    def _touches(self, part: str, now: float, moment: Moment) -> None:
        """Centres and names of the touches of a part, gone when they end; news as text."""
        mine = [touch for touch in moment.touches if touch.part == part]
        if not mine and part not in self._touched:
            return
        self.stream.set_time(TIMELINE, duration=now)
        if not mine:
            self._touched.discard(part)
            self.stream.log(self._at(part, "touches"), self.rerun.Clear(recursive=False))
            return
        self._touched.add(part)
        self.stream.log(
            self._at(part, "touches"),
            self.rerun.Points3D(
                np.array([touch.centre for touch in mine], np.float32),
                radii=TOUCH_RADIUS,
                labels=[touch.label for touch in mine],
            ),
        )
        for touch in mine:
            news = part, touch.identity, touch.label
            if news not in self._told:
                self._told.add(news)
                text = f"{touch.label} on {part}"
                self.stream.log("touches", self.rerun.TextLog(text, level="INFO"))


NEED_ARROW = "a Parquet file needs pyarrow: pip install 'skinmap[lerobot]'"
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
    arrow = import_optional("pyarrow", NEED_ARROW)
    held = [dict(zip(COLUMNS, one, strict=True)) for one in rows]
    table = arrow.Table.from_pylist(held, schema=_schema(arrow))
    import_optional("pyarrow.parquet", NEED_ARROW).write_table(table, path)
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
    named = words_of(touch) or (None, None, None)
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
