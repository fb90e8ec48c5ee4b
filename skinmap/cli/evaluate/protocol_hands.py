"""`skinmap evaluate --protocol hands DATA`: hands that grasp a skin, as images and as contacts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from skinmap.arrays import IntArray
from skinmap.cli.evaluate.evaluation import Rows, Settings, pressed_skin
from skinmap.commands.progress import progress
from skinmap.errors import InvalidArrayError
from skinmap.recognition.protocols.results import HandsResult
from skinmap.report.table import Table

if TYPE_CHECKING:
    from skinmap.io.recordings.cyskin_arrays import PressedSkin
    from skinmap.touch.prepared_skin import PreparedSkin

ARCHIVE, FOLDER = "hands*.npz", "handles"
GRASP = 30  # active taxels of a hand that grasps
QUIET = 3  # and of an untouched skin, at most


def work(settings: Settings) -> HandsResult:
    """Run the protocol.

    Raises
    ------
    SkinError
        A folder without the files, files that are damaged or of another skin, or no grasp.
    """
    data, skin, facts = pressed_skin(settings, ARCHIVE, FOLDER)
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


def lines(result: HandsResult) -> Iterator[str | Table]:
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
