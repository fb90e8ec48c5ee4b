"""`skinmap evaluate --protocol hands DATA`: hands that grasp a skin, as images and as contacts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, IntArray
from skinmap.cli.evaluate.evaluation import (
    BLUE,
    ORANGE,
    Figure,
    Rows,
    Settings,
    percent,
)
from skinmap.cli.evaluate.result.real_skin import HandRow, HandsResult
from skinmap.commands.progress import progress
from skinmap.errors import InvalidArrayError, MissingLibraryError, UnknownNameError
from skinmap.report.figure import plain_figure, save_figure
from skinmap.report.table import Table

if TYPE_CHECKING:
    from skinmap.io.recordings.cyskin_arrays import PressedSkin
    from skinmap.touch.prepared_skin import PreparedSkin

ARCHIVE, FOLDER = "hands*.npz", "handles"
GRASP = 30  # active taxels of a hand that grasps
QUIET = 3  # and of an untouched skin, at most
SHOWN = 8  # samples in the picture
CONTACTS = (
    BLUE, ORANGE, "#2f8f6b", "#a83b5e", "#7a5ea8", "#b8a32e", "#3ba0a8", "#6b4a2b", "#5a6470",
)  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Seen:
    """What the live tracker says of a recording, sample by sample.

    Attributes
    ----------
    active : (t,) int
        Active taxels.
    contacts, single, pieces : (t,) int
        Contacts, those of one taxel, and connected active taxels, specks and all.
    owners : (t, n) int
        Contact of each taxel, -1 for none.
    """

    active: IntArray
    contacts: IntArray
    single: IntArray
    pieces: IntArray
    owners: NDArray[np.int16]


def work(settings: Settings) -> HandsResult:
    """Run the protocol.

    Raises
    ------
    SkinError
        A folder without the files, files that are damaged or of another skin, or no grasp.
    """
    from skinmap.io.recordings.cyskin_arrays import find_pressed, read_pressed
    from skinmap.touch.prepared_skin import PreparedSkin

    arrays, patch = find_pressed(settings.recordings[0], ARCHIVE, FOLDER)
    data = read_pressed(arrays, patch)
    skin = PreparedSkin(data.skin)
    with progress(3, "hands") as advance:
        seen = follow(skin, data)
        advance("contacts")
        grasp = seen.active > GRASP
        if not grasp.any():
            raise InvalidArrayError(
                f"no sample with more than {GRASP} active taxels: the skin is not grasped"
            )
        flat = skin.flat
        advance("flat map")
        rows, skipped = hand_or_not(skin, data, settings)
        advance("images")
    low, high = np.percentile(seen.contacts[grasp], [25, 75]).tolist()
    quiet = seen.active <= QUIET
    return HandsResult(
        robot=data.skin.part,
        taxels=len(skin),
        archive=str(arrays),
        patch=str(patch),
        unplaced=data.unplaced,
        unrecorded=data.unrecorded,
        flips=flat.flips,
        edge_error_percent=100.0 * max(c.distortion.edge_rms for c in flat.charts),
        samples=len(seen.active),
        grasping=int(grasp.sum()),
        contacts_median=float(np.median(seen.contacts[grasp])),
        contacts_quartiles=[low, high],
        pieces_median=float(np.median(seen.pieces[grasp])),
        single_taxels=float(seen.single[grasp].mean()),
        quiet_contacts=float(seen.contacts[quiet].mean()) if quiet.any() else None,
        hand_or_not=rows,
        skipped=skipped,
    )


def follow(skin: PreparedSkin, data: PressedSkin) -> Seen:
    """Follow the contacts through all files of a recording."""
    from skinmap.live.contacts.contact_tracker import ContactTracker
    from skinmap.live.robot_skin import JoinedSkin
    from skinmap.touch.contacts import ACTIVE, connected

    joined, rows, owners = JoinedSkin({data.skin.part: skin}), [], []
    for times, pressures in zip(data.times, data.files, strict=True):
        tracker = ContactTracker(joined)
        for time, sample in zip(times.tolist(), pressures.astype(np.float64), strict=True):
            tracker.update(time, sample)
            active = sample > ACTIVE
            index = np.flatnonzero(active)
            pieces = connected(skin.geometry.links, active, index).max(initial=-1) + 1
            sizes = [len(track.taxels) for track in tracker.present]
            rows.append((len(index), len(sizes), sizes.count(1), int(pieces)))
            owner = np.full(len(skin), -1, np.int16)
            for number, track in enumerate(tracker.present):
                owner[track.taxels] = number
            owners.append(owner)
    active, contacts, single, pieces = np.array(rows, np.int64).T
    return Seen(active, contacts, single, pieces, np.array(owners))


def hand_or_not(
    skin: PreparedSkin, data: PressedSkin, settings: Settings
) -> tuple[list[HandRow], dict[str, str]]:
    """The second paper's methods on the samples that are said to be of a hand, or not."""
    from skinmap.classify.protocols.baxter_images import HAND, OTHER, ImageSet
    from skinmap.classify.protocols.baxter_methods import (
        METHODS,
        Bench,
        default_settings,
        mean_diagonal,
    )
    from skinmap.classify.protocols.folds import make_folds
    from skinmap.touch.paper_image import paper_images

    if data.hands is None:
        return [], {"hand or not": "no array 'hand' says which samples are of a hand"}
    raw, hand = np.concatenate(data.files), np.concatenate(data.hands)
    events = grasps(data)
    labels = np.where(hand, HAND, OTHER)
    kept = events >= 0
    images = paper_images(skin.image_geometry, raw[kept])
    bench = Bench(ImageSet(images, raw[kept], labels[kept], labels[kept], events[kept]))
    rows, skipped = [], {}
    for name in settings.names or METHODS:
        if name not in METHODS:
            raise UnknownNameError("method", name, METHODS)
        scores: list[float] = []
        method = METHODS[name]
        try:
            for seed in settings.all_seeds:
                folds = make_folds(
                    "event",
                    bench.data.labels,
                    bench.data.events,
                    folds=settings.folds,
                    rng=np.random.default_rng(seed),
                )
                named = np.empty(len(bench.data), bench.data.labels.dtype)
                for train, test in folds:
                    masks = _mask(train, len(named)), _mask(test, len(named))
                    named[test] = method(bench, *masks, default_settings("small"), seed)
                scores.append(mean_diagonal(bench.data.labels, named))
        except (InvalidArrayError, MissingLibraryError) as error:
            skipped[name] = str(error)
            continue
        rows.append(HandRow(method=name, mean=float(np.mean(scores)), spread=float(np.std(scores))))
    return rows, skipped


def grasps(data: PressedSkin) -> IntArray:
    """(t,) number of the grasp that each sample is of, -1 where fewer taxels are active.

    Samples of one grasp never stand on both sides of a split.
    """
    from skinmap.touch.contacts import ACTIVE

    found, before = [], 0
    for pressures in data.files:
        held = (pressures > ACTIVE).sum(axis=1) > GRASP
        starts = held & ~np.concatenate([[False], held[:-1]])
        found.append(np.where(held, before + np.cumsum(starts) - 1, -1))
        before += int(starts.sum())
    return np.concatenate(found)


def shown(seen: Seen) -> IntArray:
    """Samples worth a picture: the largest grasps, one of each stretch of the recording."""
    pieces = np.array_split(np.arange(len(seen.active)), SHOWN)
    best = np.array([piece[seen.active[piece].argmax()] for piece in pieces if len(piece)])
    return np.asarray(best[seen.active[best] > GRASP])


def _mask(index: IntArray, n: int) -> BoolArray:
    mask = np.zeros(n, bool)
    mask[index] = True
    return mask


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
    if result.hand_or_not:
        names: Rows = [
            [row.method, percent(row.mean), percent(row.spread)] for row in result.hand_or_not
        ]
        yield Table(["hand or not, grasps left out", "mean", "std"], names)
    for name, why in result.skipped.items():
        yield f"{name} was left out: {why}"


def hands_figure(result: HandsResult, path: Path) -> None:
    """Contact images of grasps as published, and below each the contacts on the flat map."""
    from skinmap.io.recordings.cyskin_arrays import read_pressed
    from skinmap.touch.paper_image import paper_images
    from skinmap.touch.prepared_skin import PreparedSkin

    data = read_pressed(Path(result.archive), Path(result.patch))
    skin = PreparedSkin(data.skin)
    seen = follow(skin, data)
    samples = shown(seen)
    pressures = np.concatenate(data.files)[samples]
    figure = plain_figure((2.3 * len(samples), 5.4))
    rows = figure.subplots(2, len(samples), squeeze=False, height_ratios=(0.6, 1.0))
    places = skin.flat.uv * 1e3
    for column, image in enumerate(paper_images(skin.image_geometry, pressures)):
        above, below = rows[:, column]
        above.imshow(image, cmap="gray", vmin=0, vmax=255)
        owner = seen.owners[samples[column]]
        below.scatter(*places[owner < 0].T, s=2.0, color="#d5d9de")
        for number in range(int(owner.max()) + 1):
            own = owner == number
            below.scatter(*places[own].T, s=9.0, color=CONTACTS[number % len(CONTACTS)])
        below.set_aspect("equal")
        below.set_title(f"{owner.max() + 1} contacts", fontsize=9)
        for axis in (above, below):
            axis.set_xticks([])
            axis.set_yticks([])
            axis.spines[:].set_visible(False)
    figure.suptitle(f"{result.robot}: contact images of real hands, and contacts on the flat map")
    save_figure(figure, path)


FIGURES: dict[str, Figure] = {"hands.png": hands_figure}
