"""The second paper's tables: human hands told from other contacts by contact images.

A. Albini, S. Denei and G. Cannata, "Human hand recognition from robotic skin measurements in
human-robot physical interactions", IROS 2017: 70 % of the images train, K and the network's
training are tuned by 5-fold cross-validation on these, ten random repeats.

The protocol compares these methods, and each is tuned.

Simulated contact images: human hands against all else. People and actions are the paper's: 43
people, 17 to 22 cm of hand, 19 % of them left-handed, grip an arm in seven ways from each of two
places and in five of their own. One image shows the middle of each touch, when it is steady.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError, MissingLibraryError, check_known, warn
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.triangles import unit
from skinmap.parallel.run import task_rng
from skinmap.recognition.descriptors import moments
from skinmap.recognition.images.bag_of_words import WORDS, count_words, learn_words, local_features
from skinmap.recognition.images.cnn import RECIPES, ContactImageCNN, train_along
from skinmap.recognition.protocols.folds import FoldKind, Names, make_folds, run_repeats
from skinmap.recognition.protocols.results import BaxterResult, Confusion, MethodResult, SplitSpread
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


@dataclass(frozen=True, eq=False)
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

    @cached_property
    def features(self) -> tuple[FloatArray, IntArray]:
        """Local features of all images, and the image of each."""
        return local_features(self.images)


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


FOLDS = 5
WORD_CHOICES = (5, 15, 30, 65, 130, 200, 300, 600)  # from words too general to ones too special
RATE_CHOICES = (0.01, 0.02, 0.03)
EPOCH_CHOICES = (30, 60)
PENALTY = 0.01  # of the linear SVM, on roots of counts; flat from here to ten times as much
PENALTIES, WIDTHS = (1.0, 10.0, 100.0, 1000.0), (1e-2, 1e-1, 1.0)  # of the raw baseline
# The paper's Table I up to the epochs that it found best, in %: by learning rate.
TABLE_I_EPOCHS = (10, 20, 30, 40, 50)
TABLE_I = {
    1e-5: (61.6, 56.2, 54.7, 55.54, 60.2),
    5e-5: (53.9, 64.6, 80.8, 89.0, 95.7),
    1e-4: (59.5, 84.5, 93.1, 96.8, 97.2),
    5e-4: (96.1, 98.1, 98.4, 98.6, 98.4),
    1e-3: (97.3, 98.3, 98.5, 98.2, 98.8),
    5e-3: (85.5, 96.9, 79.5, 88.0, 88.3),
    1e-2: (65.6, 50.6, 58.3, 49.4, 49.8),
}
FIGURE_8 = {130: 0.977}  # the one accuracy that its text gives, by K
Rows = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, slots=True)
class Settings:
    """What tuning decides.

    Attributes
    ----------
    words : int
        Codewords of the bag of visual words.
    network : str
        "small" or "paper".
    learning_rate : float
    epochs : int
    penalty, width : float
        C and gamma of the raw baseline.
    """

    words: int = WORDS
    network: str = "small"
    learning_rate: float = RECIPES["small"].learning_rate
    epochs: int = RECIPES["small"].epochs
    penalty: float = 10.0
    width: float = 1e-2


def default_settings(network: str) -> Settings:
    """Settings of the network as it comes, untuned."""
    layout = RECIPES[network]
    return Settings(network=network, learning_rate=layout.learning_rate, epochs=layout.epochs)


def name_bovw(data: ImageSet, train: Rows, test: Rows, settings: Settings, seed: int) -> Names:
    """Labels of the test images by a bag of visual words and a linear SVM."""
    from sklearn.svm import LinearSVC

    features, owner = data.features
    rng = np.random.default_rng(seed)
    words = learn_words(features[train[owner]], settings.words, rng)
    histograms = count_words(words, features, owner, len(data))
    machine = LinearSVC(C=PENALTY, dual=False)
    machine.fit(histograms[train], data.labels[train])
    return np.asarray(machine.predict(histograms[test]))


def name_cnn(data: ImageSet, train: Rows, test: Rows, settings: Settings, seed: int) -> Names:
    """Labels of the test images by a convolutional network."""
    machine = ContactImageCNN(
        settings.network,
        epochs=settings.epochs,
        learning_rate=settings.learning_rate,
        random_state=seed,
    )
    machine.fit(data.table[train], data.labels[train])
    return np.asarray(machine.predict(data.table[test]))


def name_raw(data: ImageSet, train: Rows, test: Rows, settings: Settings, seed: int) -> Names:
    """Labels of the test samples by an RBF SVM on the taxel values."""
    from sklearn.svm import SVC

    raw = data.raw / 255.0
    machine = SVC(C=settings.penalty, gamma=settings.width)
    machine.fit(raw[train], data.labels[train])
    return np.asarray(machine.predict(raw[test]))


Method = Callable[[ImageSet, Rows, Rows, Settings, int], Names]
METHODS: dict[str, Method] = {"bovw": name_bovw, "cnn": name_cnn, "raw_rbf": name_raw}


def mean_diagonal(labels: Names, named: Names) -> float:
    """Mean over the labels of the share named right."""
    return float(np.mean([(named[labels == kind] == kind).mean() for kind in np.unique(labels)]))


def tune(
    data: ImageSet,
    method: str,
    settings: Settings,
    *,
    rows: Rows,
    kind: FoldKind,
    rng: np.random.Generator,
) -> tuple[Settings, list[dict[str, Any]]]:
    """The best settings of a method by 5-fold cross-validation on some rows, and all tried.

    The rate of the small network is chosen first, at the fewest epochs, then the epochs; the
    paper's network tries each rate with each number of epochs, and what is tried has the paper's
    own accuracy beside it where it prints one. `kind` says whether folds keep touches together.
    """
    tried: list[dict[str, Any]] = []
    inside = np.flatnonzero(rows)
    folds = make_folds(kind, data.labels[inside], data.events[inside], folds=FOLDS, rng=rng)
    every = np.arange(len(data))
    masks = [(np.isin(every, inside[train]), np.isin(every, inside[test])) for train, test in folds]

    def best_of(choices: list[dict[str, Any]], settings: Settings) -> Settings:
        for choice in choices:
            chosen = replace(settings, **choice)
            scores = [
                mean_diagonal(data.labels[test], METHODS[method](data, train, test, chosen, number))
                for number, (train, test) in enumerate(masks)
            ]
            tried.append({**choice, "mean": float(np.mean(scores))})
        return _best(settings, tried)

    if method == "bovw":
        settings = best_of([{"words": k} for k in WORD_CHOICES], settings)
    elif method == "raw_rbf":
        grid = [{"penalty": c, "width": g} for c in PENALTIES for g in WIDTHS]
        settings = best_of(grid, settings)
    elif settings.network == "small":
        few, more = EPOCH_CHOICES
        rates = [{"learning_rate": rate, "epochs": few} for rate in RATE_CHOICES]
        settings = best_of(rates, settings)
        best = {"learning_rate": settings.learning_rate, "epochs": more}
        settings = best_of([best], settings)
    else:
        for rate in TABLE_I:
            runs = [_along(data, *mask, rate, seed) for seed, mask in enumerate(masks)]
            tried += [
                {"learning_rate": rate, "epochs": epochs, "mean": float(score)}
                for epochs, score in zip(TABLE_I_EPOCHS, np.mean(runs, axis=0), strict=True)
            ]
        settings = _best(settings, tried)
    for row in tried:
        if (theirs := _published(method, settings.network, row)) is not None:
            row["paper"] = theirs
    return settings, tried


def _best(settings: Settings, tried: list[dict[str, Any]]) -> Settings:
    best = max(tried, key=lambda row: row["mean"])
    return replace(settings, **{key: value for key, value in best.items() if key != "mean"})


def _along(data: ImageSet, train: Rows, test: Rows, rate: float, seed: int) -> list[float]:
    """The paper's network after each of `TABLE_I_EPOCHS`; chance where the training ran away."""
    recipe = replace(RECIPES["paper"], learning_rate=rate, epochs=TABLE_I_EPOCHS[-1])
    names, number = np.unique(data.labels, return_inverse=True)
    images = data.images.astype(np.float32) / np.float32(255.0)
    labels = tuple(map(str, names))
    nets = train_along(
        images[train], number[train], labels, recipe, epochs=TABLE_I_EPOCHS, seed=seed
    )
    scores = []
    for net in nets:
        score = 1.0 / len(names)
        if net is not None:
            with np.errstate(over="ignore", invalid="ignore"):  # about to run away
                best = net.logits(images[test]).argmax(axis=1)
            score = mean_diagonal(data.labels[test], names[best])
        scores.append(score)
    return scores


def _published(method: str, network: str, row: dict[str, Any]) -> float | None:
    """The paper's accuracy of these settings: Fig. 8 names one, Table I all."""
    if method == "bovw":
        return FIGURE_8.get(row["words"])
    if method == "cnn" and network == "paper":
        return TABLE_I[row["learning_rate"]][TABLE_I_EPOCHS.index(row["epochs"])] / 100.0
    return None


ROBOT, PART = "baxter-forearm", "forearm"
IMAGES = 1800
LABELS = (HAND, OTHER)
# On recordings of the real robot: one split, then mean, least and most of ten repeats.
# Of that split, in Tables II and III, the shares of hands and of others that were named right.
PAPER = {
    "bovw": {
        "mean": 0.9759, "repeats_mean": 0.9815, "min": 0.9692, "max": 0.989, "k": 130,
        "hand": 0.9692, "other": 0.9826,
    },
    "cnn": {
        "mean": 0.9868, "repeats_mean": 0.9833, "min": 0.9714, "max": 0.9934,
        "learning_rate": 1e-3, "epochs": 50, "hand": 0.9824, "other": 0.9912,
    },
}  # fmt: skip


def evaluate_baxter(
    skin: PreparedSkin | ImageSet,
    *,
    seed: int,
    repeats: int = 10,
    images: int = IMAGES,
    network: str = "small",
    methods: Sequence[str] = tuple(METHODS),
    tuned: bool = True,
    variety: float = 0.0,
    robot: str = "",
    **who: Any,
) -> BaxterResult:
    """Bags of visual words, a network and raw values on simulated touches, or on images given.

    Parameters
    ----------
    skin : PreparedSkin or ImageSet
        Of the Baxter-like forearm, or of any other part; `robot` is whose, for the result. Images
        that were given have no raw values: their pixels stand for these.
    seed : int
    repeats : int
        Random splits into 70 % and 30 %; each is made twice, by touches and plain.
    images : int
    network : {"small", "paper"}
        The paper's own size is tuned over the paper's Table I: hours.
    methods : sequence of str
        Some of `METHODS`.
    tuned : bool
        Whether K, learning rate, epochs and the baseline's C and gamma are chosen by 5-fold
        cross-validation on the training images of each split anew.
    who
        `workers` and `progress` of `run_tasks`.

    Returns
    -------
    BaxterResult
        By method; one whose library is not installed has `missing` alone.

    Raises
    ------
    InvalidArrayError, UnknownNameError
        No repeat, too few images, or a method that there is not.
    """
    if repeats < 1:
        raise InvalidArrayError(f"at least 1 repeat, got {repeats}")
    check_known("method", methods, METHODS)
    if isinstance(skin, ImageSet):
        data, part, taxels = skin, "", 0
    else:
        data = simulate_images(skin, images=images, rng=task_rng(seed, 0), variety=variety)
        part, taxels = skin.skin.part, len(skin)
    found, confusion = dict[str, Any](), dict[str, Any]()
    # With one image a touch, splits by touch are the plain ones.
    kinds: tuple[FoldKind, ...] = ("event", "plain")
    if len(np.unique(data.events)) == len(data):
        kinds = ("event",)
    splits = [{"kind": kind, "number": number} for kind in kinds for number in range(repeats)]
    shared = {"data": data, "network": network, "tuned": tuned, "seed": seed, **who}
    for name in methods:
        try:
            runs = run_repeats(baxter_repeat, splits, method=name, **shared)
        except MissingLibraryError as error:
            warn(f"{name} is left out: {error}")
            found[name] = MethodResult(missing=str(error))
            continue
        touches, plain = (_spread(half) for half in (runs[:repeats], runs[-repeats:]))
        found[name] = MethodResult(
            mean=touches.mean,
            min=touches.min,
            max=touches.max,
            plain=plain,
            tuning=runs[0].tried,
            chosen=[_settings_of(name, run.settings) for run in runs[:repeats]],
            **_settings_of(name, runs[0].settings),
        )
        confusion[name] = touches.confusion
    return BaxterResult(
        robot=robot,
        part=part,
        taxels=taxels,
        accuracy_is="recorded" if isinstance(skin, ImageSet) else "simulated",
        simulated=not isinstance(skin, ImageSet),
        variety=variety,
        confusion=Confusion(labels=list(LABELS), **confusion),
        images=len(data),
        touches=len(np.unique(data.events)),
        repeats=repeats,
        seed=seed,
        network=network,
        paper=PAPER,
        **found,
    )


@dataclass(frozen=True, eq=False, slots=True)
class Repeat:
    """One random split.

    Attributes
    ----------
    counts : (2, 2) float
        Images of each label (rows) that were named each label.
    settings : Settings
    tried : list of dict
        What tuning tried on its training images.
    """

    counts: FloatArray
    settings: Settings
    tried: list[dict[str, Any]]


def baxter_repeat(
    seed: int,
    number: int,
    kind: FoldKind,
    *,
    data: ImageSet,
    method: str,
    network: str,
    tuned: bool,
) -> Repeat:
    """The paper's procedure on one random split: tune on what trains, train, test."""
    test = split_images(kind, data, rng=task_rng(seed, 1, number))
    settings, tried = default_settings(network), list[dict[str, Any]]()
    if tuned:
        rng = task_rng(seed, 2, number)
        settings, tried = tune(data, method, settings, rows=~test, kind=kind, rng=rng)
    named = METHODS[method](data, ~test, test, settings, number)
    pairs = [
        [np.count_nonzero(named[data.labels[test] == true] == guess) for guess in LABELS]
        for true in LABELS
    ]
    return Repeat(np.array(pairs, np.float64), settings, tried)


def _spread(runs: Sequence[Repeat]) -> SplitSpread:
    """Mean, least and most of the mean of the diagonal, and the mean confusion."""
    table = np.array([run.counts for run in runs])
    shares = table / table.sum(axis=2, keepdims=True)
    diagonal = np.einsum("rii->ri", shares).mean(axis=1)
    return SplitSpread(
        mean=float(diagonal.mean()),
        min=float(diagonal.min()),
        max=float(diagonal.max()),
        confusion=shares.mean(axis=0).tolist(),
    )


def _settings_of(name: str, settings: Settings) -> dict[str, Any]:
    if name == "bovw":
        return {"k": settings.words}
    if name == "cnn":
        keys = ("network", "learning_rate", "epochs")
        return {key: getattr(settings, key) for key in keys}
    return {"C": settings.penalty, "gamma": settings.width}
