"""Labelled samples of simulated touches, and their histograms: what paper 1's protocol runs on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray, freeze
from skinmap.errors import InvalidArrayError
from skinmap.neighbours.offsets import Neighbourhoods
from skinmap.neighbours.structures import Structures, find_structures
from skinmap.recognition.protocols.folds import Names
from skinmap.skin.skin import Skin
from skinmap.touch.contacts.skin_geometry import ACTIVE
from skinmap.touch.histograms.codebook import Codebook, VoteCounter, learn_codebook
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.gestures import ON_SKIN
from skinmap.touch.simulation.simulator import SUBJECTS, Player, place, prepare
from skinmap.touch.simulation.variety import Places, draw_sensing, draw_subjects

COUNTS = 255.0
BOOK_TOUCHES = 12  # touches of each gesture that the codebook is learnt from, and nothing else
BOOK_SAMPLES = 240
# Least share of a touch that lies over taxels: the simulator's own, and less where nothing fits.
SHARES = (ON_SKIN, 0.55, 0.4, 0.25)
SAMPLES_A_TOUCH = 34  # in contact, at 50 Hz; fewer than almost any simulated touch has


@dataclass(frozen=True, eq=False, slots=True)
class SampleSet:
    """Samples in contact with their labels, and unlabelled ones of other touches.

    Attributes
    ----------
    pressures : (n, n_taxels) uint8
    labels : (n,) str
    events : (n,) int
        Touch that each sample is of.
    book : (m, n_taxels) uint8
        Samples of touches that are not among `events`: "touches made at random", for codebooks.
    on_skin : float
        Least share of a touch over taxels, of the gesture that fits worst.
    """

    pressures: NDArray[np.uint8]
    labels: Names
    events: IntArray
    book: NDArray[np.uint8]
    on_skin: float

    def __post_init__(self) -> None:
        freeze(self, pressures=self.pressures, events=self.events, book=self.book)

    def take(self, rows: IntArray) -> SampleSet:
        """The same with some of the labelled samples."""
        return SampleSet(
            self.pressures[rows], self.labels[rows], self.events[rows], self.book, self.on_skin
        )


def draw_samples(
    skin: PreparedSkin,
    counts: Mapping[str, int],
    *,
    rng: np.random.Generator,
    places: Places = "anywhere",
    variety: float = 0.0,
) -> SampleSet:
    """Simulate touches until there are so many samples in contact of each gesture.

    Parameters
    ----------
    skin : PreparedSkin
        n_taxels.
    counts : mapping of str to int
        Samples wanted of each gesture.
    rng : numpy.random.Generator
    places : {"anywhere", "habitual"}
    variety : float
        See `simulate`; 0 are pads of fixed sizes, as in the paper's figures.

    Raises
    ------
    InvalidArrayError
        A gesture of which not even a quarter fits the part.
    """
    touches = -(-max(counts.values()) // SAMPLES_A_TOUCH) + BOOK_TOUCHES
    recording, on_skin = _play(skin.skin, tuple(counts), touches, places, variety, rng)
    seen = dict.fromkeys(counts, 0)
    rows: dict[str, list[IntArray]] = {name: [] for name in counts}
    book: list[IntArray] = []
    touched: BoolArray = np.asarray((recording.pressures > ACTIVE).any(axis=1))
    for label, rows_of_touch in zip(recording.labels, recording.rows(), strict=True):
        own = rows_of_touch[touched[rows_of_touch]]
        seen[label] += 1
        (book if seen[label] <= BOOK_TOUCHES else rows[label]).append(own)
    chosen = [np.concatenate(rows[name])[: counts[name]] for name in counts]
    some = np.concatenate(book)
    some = rng.choice(some, min(BOOK_SAMPLES, len(some)), replace=False)
    index = np.concatenate(chosen)
    labels = np.repeat(list(counts), [len(own) for own in chosen])
    return SampleSet(
        recording.pressures[index],
        labels,
        recording.events[index],
        recording.pressures[some],
        on_skin,
    )


def _play(
    skin: Skin,
    gestures: Sequence[str],
    touches: int,
    places: Places,
    variety: float,
    rng: np.random.Generator,
) -> tuple[Recording, float]:
    """So many touches of each gesture; what is larger than the part hangs over its edge.

    The second value is the share that is left over taxels of the gesture that fits worst.
    """
    answers = draw_sensing(variety, rng=rng)
    stage = prepare(skin, rng=rng, sensing=answers, variety=variety)
    people = draw_subjects(SUBJECTS, rng=rng)
    player = Player(stage, rng)
    shares = {name: list(SHARES) for name in gestures}
    for name in rng.permutation(np.repeat(gestures, touches)):
        subject = people[int(rng.integers(len(people)))]
        placed = None
        while placed is None and shares[name]:
            share = shares[name][0]
            placed = place(stage, name, subject, rng=rng, places=places, on_skin=share)
            if placed is None:
                shares[name].pop(0)
        if placed is None:
            raise InvalidArrayError(
                f"{name} does not fit the {len(skin)} taxels of {skin.part!r}; choose a larger part"
            )
        player.touch([placed])
    return player.recording(), min(left[0] for left in shares.values())


Sampling = Literal["random", "paper"]


def resample(
    labels: Names, percent: float, *, rng: np.random.Generator, sampling: Sampling = "random"
) -> IntArray:
    """Rows of a share of the samples of each label, at least one of each.

    Drawn at random, or as the paper has it: every 50th sample for 2 %, every 10th for 10 %. Two
    samples of one touch are then 1 s and 0.2 s apart.
    """
    chosen = []
    for label in np.unique(labels):
        own = np.flatnonzero(labels == label)
        if sampling == "paper":
            chosen.append(own[:: max(1, round(100.0 / percent))])
            continue
        count = max(1, round(len(own) * percent / 100.0))
        chosen.append(rng.choice(own, count, replace=False))
    return np.sort(np.concatenate(chosen))


@dataclass(frozen=True, slots=True)
class Recipe:
    """How histograms are made.

    Attributes
    ----------
    name : str
    rotations : int
        Turns that structures may have, 1 or 6.
    literal : bool
        As published: resting codewords count.
    """

    name: str
    rotations: int
    literal: bool = False


ROTATED = Recipe("histogram", 6)
UPRIGHT = Recipe("histogram, no rotation", 1)
LITERAL = Recipe("histogram, literal", 1, literal=True)
RECIPES = (ROTATED, UPRIGHT, LITERAL)


def learn(
    recipe: Recipe, structures: Structures, book: NDArray[np.uint8], *, seed: int, words: int
) -> Codebook:
    """A codebook from unlabelled samples (m, n_taxels) of one skin."""
    return learn_codebook(
        [(structures, book / COUNTS)],
        rng=np.random.default_rng(seed),
        words=words,
        literal=recipe.literal,
    )


def structures_of(recipe: Recipe, hoods: Neighbourhoods) -> Structures:
    """The structures of a skin."""
    return find_structures(hoods, rotations=recipe.rotations)


def count_votes(
    codebook: Codebook, structures: Structures, pressures: NDArray[np.uint8]
) -> FloatArray:
    """(n, bins) histograms of samples (n, n_taxels)."""
    return VoteCounter(codebook, structures).count(pressures).astype(np.float64)
