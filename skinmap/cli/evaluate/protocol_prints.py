"""`skinmap evaluate --protocol prints TRAIN.npz TEST.npz`: areas of contacts on a grid."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.cli.evaluate.command import Evaluation, Own, Rows, Settings, write_predictions
from skinmap.commands.progress import progress
from skinmap.errors import DAMAGED_ARCHIVE, DataFormatError, SkinError
from skinmap.recognition.protocols.results import PrintsResult
from skinmap.report.table import Table
from skinmap.rows import percent

if TYPE_CHECKING:
    from skinmap.recognition.protocols.prints import Answers, Prints

OWN = 10  # prints of a person that set this person's scale


class Pitch(Own):
    """Distance of neighbouring readings; that of a screen of 345 mm with 72 columns by default."""

    pitch_mm: Annotated[float, Meta(gt=0.0, le=100.0)] = 345.0 / 72.0


class Grid:
    """One file: `readings (t, rows, columns)`, and where they are there `prints` and `person`."""

    def __init__(self, path: Path) -> None:
        from skinmap.archive import open_arrays
        from skinmap.io.text import check_file

        check_file(path, "an archive of readings (.npz)", 2**32)
        try:
            with open_arrays(path) as found:
                names = ("readings", "prints", "person")
                held = {name: found[name] for name in names if name in found.files}
                there = ", ".join(sorted(found.files)) or "none"
        except DAMAGED_ARCHIVE as error:
            raise DataFormatError(f"not an archive of arrays: {str(error)[:200]}", path) from None
        if "readings" not in held:
            raise DataFormatError(f"no array 'readings'; its arrays: {there}", path)
        self.path, self._held = path, held
        self.readings = self._numbers("readings", 3)
        count, rows, columns = self.readings.shape
        if not (count and rows > 1 and columns > 1):
            raise DataFormatError(f"readings of shape {self.readings.shape}: no images", path)
        self.prints = held.get("prints")
        if self.prints is not None:
            self._check_prints(rows, columns)
        self.person: IntArray | None = None
        if "person" in held:
            self.person = self._numbers("person", 1)
            if len(self.person) != count:
                raise DataFormatError(f"person of {len(self.person)} for {count} images", path)

    def _numbers(self, name: str, ndim: int) -> NDArray[Any]:
        array = self._held[name]
        if array.ndim != ndim or array.dtype.kind not in "buif" or not np.isfinite(array).all():
            raise DataFormatError(
                f"{name} of shape {array.shape} and type {array.dtype}: expected finite numbers "
                f"in {ndim} dimensions",
                self.path,
            )
        return array

    def _check_prints(self, rows: int, columns: int) -> None:
        assert self.prints is not None
        shape, count = self.prints.shape, len(self.readings)
        if self.prints.dtype == np.uint8 and len(shape) == 3 and shape[0] == count:
            fine = shape[1] // rows
            if fine and shape[1] == fine * rows and 8 * shape[2] == fine * columns:
                return
        raise DataFormatError(
            f"prints of shape {shape} and type {self.prints.dtype} for readings of shape "
            f"{self.readings.shape}: expected uint8 ({count}, {rows} x f, {columns} x f / 8) "
            "packed bits",
            self.path,
        )

    def pictures(self) -> Iterator[NDArray[np.uint8]]:
        """Each print, unpacked."""
        assert self.prints is not None
        return (np.unpackbits(one, axis=1) for one in self.prints)


def work(settings: Settings) -> PrintsResult:
    """Run the protocol.

    Raises
    ------
    SkinError
        A file that is missing, damaged, without prints to train on, or with too few people.
    """
    from skinmap.recognition.protocols.prints import find_spots, fit_areas, match_prints

    train, test = (Grid(path) for path in settings.recordings)
    for name in ("prints", "person"):
        if getattr(train, name) is None:
            raise DataFormatError(f"no array {name!r} to train on", train.path)
    pitch = settings.own.pitch_mm
    with progress(3, "prints") as advance:
        spots = find_spots(train.readings, pitch_mm=pitch)
        assert train.person is not None
        people = train.person[spots.image]
        try:
            model = fit_areas(spots, match_prints(spots, train.pictures(), pitch_mm=pitch), people)
        except SkinError as error:
            raise DataFormatError(str(error), train.path) from None
        advance("trained")
        found = find_spots(test.readings, pitch_mm=pitch)
        answers = model.answer(found)
        advance("answered")
        truth = None
        if test.prints is not None:
            truth = match_prints(found, test.pictures(), pitch_mm=pitch)
        advance("judged")
    if settings.predictions is not None:
        write_predictions(settings.predictions, {"image": found.image, **answers._asdict()})
    person = None if test.person is None else test.person[found.image]
    return PrintsResult(
        robot="grid of {} x {} readings".format(*test.readings.shape[1:]),
        train=str(train.path),
        test=str(test.path),
        people=len(np.unique(train.person)),
        images=len(test.readings),
        contacts=len(found.image),
        **judge(answers, truth, person),
    )


def judge(answers: Answers, truth: Prints | None, person: IntArray | None) -> dict[str, Any]:
    """Fields of the result that need prints; null where there are none."""
    if truth is None or not (known := truth.area_mm2 > 0).any():
        names = ("area_error_median", "area_error_p90", "centre_mm_median", "holds", "high_to_low")
        return {
            **dict.fromkeys((*names, "own_area_error_median")),
            "judged": 0,
            "missed": 0 if truth is None else truth.missed,
        }
    area, true = answers.area_mm2[known], truth.area_mm2[known]
    away = np.hypot(*(answers.centre_mm[known] - truth.centre_mm[known]).T)
    error = np.abs(area / true - 1.0)
    inside = (answers.low[known] <= true) & (true <= answers.high[known])
    return {
        "judged": int(known.sum()),
        "missed": truth.missed,
        "area_error_median": float(np.median(error)),
        "area_error_p90": float(np.quantile(error, 0.9)),
        "centre_mm_median": float(np.median(away)),
        "holds": float(inside.mean()),
        "high_to_low": float(np.median(answers.high[known] / answers.low[known])),
        "own_area_error_median": None if person is None else _own(area, true, person[known]),
    }


def _own(area: FloatArray, true: FloatArray, person: IntArray) -> float | None:
    """Error of the area where ten prints of each person set this person's scale."""
    errors = []
    for one in np.unique(person):
        rows = np.flatnonzero(person == one)
        first: BoolArray = np.zeros(len(rows), bool)
        # Spread over all of the person's: a scale of one minute is not that of another.
        first[np.linspace(0, len(rows) - 1, OWN).astype(int)] = True
        scale = np.median(true[rows[first]] / area[rows[first]])
        errors.append(np.abs(scale * area[rows[~first]] / true[rows[~first]] - 1.0))
    together = np.concatenate(errors)
    return float(np.median(together)) if len(together) else None


def lines(result: PrintsResult) -> Iterator[str | Table]:
    """The tables of a result."""
    yield (
        f"{result.robot}: {result.contacts} contacts in {result.images} images, found in the "
        f"readings alone; areas learnt from prints of {result.people} other people"
    )
    if result.area_error_median is None:
        yield "no prints to judge by"
        return
    own = result.own_area_error_median
    rows: Rows = [
        ["contacts with a print", result.judged],
        ["prints without a contact", result.missed],
        ["error of the area, median [%]", percent(result.area_error_median)],
        ["90th percentile [%]", percent(result.area_error_p90)],
        [f"median with {OWN} prints of the same person [%]", percent(own)],
        ["error of the centre, median [mm]", f"{result.centre_mm_median:.2f}"],
        ["areas inside their interval of 90 % [%]", percent(result.holds)],
        ["upper end through lower end, median", f"{result.high_to_low:.2f}"],
    ]
    yield Table(["prints", ""], rows)


EVALUATIONS = {"prints": Evaluation(work, lines, Pitch)}
