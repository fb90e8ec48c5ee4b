"""`skinmap evaluate --protocol fingers DATA`: real fingers counted, with a control beside."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skinmap.arrays import IntArray
from skinmap.cli.evaluate.evaluation import Settings, pressed_skin
from skinmap.commands.progress import progress
from skinmap.recognition.protocols.results import CountRow, FingersResult
from skinmap.report.table import Table
from skinmap.rows import percent

if TYPE_CHECKING:
    from skinmap.io.recordings.cyskin_arrays import PressedSkin
    from skinmap.touch.prepared_skin import PreparedSkin

ARCHIVE, FOLDER = "fingers*.npz", "gesture_patch"


def work(settings: Settings) -> FingersResult:
    """Run the protocol.

    Raises
    ------
    SkinError
        A folder without the files, files that are damaged or of another skin, or recordings that
        cannot be judged.
    """
    from skinmap.recognition.protocols import fingers as protocol

    data, skin, facts = pressed_skin(settings, ARCHIVE, FOLDER)
    classes = protocol.check_fingers(finger_counts(data, facts["archive"]))
    pairs: dict[str, list[CountRow]] = {"live": [], "chosen": [], "trained": []}
    regions, numbers = None, []
    with progress(2 * (2 + settings.seeds * protocol.REGIONS), "fingers") as advance:
        for first in (None, protocol.FIRST):
            found = protocol.describe(skin, data.files, first=first)
            # The control's places are those of the touches: the same recordings are left out.
            regions = protocol.places(found) if regions is None else regions
            advance("described")
            number, names = protocol.chosen_number(found, classes, settings.all_seeds)
            numbers.append(names)
            trees = protocol.trained(found, classes, regions, settings.all_seeds, advance)
            every = np.ones(len(classes), bool)
            live = [tracked(skin, data, first=first)]
            contacts = protocol.judge("live contacts", live, [every], classes)
            advance("tracked")
            for key, one in zip(pairs, (contacts, number, trees), strict=True):
                pairs[key].append(one)
    return FingersResult(
        **facts,
        recordings={str(k): int((classes == k).sum()) for k in np.unique(classes).tolist()},
        majority=float(np.unique(classes, return_counts=True)[1].max() / len(classes)),
        seeds=settings.all_seeds,
        first_samples=protocol.FIRST,
        live=_row(*pairs["live"]),
        chosen=_row(*pairs["chosen"]),
        chosen_numbers=numbers[0],
        trained=_row(*pairs["trained"]),
    )


def finger_counts(data: PressedSkin, path: str) -> IntArray:
    """(f,) fingers of each recording.

    Raises
    ------
    DataFormatError
        The archive does not say.
    """
    from skinmap.errors import DataFormatError

    if data.classes is None:
        raise DataFormatError("no array 'file_class' (fingers that touched in each file)", path)
    return data.classes


def tracked(skin: PreparedSkin, data: PressedSkin, *, first: int | None = None) -> IntArray:
    """(f,) contacts of the live tracker in the heaviest sample of each recording."""
    from skinmap.live.contacts.contact_tracker import ContactTracker
    from skinmap.live.robot_skin import JoinedSkin
    from skinmap.touch.contacts.rest import felt, find_rest

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


def lines(result: FingersResult) -> Iterator[str | Table]:
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
