"""What gives three answers about a touch: with what, how it moves, and whether it is a hand.

They stand beside the name that was trained (docs/touches.md). Kind and motion are the answers of
RBF machines on the numbers of contact geometry; sets of names hold the truth in nine of ten
touches, by parts that were left out, and are wider where a touch is unlike those
(`prediction_sets`).

Whether it is a hand is the mean of some small networks on contact geometry and the shape of the
contact, which name all hands and things; a fingertip and a ball of its size press the same, so
there is `unsure`, too. Kinds of things are named only where it is surely no hand.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError, check_known
from skinmap.recognition.answers import Answer, Answers, HandAnswer, HandWord
from skinmap.recognition.descriptors import ContactGeometry, Touch
from skinmap.recognition.prediction_sets import SetCalibration, folds_of, set_calibration_from
from skinmap.recognition.rbf_machine import RbfMachine
from skinmap.touch.contacts.contact_geometry import FEATURES, SIZE, contact_geometry, contact_shape
from skinmap.touch.contacts.motion_features import MOTION_FEATURES
from skinmap.touch.contacts.skin_geometry import pool_event
from skinmap.touch.simulation.gestures import TIME
from skinmap.touch.simulation.hands import HAND

if TYPE_CHECKING:
    from skinmap.recognition.classifier import Classifier

STILL, MOVING = ContactGeometry(motion=False), ContactGeometry(motion=True)
STAYS = "still"  # the motion of a touch that stays
COVERAGE = 0.9  # of the sets
SURE = (0.2, 0.8)  # probability of a hand below which it is none, and from which it is one
NO_HAND = 0.05  # probability up to which a thing is named: a finger named a thing is worse
LEAST = 50  # rows of a name that are learnt, where there are so many
PARTS = ("kind", "other", "motion", "hand")  # machines, by what they tell apart
NETWORKS = ("labels", "mean", "scale", "first", "second", "third")  # arrays of `HandNetworks`
GROUPS = ("hand", "other")
SHIPPED, MEMBER = Path(__file__).with_name("default.skinmodel"), "answers.npz"
# What a model can lack, in the words of a note.
LACKS = "has no answers of its own: kind, motion and hand are those of the model that ships"


@dataclass(eq=False, slots=True)
class Machine:
    """One machine with the sets of names that it may promise.

    Attributes
    ----------
    machine : RbfMachine
        Trained.
    sets : SetCalibration or None
        Of touches that copies of it had not seen; None where it gives no sets.
    """

    machine: RbfMachine
    sets: SetCalibration | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        """Names that it tells apart."""
        return tuple(map(str, self.machine.classes_))

    def shares(self, row: FloatArray, near: FloatArray | None = None) -> FloatArray:
        """(c,) probability of each of `labels` for a row (1, d)."""
        return np.asarray(self.machine.probabilities(row, near)[0])

    def answer(self, row: FloatArray, skin: str) -> Answer:
        """The likeliest name of a touch on the skin of a fingerprint, and its set."""
        near = self.machine.squares(row)
        share, labels = self.shares(row, near), self.labels
        best = int(np.argmax(share))
        names: tuple[str, ...] = ()
        if self.sets is not None:
            limit = self.sets.threshold(COVERAGE, skin)
            strange = float(self.machine.strangeness(row, near)[0])
            names = self.sets.names(share, labels, strange, limit)
        return Answer(labels[best], float(share[best]), names or (labels[best],))


@dataclass(eq=False, slots=True)
class HandNetworks:
    """Networks of two hidden layers that name hands and things; their mean counts.

    Attributes
    ----------
    labels : (c,) str
        Names of touches that they tell apart.
    mean, scale : (d,) float
        Of the rows that they learnt from.
    first, second, third : (k, d + 1, h), (k, h + 1, g), (k, g + 1, c) float
        Weights of each of k networks, the last row of a layer what it adds.
    """

    labels: NDArray[np.str_]
    mean: FloatArray
    scale: FloatArray
    first: FloatArray
    second: FloatArray
    third: FloatArray

    def __post_init__(self) -> None:
        count, columns = len(self.first), len(self.mean)
        wide, narrow = self.first.shape[-1], self.second.shape[-1]
        sizes = ((columns + 1, wide), (wide + 1, narrow), (narrow + 1, len(self.labels)))
        layers = (self.first, self.second, self.third)
        fit = all(one.shape == (count, *size) for one, size in zip(layers, sizes, strict=True))
        sound = all(np.isfinite(one).all() for one in (self.mean, self.scale, *layers))
        if not fit or not sound or self.scale.shape != (columns,) or (self.scale <= 0.0).any():
            raise InvalidArrayError("its networks for hands do not fit together")
        if columns != len(FEATURES) + SIZE:
            raise InvalidArrayError(
                f"its networks for hands have {columns} columns, not {len(FEATURES) + SIZE}"
            )

    def probability(self, row: FloatArray) -> float:
        """That a touch of a row (d,) of `hand_row` is a hand."""
        found = (row - self.mean) / self.scale @ self.first[:, :-1] + self.first[:, -1]
        for layer in (self.second, self.third):
            found = np.maximum(found, 0.0)[:, None] @ layer[:, :-1]
            found = found[:, 0] + layer[:, -1]
        share = np.exp(found - found.max(axis=1, keepdims=True))
        share /= share.sum(axis=1, keepdims=True)
        return float(share[:, [one in HAND for one in self.labels.tolist()]].sum(axis=1).mean())


@dataclass(eq=False, slots=True)
class ThreeAnswers:
    """What gives the three answers.

    Attributes
    ----------
    machines : dict of str to Machine
        By what they tell apart, some of `PARTS`; `kind` and `motion` are always there.
    networks : HandNetworks or None
        What tells a hand from others where no machine does.
    """

    machines: dict[str, Machine] = field(default_factory=dict)
    networks: HandNetworks | None = None

    def of(self, touch: Touch) -> Answers | None:
        """The answers about a touch; None where nothing is felt."""
        row = shape_row(touch)
        if len(row) == 0:
            return None
        skin = touch.skin.fingerprint
        chance = self.hand_probability(touch, row)
        motion = self.machines["motion"].answer(MOVING.describe(touch), skin)
        return Answers(self._kind(row, skin, chance), motion, hand_answer(chance))

    def _kind(self, row: FloatArray, skin: str, chance: float) -> Answer:
        """A kind of hand's touch or of thing, no likelier than the hand or thing."""
        other = self.machines.get("other")
        if other is not None and chance <= NO_HAND:
            thing = other.answer(row, skin)
            return replace(thing, probability=(1.0 - chance) * thing.probability)
        kind = self.machines["kind"].answer(row, skin)
        if other is None:
            return kind
        names = kind.set
        if chance < SURE[1]:  # the likeliest things, too, until the set holds nine of ten
            share = other.shares(row)
            order = np.argsort(-share)
            held = chance + (1.0 - chance) * np.cumsum(share[order])
            names += tuple(other.labels[k] for k in order[: 1 + int((held < COVERAGE).sum())])
        return Answer(kind.answer, chance * kind.probability, names)

    def completed(self, others: ThreeAnswers) -> ThreeAnswers:
        """The same with what others have where it has none, but for things beside its own kinds."""
        taken = dict(others.machines)
        if "kind" in self.machines:
            taken.pop("other", None)
        return ThreeAnswers({**taken, **self.machines}, self.networks or others.networks)

    def hand_probability(self, touch: Touch, row: FloatArray) -> float:
        """That a touch with a row (1, d) of contact geometry is a hand."""
        if self.networks is not None and "hand" not in self.machines:
            return self.networks.probability(hand_row(touch, row))
        machine = self.machines["hand"]
        return float(machine.shares(row)[machine.labels.index("hand")])

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """What a model file keeps."""
        kept: dict[str, NDArray[Any]] = {}
        for name, one in self.machines.items():
            kept |= {f"{name}.machine.{k}": v for k, v in one.machine.to_arrays().items()}
            if one.sets is not None:
                kept |= {f"{name}.sets.{k}": v for k, v in one.sets.to_arrays().items()}
        if self.networks is not None:
            kept |= {f"networks.{name}": getattr(self.networks, name) for name in NETWORKS}
        return kept


def three_answers_from(arrays: Mapping[str, NDArray[Any]]) -> ThreeAnswers:
    """What `to_arrays` gave.

    Raises
    ------
    InvalidArrayError
        Machines that are missing, or do not fit together.
    """
    found = ThreeAnswers()
    networks = _below(arrays, "networks.")
    if networks:
        if set(networks) != set(NETWORKS):
            raise InvalidArrayError(f"its networks for hands need {', '.join(NETWORKS)}")
        numbers = {key: np.asarray(networks[key], np.float64) for key in NETWORKS[1:]}
        found.networks = HandNetworks(networks["labels"], **numbers)
    strange = {key.partition(".")[0] for key in arrays} - {*PARTS, "networks"}
    if strange:
        raise InvalidArrayError(
            f"answers of an earlier version ({', '.join(strange)}): train again"
        )
    for name in PARTS:
        own = _below(arrays, f"{name}.")
        if not own:
            continue
        machine = RbfMachine()
        machine.from_arrays(_below(own, "machine."))
        sets = _below(own, "sets.")
        found.machines[name] = Machine(machine, set_calibration_from(sets) if sets else None)
        columns = len(FEATURES) + len(MOTION_FEATURES) * (name == "motion")
        if machine.n_features_in_ != columns:
            raise InvalidArrayError(
                f"its machine for {name!r} has {machine.n_features_in_} columns, not {columns}"
            )
    return found


def _below(arrays: Mapping[str, NDArray[Any]], head: str) -> dict[str, NDArray[Any]]:
    return {k[len(head) :]: v for k, v in arrays.items() if k.startswith(head)}


def hand_answer(probability: float) -> HandAnswer:
    """The word for a probability of a hand."""
    low, high = SURE
    word: HandWord = "unsure"
    if probability >= high or probability <= low:
        word = "hand" if probability >= high else "other"
    return HandAnswer(word, probability)


def shape_row(touch: Touch) -> FloatArray:
    """(1, d) contact geometry of what touches; (0, d) where nothing does.

    Pooled over a touch that stays; of one that moves, in the sample of its largest load: its way is
    not its shape.
    """
    still = STILL.describe(touch)
    if len(still) == 0 or MOVING.stays(touch):
        return still
    return contact_geometry(touch.skin.geometry, _heaviest(touch))[None]


def hand_row(touch: Touch, row: FloatArray) -> FloatArray:
    """(d,) what networks for hands see: a row (1, e) of `shape_row`, and the contact's shape."""
    pressures = pool_event(touch.samples) if MOVING.stays(touch) else _heaviest(touch)
    return np.concatenate([np.log1p(row[0]), contact_shape(touch.skin.geometry, pressures)])


def _heaviest(touch: Touch) -> FloatArray:
    """(n,) the sample of the largest load."""
    load = touch.samples.sum(axis=1, dtype=np.int64)
    return touch.samples[int(load.argmax())].astype(np.float64)


def train_machine(
    rows: FloatArray,
    labels: Sequence[str],
    touches: Sequence[Touch],
    *,
    rng: np.random.Generator,
    most_rows: int = RbfMachine.most_rows,
    even: float = 1.0,
    sets: bool = True,
) -> Machine:
    """A machine for rows (m, d) of touches, and what its copies think of touches left out.

    At most `most_rows` are learnt, of each name no more than `even` times those of the rarest.
    Groups are left out in turn (`folds_of`).
    """
    names = np.array(labels)
    machine = _fitted(rows, names, rng, most_rows, even)
    if machine is None:
        raise InvalidArrayError(f"answers need two names or more; got {', '.join(set(labels))}")
    if not sets:
        return Machine(machine)
    words, fold = folds_of(touches)
    shares, strange = np.zeros(len(rows)), np.zeros(len(rows))
    for number in np.unique(fold):
        test = fold == number
        copy = _fitted(rows[~test], names[~test], rng, most_rows, even)
        if copy is None:
            continue
        place = {str(name): k for k, name in enumerate(copy.classes_)}
        share = copy.probabilities(rows[test])
        shares[test] = [
            share[k, place[name]] if name in place else 0.0
            for k, name in enumerate(names[test].tolist())
        ]
        strange[test] = copy.strangeness(rows[test])
    return Machine(machine, SetCalibration(shares, strange, *words))


def _fitted(
    rows: FloatArray, names: NDArray[np.str_], rng: np.random.Generator, most_rows: int, even: float
) -> Any:
    """A machine that learnt as many rows of each name as of the rarest one, or None of one name.

    `even` times as many of the others.
    """
    kinds, number, count = np.unique(names, return_inverse=True, return_counts=True)
    if len(kinds) < 2:
        return None
    most = max(LEAST, min(int(even * count.min()), most_rows // len(kinds)))
    place = rng.permutation(len(names))
    some = np.sort(np.concatenate([place[number[place] == k][:most] for k in range(len(kinds))]))
    return RbfMachine().fit(rows[some], names[some])


@cache
def shipped_answers() -> ThreeAnswers:
    """The answers of the model that ships."""
    with zipfile.ZipFile(SHIPPED) as archive, np.load(io.BytesIO(archive.read(MEMBER))) as arrays:
        return three_answers_from(arrays)


def lacking(classifier: Classifier) -> str:
    """What a model has no answers for, in a sentence; empty where it has all."""
    return LACKS if getattr(classifier, "own_answers", None) is None else ""


def read_groups(text: str) -> dict[str, list[str]]:
    """Groups of labels as they are typed, `hand=poke,full_finger;other=elbow`.

    Raises
    ------
    InvalidArrayError
        Anything but the groups `hand` and `other`, once each and with a label.
    """
    found: dict[str, list[str]] = {}
    for group in text.split(";"):
        name, equals, labels = (word.strip() for word in group.partition("="))
        names = [label.strip() for label in labels.split(",") if label.strip()]
        if name not in GROUPS or name in found or not equals or not names:
            raise InvalidArrayError(
                f"groups are written hand=LABEL,...;other=LABEL,..., each once; got {group!r}"
            )
        found[name] = names
    if len(found) < len(GROUPS):
        missing = next(name for name in GROUPS if name not in found)
        raise InvalidArrayError(f"the group {missing!r} is missing in {text!r}")
    return found


def check_groups(groups: Mapping[str, Sequence[str]], labels: Sequence[str]) -> None:
    """Refuse groups that are not `hand` and `other`, or in which a label is not exactly once.

    Raises
    ------
    UnknownNameError
        A label that is not among those that were recorded.
    InvalidArrayError
        A label in both groups, or in neither.
    """
    if set(groups) != set(GROUPS):
        raise InvalidArrayError(f"the groups are hand and other, got {', '.join(groups) or 'none'}")
    check_known("recorded label", (one for own in groups.values() for one in own), labels)
    both = [name for name in groups["hand"] if name in groups["other"]]
    if both:
        raise InvalidArrayError(
            f"{', '.join(both)} in both groups, hand and other; put each in one"
        )
    left = [name for name in labels if name not in (*groups["hand"], *groups["other"])]
    if left:
        raise InvalidArrayError(f"the groups miss {', '.join(left)}; put each in hand or other")


def check_motions(motions: Sequence[str], labels: Sequence[str]) -> tuple[str, ...]:
    """Which labels name how a touch moves: those that were given, and the simulated ones.

    Raises
    ------
    UnknownNameError
        One that is not among the labels.
    """
    check_known("recorded label", motions, labels)
    return tuple(name for name in labels if name in (*motions, *TIME))


def learn_answers(
    classifier: Classifier,
    touches: Sequence[Touch],
    *,
    groups: Mapping[str, Sequence[str]] | None,
    motions: Sequence[str],
    rng: np.random.Generator,
) -> None:
    """Give a classifier answers of its own where its touches teach them.

    `hand` by its groups; `motion` where kinds and motions are mixed, and `kind` where there are
    several kinds beside motions. All else is answered by the model that ships.
    """
    felt = [(touch, shape_row(touch)) for touch in touches]
    used = [touch for touch, row in felt if len(row)]
    if not used:
        return
    rows = np.concatenate([row for _, row in felt])
    labels = [touch.label for touch in used]
    own: dict[str, Machine] = {}
    if groups is not None:
        hands = ["hand" if label in groups["hand"] else "other" for label in labels]
        own["hand"] = train_machine(rows, hands, used, rng=rng, sets=False)
    kinds = sorted(set(labels) - set(motions))
    if motions and kinds:
        moving = np.concatenate([MOVING.describe(touch) for touch in used])
        still = [label if label in motions and label != "hold" else STAYS for label in labels]
        if len(set(still)) > 1:
            own["motion"] = train_machine(moving, still, used, rng=rng)
    if motions and len(kinds) > 1:
        those = [k for k, label in enumerate(labels) if label in kinds]
        named = [labels[k] for k in those]
        own["kind"] = train_machine(rows[those], named, [used[k] for k in those], rng=rng)
    classifier.own_answers = ThreeAnswers(own)
