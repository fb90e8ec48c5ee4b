"""Varied iCubs and what is done with each: tasks of benchmarks/scale/scale.py, a seed each."""

from __future__ import annotations

import os
import resource
import time
from dataclasses import dataclass, replace
from functools import cache

# A file in this folder has the name of the package `calibration`: the checkout comes first.
import numpy as np

import skinmap
from benchmarks.calibration.patches import Case, far_apart, icub_cases
from calibration import wrap_layout
from skinmap.classify.classifier import classifiers
from skinmap.classify.descriptors import Touch
from skinmap.classify.evaluate import score
from skinmap.neighbours.structures import find_structures
from skinmap.parallel.run import task_rng
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin
from skinmap.touch.codebook import learn_codebook
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulator import simulate

STRETCH, JITTER = 0.05, 0.05e-3  # [1], [m]
TOUCHES = 3  # of each gesture on each part
SAMPLES = 240  # that codewords are learnt from
ANCHORS, ANCHOR_SIGMA = 4, 1e-3


@cache
def robot() -> Robot:
    """The iCub, read once by each process."""
    return skinmap.load_robot("icub")


@cache
def cases() -> tuple[Case, ...]:
    """The 23 patches of the iCub as boards."""
    return tuple(icub_cases())


def varied(part: str, seed: int) -> Skin:
    """A part of the robot of a seed."""
    skin, rng = robot().skin(part), task_rng(seed, robot().parts.index(part))
    stretched = skin.positions * rng.uniform(1 - STRETCH, 1 + STRETCH, 3)
    return replace(skin, positions=stretched + rng.normal(0.0, JITTER, stretched.shape))


def maps(seed: int) -> int:
    """Mesh and lay flat all parts; triangles turned over."""
    parts = robot().parts
    return sum(skinmap.flatten(skinmap.build_surface(varied(p, seed))).flips for p in parts)


def structures(seed: int) -> int:
    """Structures of all parts with rotations, and a codebook each from made samples."""
    found = 0
    for number, part in enumerate(robot().parts):
        skin, rng = PreparedSkin(varied(part, seed)), task_rng(seed, 99, number)
        own = find_structures(skin.hoods, rotations=6)
        learn_codebook([(own, rng.random((SAMPLES, len(skin))))], rng=rng)
        found += len(own.prototypes)
    return found


def evaluation(seed: int) -> float:
    """Touches on all parts, half of the parts to train and half to test; share named right."""
    touches: list[list[Touch]] = []
    for number, part in enumerate(robot().parts):
        skin = PreparedSkin(varied(part, seed))
        rng = task_rng(seed, 50, number)
        played = simulate(skin.skin, rng=rng, per_gesture=TOUCHES)
        touches.append([Touch(skin, samples, label) for _, label, samples in played.touches()])
    train, test = ([t for own in touches[k::2] for t in own] for k in (0, 1))
    model = classifiers.get("contact-geometry")().fit(train, rng=task_rng(seed, 51))
    return float(score(model, test).accuracy)


def wraps(seed: int) -> float:
    """All 23 patches by four anchors each on links of another size; worst median error [mm]."""
    worst = 0.0
    for number, case in enumerate(cases()):
        rng = task_rng(seed, 70, number)
        size = rng.uniform(1 - STRETCH, 1 + STRETCH)
        taxels = far_apart(case.layout, ANCHORS, rng)
        points = size * case.truth[taxels] + rng.normal(0.0, ANCHOR_SIGMA, (ANCHORS, 3))
        found = wrap_layout(
            size * case.layout, size * case.vertices, case.faces, taxels, points,
            anchor_sigma=ANCHOR_SIGMA, rng=rng,
        )  # fmt: skip
        apart = np.linalg.norm(found.positions - size * case.truth, axis=1)
        worst = max(worst, 1e3 * float(np.median(apart)))
    return worst


STAGES = {"maps": maps, "structures": structures, "evaluation": evaluation, "wraps": wraps}


@dataclass(frozen=True, slots=True)
class Row:
    """What one robot took.

    Attributes
    ----------
    result : float
    seconds : float
        CPU time of the robot itself.
    total : float
        CPU time of its process so far, imports and compilation too.
    process : int
    peak_mb : float
        Of the process.
    """

    result: float
    seconds: float
    total: float
    process: int
    peak_mb: float


def timed(task: tuple[str, int]) -> Row:
    """One stage of one robot."""
    stage, seed = task
    robot()  # read before the clock starts, as what is only done once
    if stage == "wraps":
        cases()
    start = time.process_time()
    result = STAGES[stage](seed)
    now = time.process_time()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return Row(float(result), now - start, now, os.getpid(), peak)
