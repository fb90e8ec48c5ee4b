"""Two touches at once, at distinct places of one part, with the truth of who owns which taxel."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import cKDTree

from skinmap.skin.skin import Skin
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.gestures import FOUR
from skinmap.touch.simulation.sensing import FULL_SCALE, Sensing
from skinmap.touch.simulation.simulator import (
    SUBJECTS,
    TRIES,
    Placed,
    Player,
    Stage,
    place,
    prepare,
)
from skinmap.touch.simulation.subjects import draw_subjects
from skinmap.touch.simulation.things import gesture_set
from skinmap.touch.simulation.variety import DEFAULT, draw_sensing

APART = 20e-3  # skin left free between two touches [m]
DELAY = 0.6  # the second begins within this time after the first [s]
FELT = 4.0 / FULL_SCALE  # a load that a taxel tells from noise


def simulate_pairs(
    skin: Skin,
    *,
    rng: np.random.Generator,
    count: int = 20,
    gestures: Sequence[str] = FOUR,
    subjects: int = SUBJECTS,
    sensing: Sensing | None = None,
    variety: float = DEFAULT,
    progress: Callable[[str], None] | None = None,
) -> Recording:
    """Pairs of touches, drawn at random from the gestures, that overlap in time.

    Parameters
    ----------
    skin : Skin
        n taxels.
    rng : numpy.random.Generator
    count : int
        Pairs asked for. Fewer come where the part cannot hold two of those drawn.
    gestures, subjects, sensing, variety
        As for `simulate`; the two touches are of two people.
    progress : callable, optional
        Called once a pair with the name of the part.

    Returns
    -------
    Recording
        Labels such as "poke+whole_hand"; `owners` holds the label of each taxel.
    """
    gestures = gesture_set(gestures)
    answers = draw_sensing(variety, rng=rng) if sensing is None else sensing
    stage = prepare(skin, rng=rng, sensing=answers, variety=variety)
    people = draw_subjects(max(subjects, 2), rng=rng)
    player = Player(stage, rng)
    for _ in range(count):
        if progress is not None:
            progress(skin.part)
        names = [gestures[int(rng.integers(len(gestures)))] for _ in range(2)]
        who = rng.permutation(len(people))[:2]
        first = place(stage, names[0], people[int(who[0])], rng=rng)
        if first is None:
            continue
        for _ in range(TRIES):
            second = place(stage, names[1], people[int(who[1])], rng=rng)
            if second is None:
                break
            if _free(stage, first, second) >= APART:
                player.touch([first, second], [0.0, float(rng.uniform(0.0, DELAY))])
                break
            # A part that is nearly full: let the first one move, too.
            first = place(stage, names[0], people[int(who[0])], rng=rng) or first
    return player.recording(owners=True)


def _free(stage: Stage, one: Placed, other: Placed) -> float:
    """Distance between the taxels that two touches load [m]; inf where one loads none."""
    felt = [placed.loads.sum(axis=0) > FELT for placed in (one, other)]
    points = [stage.skin.positions[taxels] for taxels in felt]
    if not len(points[0]) or not len(points[1]):
        return 0.0
    distance, _ = cKDTree(points[0]).query(points[1])
    return float(distance.min())
