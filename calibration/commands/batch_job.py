"""Many patches, each a row of a table: read, wrapped by free workers, written as they end."""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.commands.patch_job import PatchTask
from calibration.files.anchor_table import load_wrap
from calibration.patch.solver_budget import FULL, Effort
from skinmap.errors import DataFormatError, SkinError, unknown_name
from skinmap.io.text import parse_floats, read_text
from skinmap.io.units import UNITS
from skinmap.parallel.run import each_result
from skinmap.parallel.workers import ONE, Workers

NEEDED = ("name", "layout", "mesh", "anchors")
KNOWN = (*NEEDED, "units", "sigma_mm", "mirror")
WORDS = {"yes": True, "no": False}  # of the column `mirror`
FAILED = "failed"


@dataclass(frozen=True, slots=True)
class BatchRow:
    """One patch of the table.

    Attributes
    ----------
    name : str
        Folder of its files.
    layout, mesh, anchors : Path
    units : str
    sigma_mm : float
    mirror : bool
        Whether the board is drawn from its other side.
    """

    name: str
    layout: Path
    mesh: Path
    anchors: Path
    units: str
    sigma_mm: float
    mirror: bool

    def load(self, effort: Effort) -> PatchTask:
        """Its files."""
        return load_wrap(
            self.layout, self.mesh, self.anchors, units=self.units, sigma_mm=self.sigma_mm,
            mirror=self.mirror, effort=effort,
        )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class RowTask:
    """One patch: what a worker needs; why it cannot be read stands in place of its evidence."""

    name: str
    evidence: PatchTask | str
    seed: int
    formats: tuple[str, ...]
    accept: bool


def read_batch(path: Path, units: str, sigma_mm: float) -> list[BatchRow]:
    """The patches of a table `name,layout,mesh,anchors[,units,sigma_mm,mirror]`.

    Files are looked for from the table's folder.

    Raises
    ------
    DataFormatError
        A missing or unknown column, a name twice or that is no name of a folder, a word that is
        no number (says which line).
    """
    reader = csv.reader(read_text(path).splitlines(keepends=True))
    try:
        return _rows(reader, path, units, sigma_mm)
    except csv.Error as error:
        raise DataFormatError(f"not CSV: {error}", path, reader.line_num) from None


def _rows(reader: Any, path: Path, units: str, sigma_mm: float) -> list[BatchRow]:
    names = [cell.strip().lower() for cell in next(reader, [])]
    if set(NEEDED) - set(names) or set(names) - set(KNOWN) or len(set(names)) < len(names):
        raise DataFormatError(
            f"expected the columns {','.join(NEEDED)} and perhaps units,sigma_mm,mirror, "
            f"got {','.join(names)[:200]!r}",
            path,
            1,
        )
    rows: dict[str, BatchRow] = {}
    for cells in reader:
        if not cells:
            continue
        line = reader.line_num
        if len(cells) != len(names):
            raise DataFormatError(f"expected {len(names)} columns, got {len(cells)}", path, line)
        words = {name: cell.strip() for name, cell in zip(names, cells, strict=True)}
        row = _row(words, path, line, units, sigma_mm)
        if row.name in rows:
            raise DataFormatError(f"the patch {row.name!r} comes more than once", path, line)
        rows[row.name] = row
    if not rows:
        raise DataFormatError("the table has no row", path, 1)
    return list(rows.values())


def _row(words: Mapping[str, str], path: Path, line: int, units: str, sigma_mm: float) -> BatchRow:
    name, unit = words["name"], words.get("units") or units
    if not name or name.startswith(".") or {*name} & set("/\\\0"):
        raise DataFormatError(f"{name!r} is no name for a folder", path, line)
    if unit not in UNITS:
        raise DataFormatError(unknown_name("unit", unit, UNITS), path, line)
    word = words.get("sigma_mm")
    sigma = parse_floats([word], path, line)[0] if word else sigma_mm
    if not 0.0 < sigma < np.inf:
        raise DataFormatError(f"sigma_mm must be above 0, got {sigma:g}", path, line)
    mirror = words.get("mirror") or "no"
    if mirror not in WORDS:
        raise DataFormatError(f"mirror is yes or no, got {mirror!r}", path, line)
    files = [path.parent / words[kind] for kind in ("layout", "mesh", "anchors")]
    return BatchRow(name, files[0], files[1], files[2], unit, sigma, WORDS[mirror])


def batch_tasks(
    rows: Iterable[BatchRow],
    *,
    seed: int,
    formats: Sequence[str],
    accept: bool,
    effort: Effort = FULL,
) -> Iterator[RowTask]:
    """Tasks of the rows, each read when a worker is free for it."""
    for row in rows:
        try:
            evidence: PatchTask | str = row.load(effort)
        except SkinError as error:
            evidence = str(error)
        yield RowTask(row.name, evidence, seed, tuple(formats), accept)


def calibrate_patch(task: RowTask) -> dict[str, Any]:
    """What `calibrate wrap` prints of a patch, and its files; why not, where it cannot be done."""
    if isinstance(task.evidence, str):
        return _failed(task.name, task.evidence)
    try:
        found, seconds = task.evidence.solve(task.seed)
        with tempfile.TemporaryDirectory(prefix="skinmap-") as name:
            stage = Path(name)
            result = task.evidence.write(
                stage, found, seconds, formats=task.formats, accept=task.accept
            )
            data = {file: (stage / file).read_bytes() for file in result["files"]}
    except SkinError as error:
        return _failed(task.name, str(error))
    return {"result": {"patch": task.name, **result}, "data": data}


def _failed(name: str, reason: str) -> dict[str, Any]:
    result = {"patch": name, "status": FAILED, "reasons": [reason], "files": []}
    return {"result": result, "data": {}}


def calibrate_batch(
    tasks: Iterable[RowTask],
    stage: Path,
    *,
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> list[dict[str, Any]]:
    """Calibrate patches and write the files of each into a folder of its name, as they come.

    Returns
    -------
    list of dict
        For each task what `calibrate wrap` prints, with `patch`, its name; a patch that cannot be
        calibrated has the `status` "failed" and why among its `reasons`.
    """
    found: dict[int, dict[str, Any]] = {}
    results = each_result(calibrate_patch, tasks, workers=workers, progress=progress)
    with closing(results):
        for place, one in results:
            result = one["result"]
            for file, data in one["data"].items():
                target = stage / result["patch"] / file
                target.parent.mkdir(exist_ok=True)
                target.write_bytes(data)
            folder = result["patch"]
            found[place] = {**result, "files": [f"{folder}/{file}" for file in result["files"]]}
    return [found[place] for place in sorted(found)]
