"""`skinmap calibrate batch`: many flat boards on their links, each as `calibrate wrap` does it."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

import click
import msgspec

from calibration.commands.calibration_options import FILE, Outputs, PatchFiles, outputs
from calibration.commands.results import Grade, PatchResult
from skinmap.commands.options import WorkerOptions, prints, workers_options
from skinmap.commands.progress import progress
from skinmap.errors import DataFormatError, SkinError, unknown_name
from skinmap.io.text import UNITS
from skinmap.report.present import drop_refusal, present
from skinmap.report.result import MERGED, OK, Verdict
from skinmap.report.table import Table

if TYPE_CHECKING:
    from calibration.commands.patch_task import PatchTask

FAILED: Literal["failed"] = "failed"
NEEDED, KNOWN = ("name", "layout", "mesh", "anchors"), ("units", "mirror")


@dataclass(frozen=True, kw_only=True, slots=True)
class BatchPatch:
    """A patch of the table: what `calibrate wrap` prints of it, or why it cannot be calibrated.

    Attributes
    ----------
    patch
        Name of the patch.
    status
        As of `calibrate wrap`, or `failed`.
    reasons
        Why, the most telling first.
    files
        Names of the files inside `--out`.
    found
        What else `calibrate wrap` prints, where it did not fail.
    """

    patch: str
    status: Literal[Grade, "failed"]
    reasons: list[str]
    files: list[str] = field(default_factory=list)
    found: PatchResult | msgspec.UnsetType = field(default=msgspec.UNSET, metadata=MERGED)


@dataclass(frozen=True, kw_only=True, slots=True)
class BatchResult:
    """Many boards laid on their links.

    Attributes
    ----------
    statuses
        Number of patches by status.
    patches
        One a row of the table.
    """

    statuses: dict[str, int]
    patches: list[BatchPatch]


@click.command("batch")
@click.argument("table_file", metavar="TABLE", type=FILE)
@outputs(
    "a folder with taxels.csv and report.html for each patch",
    required=True,
    accept="Write taxels and exit 0 whatever the status.",
)
@workers_options(resume=False)
@prints(BatchResult)
def batch(
    table_file: Path,
    output: Outputs,
    spread: WorkerOptions,
) -> None:
    """Lay many boards on their links, each as `calibrate wrap` does.

    TABLE is a CSV `name,layout,mesh,anchors[,units,mirror]`, a row for each patch, with
    files as seen from its folder. A patch that cannot be calibrated does not stop the others: it is
    listed as failed, with the reason. The exit code is 3 where not all patches are ok.

    \b
    Example:  skinmap calibrate batch patches.csv --jobs 4 -o patches
    """
    from skinmap.io.output import check_folder, staged_folder
    from skinmap.parallel.run import each_result

    rows, found, out = read_batch(table_file), {}, cast("Path", output.out)
    check_folder(out)
    with (
        spread.open("calibrate batch") as workers,
        progress(len(rows), "calibrate") as advance,
        closing(each_result(_calibrated, _tasks(rows, output.accept),
                            workers=workers, progress=advance)) as results,
    ):  # fmt: skip
        for place, (patch, files) in results:  # as they come: an interruption keeps what is done
            found[place] = patch
            if files:
                with staged_folder(out / patch.patch) as stage:
                    for name, data in files.items():
                        (stage / name).write_bytes(data)
                drop_refusal(out / patch.patch, files)
    patches = [found[place] for place in sorted(found)]
    result = BatchResult(statuses=Counter(patch.status for patch in patches), patches=patches)
    bad = set(result.statuses) - {OK}
    verdict = Verdict("failed" if bad else OK, accepted=output.accept and FAILED not in bad)
    present(result, batch_lines, as_json=output.as_json, verdict=verdict)


def batch_lines(result: BatchResult) -> Iterator[Table | str]:
    """What people read of a batch."""
    rows = []
    for one in result.patches:
        taxels, sd = 0, None
        if not isinstance(one.found, msgspec.UnsetType):
            taxels, sd = one.found.taxels, one.found.predicted_sd_mm.median
        rows.append((one.patch, one.status, taxels, sd))
    yield Table(("patch", "status", "taxels", "predicted error mm"), rows)
    yield from (f"{one.patch}: {'; '.join(one.reasons)}" for one in result.patches if one.reasons)


def read_batch(path: Path) -> dict[str, PatchFiles]:
    """The patches of a table `name,layout,mesh,anchors[,units,mirror]`, by name.

    Files are looked for from the table's folder.

    Raises
    ------
    DataFormatError
        A missing or unknown column, a name twice or that is no name of a folder, a word that is
        no number (names the line).
    """
    from calibration.files.tables import read_cells

    names, rows = read_cells(path, NEEDED, KNOWN)
    found: dict[str, PatchFiles] = {}
    for line, cells in rows:
        words = {name: cell.strip() for name, cell in zip(names, cells, strict=True)}
        name = words["name"]
        if not name or name.startswith(".") or {*name} & set("/\\\0"):
            raise DataFormatError(f"{name!r} cannot name a folder", path, line)
        if name in found:
            raise DataFormatError(f"the patch {name!r} comes more than once", path, line)
        found[name] = _patch_files(words, path, line)
    return found


def _patch_files(words: Mapping[str, str], path: Path, line: int) -> PatchFiles:
    """A row of the table; what it leaves empty is in metres, and drawn from the front."""
    unit, mirror = words.get("units") or "m", words.get("mirror") or "no"
    if unit not in UNITS:
        raise DataFormatError(unknown_name("unit", unit, UNITS), path, line)
    if mirror not in ("yes", "no"):
        raise DataFormatError(f"mirror is yes or no, got {mirror!r}", path, line)
    layout, mesh, anchors = (path.parent / words[kind] for kind in ("layout", "mesh", "anchors"))
    return PatchFiles(layout=layout, mesh=mesh, anchors=anchors, units=unit, mirror=mirror == "yes")


@dataclass(frozen=True, eq=False, slots=True)
class BatchTask:
    """What a worker needs of a patch; why it cannot be read stands in place of its evidence."""

    name: str
    evidence: PatchTask | str
    accept: bool


def _tasks(rows: Mapping[str, PatchFiles], accept: bool) -> Iterator[BatchTask]:
    """Tasks of the rows, each read when a worker is free for it."""
    from calibration.commands.patch_task import PatchTask

    for name, files in rows.items():
        try:
            evidence: PatchTask | str = PatchTask.load(files)
        except SkinError as error:
            evidence = str(error)
        yield BatchTask(name, evidence, accept)


def _calibrated(task: BatchTask) -> tuple[BatchPatch, dict[str, bytes]]:
    """A patch, and its files by their names inside `--out`."""
    try:
        if isinstance(task.evidence, str):
            raise SkinError(task.evidence)
        with tempfile.TemporaryDirectory(prefix="skinmap-") as name:
            found = task.evidence.solve().save(Path(name), accept=task.accept)
            data = {one: (Path(name) / one).read_bytes() for one in found.files}
    except SkinError as error:
        return BatchPatch(patch=task.name, status=FAILED, reasons=[str(error)]), {}
    found = replace(found, files=[f"{task.name}/{one}" for one in data])
    patch = BatchPatch(
        patch=task.name, status=found.status, reasons=found.reasons, files=found.files, found=found
    )
    return patch, data
