"""`skinmap evaluate --protocol fingers DATA`: real fingers counted, with a control beside.

`skinmap evaluate --protocol hands DATA`: hands that grasp a skin, as images and as contacts.

`skinmap evaluate --protocol prints TRAIN.npz TEST.npz`: areas of contacts on a grid.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from skinmap.archive import open_arrays
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.cli.evaluate.command import Evaluation, Own, Rows, Settings, write_predictions
from skinmap.commands.progress import progress
from skinmap.errors import DataFormatError, InvalidArrayError, SkinError
from skinmap.io.recordings.cyskin_arrays import PressedSkin, find_pressed, read_pressed
from skinmap.io.text import check_file
from skinmap.live.contacts.contact_tracker import ContactTracker
from skinmap.live.robot_skin import JoinedSkin
from skinmap.recognition.protocols import fingers as protocol
from skinmap.recognition.protocols.prints import (
    Answers,
    Prints,
    find_spots,
    fit_areas,
    match_prints,
)
from skinmap.recognition.protocols.results import CountRow, FingersResult, HandsResult, PrintsResult
from skinmap.report.table import Table
from skinmap.rows import percent
from skinmap.touch.contacts.rest import felt, find_rest
from skinmap.touch.contacts.skin_geometry import ACTIVE, connected
from skinmap.touch.prepared_skin import PreparedSkin

ARCHIVE, FOLDER = "fingers*.npz", "gesture_patch"


def pressed_skin(
    settings: Settings, archive: str, folder: str
) -> tuple[PressedSkin, PreparedSkin, dict[str, Any]]:
    """A recorded real skin, prepared, and what a result says of it.

    Raises
    ------
    SkinError
        A folder without the files, or files that are damaged or of another skin.
    """
    arrays, patch = find_pressed(settings.recordings[0], archive, folder)
    data = read_pressed(arrays, patch)
    skin = PreparedSkin(data.skin)
    facts = {
        "robot": data.skin.part, "taxels": len(skin), "archive": str(arrays), "patch": str(patch),
        "unplaced": data.unplaced, "unrecorded": data.unrecorded,
    }  # fmt: skip
    return data, skin, facts


def judge_fingers(settings: Settings) -> FingersResult:
    """Run the protocol.

    Raises
    ------
    SkinError
        A folder without the files, files that are damaged or of another skin, or recordings that
        cannot be judged.
    """
    data, skin, facts = pressed_skin(settings, ARCHIVE, FOLDER)
    classes = protocol.check_fingers(finger_counts(data, facts["archive"]))
    regions, numbers, counted = None, [], []
    with progress(2 * (2 + settings.seeds), "fingers") as advance:
        for first in (None, protocol.FIRST):
            found = protocol.describe(skin, data.files, first=first)
            # The control's places are those of the touches: the same recordings are left out.
            regions = protocol.places(found) if regions is None else regions
            advance("described")
            number, names = protocol.chosen_number(found, classes, settings.all_seeds)
            numbers.append(names)
            trees = protocol.trained(found, classes, regions, settings.all_seeds, advance)
            every = np.ones(len(classes), bool)
            seen = [tracked(skin, data, first=first)]
            contacts = protocol.judge("live contacts", seen, [every], classes)
            advance("tracked")
            counted.append((contacts, number, trees))
    live, chosen, trained = (_row(*pair) for pair in zip(*counted, strict=True))
    return FingersResult(
        **facts,
        recordings={str(k): int((classes == k).sum()) for k in np.unique(classes).tolist()},
        majority=float(np.unique(classes, return_counts=True)[1].max() / len(classes)),
        seeds=settings.all_seeds,
        first_samples=protocol.FIRST,
        live=live,
        chosen=chosen,
        chosen_numbers=numbers[0],
        trained=trained,
    )


def finger_counts(data: PressedSkin, path: str) -> IntArray:
    """(f,) fingers of each recording.

    Raises
    ------
    DataFormatError
        The archive does not say.
    """
    if data.classes is None:
        raise DataFormatError("no array 'file_class' (fingers that touched in each file)", path)
    return data.classes


def tracked(skin: PreparedSkin, data: PressedSkin, *, first: int | None = None) -> IntArray:
    """(f,) contacts of the live tracker in the heaviest sample of each recording."""
    joined = JoinedSkin({data.skin.part: skin})
    counts = []
    for times, pressures in zip(data.times, data.files, strict=True):
        samples = felt(pressures, find_rest(pressures), skin.geometry.beside)[:first]
        tracker = ContactTracker(joined)
        seen = []
        for time, sample in zip(times.tolist(), samples.astype(np.float64), strict=False):
            tracker.update(time, sample)
            seen.append(len(tracker.present))
        counts.append(seen[int(samples.sum(axis=1, dtype=np.int64).argmax())])
    return np.array(counts)


def _row(found: CountRow, control: CountRow) -> CountRow:
    return replace(found, control=control.exact, control_within_one=control.within_one)


def fingers_lines(result: FingersResult) -> Iterator[str | Table]:
    """The tables of a result."""
    total = sum(result.recordings.values())
    told = ", ".join(f"{count} of {number}" for number, count in result.recordings.items())
    yield (
        f"{result.robot}, {result.taxels} taxels: {total} recordings of real fingers ({told}); "
        f"each taxel's own rest taken away; in %, majority {percent(result.majority)}"
    )
    if result.unplaced or result.unrecorded:
        yield (
            f"{result.unplaced} channels have no place, {result.unrecorded} taxels no channel: "
            "left out"
        )
    yield Table.of(
        CountRow,
        [result.live, result.chosen, result.trained],
        "method=fingers_counted_by exact:% within_one:% spread:%=std control:% "
        "control_within_one:%=within_one",
    )
    yield f"control: the same on the first {result.first_samples} samples of each recording"


HANDS = ("hands*.npz", "handles")
GRASP = 30  # active taxels of a hand that grasps
QUIET = 3  # and of an untouched skin, at most


def judge_hands(settings: Settings) -> HandsResult:
    """Run the protocol.

    Raises
    ------
    SkinError
        A folder without the files, files that are damaged or of another skin, or no grasp.
    """
    data, skin, facts = pressed_skin(settings, *HANDS)
    with progress(2, "hands") as advance:
        active, contacts, single, pieces = follow(skin, data).T
        advance("contacts")
        grasp = active > GRASP
        if not grasp.any():
            raise InvalidArrayError(
                f"no sample with more than {GRASP} active taxels: the skin is not grasped"
            )
        flat = skin.flat
        advance("flat map")
    low, high = np.percentile(contacts[grasp], [25, 75]).tolist()
    quiet = active <= QUIET
    return HandsResult(
        **facts,
        flips=flat.flips,
        edge_error_percent=100.0 * max(c.distortion.edge_rms for c in flat.charts),
        samples=len(active),
        grasping=int(grasp.sum()),
        contacts_median=float(np.median(contacts[grasp])),
        contacts_quartiles=[low, high],
        pieces_median=float(np.median(pieces[grasp])),
        single_taxels=float(single[grasp].mean()),
        quiet_contacts=float(contacts[quiet].mean()) if quiet.any() else None,
    )


def follow(skin: PreparedSkin, data: PressedSkin) -> IntArray:
    """Follow the contacts through all files of a recording, t samples.

    Returns
    -------
    (t, 4) int
        Active taxels; contacts of the live tracker; those of one taxel; connected active taxels,
        specks and all.
    """
    joined, rows = JoinedSkin({data.skin.part: skin}), []
    for times, pressures in zip(data.times, data.files, strict=True):
        tracker = ContactTracker(joined)
        for time, sample in zip(times.tolist(), pressures.astype(np.float64), strict=True):
            tracker.update(time, sample)
            active = sample > ACTIVE
            index = np.flatnonzero(active)
            pieces = connected(skin.geometry.links, active, index).max(initial=-1) + 1
            sizes = [len(track.taxels) for track in tracker.present]
            rows.append((len(index), len(sizes), sizes.count(1), int(pieces)))
    return np.array(rows, np.int64)


def hands_lines(result: HandsResult) -> Iterator[str | Table]:
    """The tables of a result."""
    low, high = result.contacts_quartiles
    quiet = "none" if result.quiet_contacts is None else f"{result.quiet_contacts:.2f}"
    yield (
        f"{result.robot}, {result.taxels} taxels: {result.grasping} of {result.samples} samples "
        "of real hands grasp it"
    )
    rows: Rows = [
        ["contacts of the live tracker, median", f"{result.contacts_median:g}"],
        ["quartiles", f"{low:g} to {high:g}"],
        ["connected active taxels, specks and all, median", f"{result.pieces_median:g}"],
        ["contacts of a single taxel, mean", f"{result.single_taxels:.2f}"],
        ["control: contacts of the untouched skin, mean", quiet],
        ["flipped triangles of the flat map", result.flips],
        ["its edge error [%]", f"{result.edge_error_percent:.2f}"],
    ]
    yield Table(["of a grasping hand", ""], rows)


OWN = 10  # prints of a person that set this person's scale


class Pitch(Own):
    """Distance of neighbouring readings; that of a screen of 345 mm with 72 columns by default."""

    pitch_mm: Annotated[float, Meta(gt=0.0, le=100.0)] = 345.0 / 72.0


class Grid(NamedTuple):
    """One file: `readings (t, rows, columns)`, and where they are there `prints` and `person`."""

    path: Path
    readings: NDArray[Any]
    prints: NDArray[np.uint8] | None
    person: IntArray | None

    def pictures(self) -> Iterator[NDArray[np.uint8]]:
        """Each print, unpacked."""
        assert self.prints is not None
        return (np.unpackbits(one, axis=1) for one in self.prints)


def read_grid(path: Path) -> Grid:
    """Read an archive of readings.

    Raises
    ------
    DataFormatError
        Arrays of other shapes or types, or that do not fit together.
    """
    check_file(path, "an archive of readings (.npz)", 2**32)
    with open_arrays(path, "an archive of arrays") as found:
        held = {name: found[name] for name in Grid._fields if name in found.files}
        there = ", ".join(sorted(found.files)) or "none"
    if "readings" not in held:
        raise DataFormatError(f"no array 'readings'; its arrays: {there}", path)
    readings, prints, person = held["readings"], held.get("prints"), held.get("person")
    _check_numbers(path, "readings", readings, 3)
    count, rows, columns = readings.shape
    if not (count and rows > 1 and columns > 1):
        raise DataFormatError(f"readings of shape {readings.shape}: no images", path)
    if prints is not None:
        _, high, wide = prints.shape if prints.ndim == 3 else (0, 0, 0)
        fine = high // rows
        fits = len(prints) == count and (high, 8 * wide) == (fine * rows, fine * columns)
        if not (fine and fits) or prints.dtype != np.uint8:
            raise DataFormatError(
                f"prints of shape {prints.shape} and type {prints.dtype} for readings of shape "
                f"{readings.shape}: expected uint8 ({count}, {rows} x f, {columns} x f / 8) "
                "packed bits",
                path,
            )
    if person is not None:
        if person.dtype.kind == "U":  # names
            person = np.unique(person, return_inverse=True)[1]
        _check_numbers(path, "person", person, 1)
        if len(person) != count:
            raise DataFormatError(f"person of {len(person)} for {count} images", path)
    return Grid(path, readings, prints, person)


def _check_numbers(path: Path, name: str, array: NDArray[Any], ndim: int) -> None:
    if array.ndim != ndim or array.dtype.kind not in "buif" or not np.isfinite(array).all():
        raise DataFormatError(
            f"{name} of shape {array.shape} and type {array.dtype}: expected finite numbers "
            f"in {ndim} dimensions",
            path,
        )


def judge_prints(settings: Settings) -> PrintsResult:
    """Run the protocol.

    Raises
    ------
    SkinError
        A file that is missing, damaged, without prints to train on, or with too few people.
    """
    train, test = map(read_grid, settings.recordings)
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
        **judged_prints(answers, truth, person),
    )


def judged_prints(
    answers: Answers, truth: Prints | None, person: IntArray | None
) -> dict[str, Any]:
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


def prints_lines(result: PrintsResult) -> Iterator[str | Table]:
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
        ["prints without a contact of 5 readings above 60", result.missed],
        ["error of the area, median [%]", percent(result.area_error_median)],
        ["90th percentile [%]", percent(result.area_error_p90)],
        [f"median with {OWN} prints of the same person [%]", percent(own)],
        ["error of the centre, median [mm]", f"{result.centre_mm_median:.2f}"],
        ["areas inside their interval of 90 % [%]", percent(result.holds)],
        ["upper end through lower end, median", f"{result.high_to_low:.2f}"],
    ]
    yield Table(["prints", ""], rows)


EVALUATIONS = {
    "fingers": Evaluation(judge_fingers, fingers_lines),
    "hands": Evaluation(judge_hands, hands_lines),
    "prints": Evaluation(judge_prints, prints_lines, Pitch),
}
