"""Simulated contact images for the second paper's protocol: human hands against all else.

People and actions are the paper's: 43 people, 17 to 22 cm of hand, 19 % of them left-handed, grip
an arm in seven ways from each of two places and in five of their own. One image shows the middle
of each touch, when it is steady.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.triangles import unit
from skinmap.recognition.protocols.folds import FoldKind, Names
from skinmap.recognition.sample_descriptors import moments
from skinmap.skin.skin import Skin
from skinmap.touch.images.contact_image import SIZE, paper_images, resize
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.gestures import GESTURES as ALL_GESTURES
from skinmap.touch.simulation.gestures import TIME
from skinmap.touch.simulation.simulator import Player, Stage, place, prepare
from skinmap.touch.simulation.variety import HABITS, Habit, draw_sensing, draw_subjects

HAND, OTHER = "hand", "other"
# Grips of a human hand, and what else touches a robot's arm; as many images of each group.
GESTURES = {
    HAND: ("whole_hand", "three_finger"),
    OTHER: (
        "elbow", "forearm", "shoulder", "ball", "hard_ball", "cylinder", "edge", "corner", "plate",
    ),
}  # fmt: skip
PEOPLE = 43
HANDS = (17.0 / 18.5, 22.0 / 18.5)  # sizes, 1 = an adult's 185 mm
LEFT_HANDED = 0.19
ACTIONS = (
    "grasp", "torque clockwise", "torque counter-clockwise",
    "push left", "push right", "push away", "pull",
)  # fmt: skip
POSITIONS = ("front", "side")
FREE = 5  # further touches of each person, wherever and however
ALONG = (0.3, 0.7)  # force along the skin over force on it: less than what slips
TILT = 1.5  # share of its pressure that a foot's edge gains when it is pushed as hard along as on
WHOLE_HANDS = tuple(name for name in (*ALL_GESTURES, *TIME) if name not in GESTURES[OTHER])
FEWEST = 10  # touches of hands, and of others
TEST = 0.3  # share of the images that test


@dataclass(frozen=True, eq=False, slots=True)
class ImageSet:
    """Labelled images.

    Attributes
    ----------
    images : (n, 66, 100) uint8
    raw : (n, n_taxels) uint8
        The samples that they are of.
    labels : (n,) str
        "hand" or "other".
    gestures : (n,) str
    events : (n,) int
        Touch that each sample is of.
    actions : (n,) str
        Of `ACTIONS`, or "free"; empty where nobody's hand acts.
    """

    images: NDArray[np.uint8]
    raw: NDArray[np.uint8]
    labels: Names
    gestures: Names
    events: IntArray
    actions: Names

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def table(self) -> NDArray[np.uint8]:
        """(n, 6600) images as rows."""
        return self.images.reshape(len(self), -1)


NO_HAND = ("other", "non-hand", "non_hand", "nonhand", "no_hand", "not_hand", *GESTURES[OTHER])


def given_images(images: NDArray[np.uint8], named: Names, touches: IntArray) -> ImageSet:
    """Images (n, rows, columns) of files, with labels (n,) and touches (n,).

    Labels are "hand" and "other", or gestures that are one of these.

    Raises
    ------
    InvalidArrayError
        Another label, or fewer than 10 touches of either kind.
    """
    names = np.array([name.strip().lower() for name in named])
    known = {HAND, "hands", "human", *NO_HAND, *WHOLE_HANDS}
    for name in dict.fromkeys(names.tolist()):
        if name not in known:
            raise InvalidArrayError(
                f"label {name!r}: labels are hand, other, or a gesture of the simulator"
            )
    labels = np.where(np.isin(names, NO_HAND), OTHER, HAND)
    for label in (HAND, OTHER):
        count = len(np.unique(touches[labels == label]))
        if count < FEWEST:
            raise InvalidArrayError(f"{count} touches of {label}: {FEWEST} at least")
    grey = resize(images, SIZE)
    gestures = np.where(np.isin(names, ["hands", "human"]), HAND, names)
    flat, actions = grey.reshape(len(grey), -1), np.full(len(grey), "")
    return ImageSet(grey, flat, labels, gestures, touches, actions)


def simulate_images(
    skin: PreparedSkin, *, images: int, rng: np.random.Generator, variety: float = 0.0
) -> ImageSet:
    """About as many images as asked for, one a touch, half of them of hands.

    Raises
    ------
    InvalidArrayError
        Fewer than 5 touches of each thing were asked for, or a group that does not fit the skin at
        all.
    """
    each = round(images / (2 * len(GESTURES[OTHER])))
    if each < 5:
        raise InvalidArrayError(f"{images} images are too few: 5 touches of each gesture")
    stage = prepare(skin.skin, rng=rng, sensing=draw_sensing(variety, rng=rng), variety=variety)
    people = [
        replace(one, hand=float(rng.uniform(*HANDS)), left=bool(rng.random() < LEFT_HANDED))
        for one in draw_subjects(PEOPLE, rng=rng)
    ]
    stands = [replace(stage, habits=habits) for habits in _stands(stage)]
    structured = [(action, number) for action in ACTIONS for number in range(len(POSITIONS))]
    ways = [*structured, *[("free", len(POSITIONS))] * FREE]
    everything = [(person, way) for person in people for way in ways]
    asked = rng.permutation(round(images / 2)) % len(everything)
    wanted = [(HAND, *everything[number]) for number in asked]
    some = [people[number] for number in rng.integers(PEOPLE, size=each * len(GESTURES[OTHER]))]
    wanted += [(OTHER, person, ("", len(POSITIONS))) for person in some]
    player, actions = Player(stage, rng), []
    for number, (label, person, (action, stand)) in enumerate(wanted):
        names = GESTURES[label]
        name = names[int(rng.integers(len(names))) if label == HAND else number % len(names)]
        placed = None
        if stand < len(POSITIONS):
            placed = place(stands[stand], name, person, rng=rng, places="habitual")
        placed = placed or place(stage, name, person, rng=rng)
        if placed is not None:
            free = str(rng.choice(ACTIONS)) if action == "free" else action
            player.touch([replace(placed, loads=acted(placed.loads, skin.skin, free, rng=rng))])
            actions.append(action)
    recording = player.recording()
    rows, events = [], []
    for number, own in enumerate(recording.rows()):
        held = own[(recording.pressures[own] > 0).any(axis=1)]
        if len(held):
            rows.append(held[moments(len(held), 1)[0]])
            events.append(number)
    gestures = np.array(recording.labels)[events]
    labels = np.where(np.isin(gestures, GESTURES[HAND]), HAND, OTHER)
    for label in GESTURES:
        if label not in labels:
            fits = ", ".join(GESTURES[label])
            raise InvalidArrayError(f"{skin.skin.part!r} has no room for any of: {fits}")
    samples = recording.pressures[rows]
    grey = paper_images(skin.image_geometry, samples)
    return ImageSet(grey, samples, labels, gestures, np.array(events), np.array(actions)[events])


def _stands(stage: Stage) -> list[dict[str, tuple[Habit, ...]]]:
    """Where people grip from the front, with the fingers along the arm, and from its side, across.

    From the front they grip the middle of the skin, from the side a quarter of it further round.
    """
    places = stage.skin.positions - stage.skin.positions.mean(axis=0)
    axes = np.linalg.svd(places, full_matrices=False)[2]
    along, across = places @ axes[0], places @ axes[1]
    found = []
    for share, turn in ((0.5, 0.0), (0.25, np.pi / 2.0)):
        off = np.abs(along) + np.abs(across - np.quantile(across, share))
        taxel = int(off.argmin())
        first, second = tangent_frames(stage.skin.normals[taxel]) @ axes[0]
        habit = Habit(taxel, float(turn - np.arctan2(second, first)))
        found.append(dict.fromkeys(GESTURES[HAND], (habit,) * HABITS))
    return found


def acted(loads: FloatArray, skin: Skin, action: str, *, rng: np.random.Generator) -> FloatArray:
    """Loads (p, n) of the pieces of a grip that also pushes along the skin, or turns about itself.

    A force along the skin tips what it acts on: pressure rises ahead and falls behind, in
    proportion to the distance from the middle. A push tips the whole grip, a torque each finger
    its own way. "grasp" and what no hand does stay as they are.
    """
    if action in ("grasp", "") or not loads.any():
        return loads
    weight = loads.sum(axis=0) / loads.sum()
    middle, up = weight @ skin.positions, unit(weight @ skin.normals)
    spread = skin.positions - skin.positions.mean(axis=0)
    arm = np.linalg.svd(spread, full_matrices=False)[2][0]
    ahead = unit(arm - (arm @ up) * up)
    ways = {"push away": ahead, "pull": -ahead}
    ways |= {"push left": np.cross(up, ahead), "push right": np.cross(ahead, up)}
    share = TILT * rng.uniform(*ALONG)
    out = loads.copy()
    for piece in out:
        if not piece.any():
            continue
        own = piece @ skin.positions / piece.sum()
        way, centre = ways.get(action), middle
        if way is None:
            sense = -1.0 if action == "torque clockwise" else 1.0
            way, centre = sense * unit(np.cross(up, own - middle)), own
        step = (skin.positions - centre) @ way
        reach = np.abs(step[(loads if centre is middle else piece[None]).any(axis=0)]).max() or 1.0
        piece *= np.clip(1.0 + share * step / reach, 0.0, None)
    return out


def split_images(kind: FoldKind, data: ImageSet, *, rng: np.random.Generator) -> NDArray[np.bool_]:
    """(n,) which images test: 30 % of the touches of each gesture, or of its images.

    "event" keeps all images of a touch on one side; "plain", as published, does not.
    """
    units = data.events if kind == "event" else np.arange(len(data))
    held = np.zeros(len(data), bool)
    for gesture in np.unique(data.gestures):
        own = np.unique(units[data.gestures == gesture])
        out = rng.choice(own, round(TEST * len(own)), replace=False)
        held |= np.isin(units, out) & (data.gestures == gesture)
    return held
