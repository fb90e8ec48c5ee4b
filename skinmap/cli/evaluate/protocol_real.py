"""`skinmap evaluate --protocol fingers DATA`: real fingers counted, with a control beside.

`skinmap evaluate --protocol hands DATA`: hands that grasp a skin, as images and as contacts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from skinmap.arrays import IntArray
from skinmap.cli.evaluate.command import Evaluation, Rows, Settings
from skinmap.commands.progress import progress
from skinmap.errors import InvalidArrayError
from skinmap.recognition.protocols.results import CountRow, FingersResult, HandsResult
from skinmap.report.table import Table
from skinmap.rows import percent

if TYPE_CHECKING:
    from skinmap.io.recordings.cyskin_arrays import PressedSkin
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
    from skinmap.io.recordings.cyskin_arrays import find_pressed, read_pressed
    from skinmap.touch.prepared_skin import PreparedSkin

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
    from skinmap.live.contacts.contact_tracker import ContactTracker
    from skinmap.live.robot_skin import JoinedSkin
    from skinmap.touch.contacts.skin_geometry import ACTIVE, connected

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


EVALUATIONS = {
    "fingers": Evaluation(judge_fingers, fingers_lines),
    "hands": Evaluation(judge_hands, hands_lines),
}
