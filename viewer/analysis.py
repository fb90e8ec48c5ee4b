"""The numbers of the first run: every part meshed, flattened, touched and named."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skinmap.io.robots.manifest import data_folder
from skinmap.neighbours.offsets import concatenate
from skinmap.neighbours.structures import Structures, find_structures
from skinmap.recognition.classifier import TouchClassifier, classifiers
from skinmap.recognition.evaluate import Score, Split, score, split_touches
from skinmap.skin.cover import SkinFit, measure_fit
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate
from viewer.results import (
    DemoAccuracy,
    DemoResult,
    DemoSeconds,
    EdgeError,
    NormalFit,
    OtherPhysics,
    ScoreRow,
    StructureCounts,
    TouchCounts,
)

PER_GESTURE = 24  # touches of each of the four gestures on each part
METHODS = ("contact-geometry", "histogram", "paper")
KEPT = "evaluation_physics.json"  # what `skinmap evaluate --protocol physics` found
OURS = "ours"


@dataclass(frozen=True, eq=False, slots=True)
class Analysis:
    """All that the first run finds out."""

    robot: Robot
    skins: Mapping[str, PreparedSkin]
    fits: Mapping[str, SkinFit]
    plain: Structures
    rotated: Structures
    train_parts: tuple[str, ...]
    split: Split
    models: Mapping[str, TouchClassifier]
    scores: Mapping[str, tuple[Score, Score]]


def analyse(
    robot: Robot, parts: Sequence[str], *, seed: int, advance: Callable[[str], None]
) -> Analysis:
    """Mesh, flatten, find structures, simulate, train and test; `advance` is called per step.

    Half of the kinds of parts are trained on and the other half only tested; a part and its
    mirror image are of one kind, so no twin of a tested part was ever seen.
    """
    draw, *streams = np.random.default_rng(seed).spawn(len(parts) + 1)
    skins, fits, recordings = {}, {}, []
    for part, rng in zip(parts, streams, strict=True):
        advance(f"{part}: surface and flat map")
        skin = robot.skin(part)
        skins[part] = PreparedSkin(skin)
        fits[part] = measure_fit(skin, robot.mesh_under(part))
        _ = skins[part].flat
        advance(f"{part}: touches")
        recordings.append(simulate(skin, rng=rng, per_gesture=PER_GESTURE))
    hoods = concatenate([skin.hoods for skin in skins.values()])
    advance("structures")
    plain = find_structures(hoods, rotations=1)
    advance("structures with rotation")
    rotated = find_structures(hoods, rotations=6)
    trained = training_parts(parts)
    split = split_touches(skins, recordings, trained, rng=draw)
    models, scores = {}, {}
    for method in METHODS:
        advance(f"training: {method}")
        models[method] = classifiers.get(method)().fit(split.train, rng=draw)
        advance(f"testing: {method}")
        scores[method] = (
            score(models[method], split.same_parts),
            score(models[method], split.other_parts),
        )
    return Analysis(robot, skins, fits, plain, rotated, trained, split, models, scores)


def training_parts(parts: Sequence[str]) -> tuple[str, ...]:
    """Every other kind of part, left and right being one kind; the first part if all are one."""
    kinds = list(dict.fromkeys(_kind(part) for part in parts))
    if len(kinds) < 2:
        return tuple(parts[:1])
    return tuple(part for part in parts if kinds.index(_kind(part)) % 2 == 0)


def _kind(part: str) -> str:
    return part.removeprefix("left_").removeprefix("right_")


def demo_result(
    analysis: Analysis, seed: int, files: list[str], seconds: DemoSeconds
) -> DemoResult:
    """The numbers of an analysis."""
    skins, split = analysis.skins, analysis.split
    charts = [chart for skin in skins.values() for chart in skin.flat.charts]
    strain = [100.0 * chart.distortion.edge_rms for chart in charts]
    angle = np.degrees(np.concatenate([fit.normal_angle for fit in analysis.fits.values()]))
    best, histogram, paper = (analysis.scores[name] for name in METHODS)
    return DemoResult(
        robot=analysis.robot.name,
        parts=list(skins),
        taxels=sum(len(skin) for skin in skins.values()),
        meshed_taxels=sum(int((skin.patches >= 0).sum()) for skin in skins.values()),
        patches=len(charts),
        flips=sum(chart.distortion.flips for chart in charts),
        edge_rms_percent=EdgeError(median=float(np.median(strain)), max=max(strain)),
        normals=NormalFit(
            median_deg=float(np.median(angle)),
            share_within_15_deg=float((angle <= 15.0).mean()),
            inward=sum(int(fit.inward.sum()) for fit in analysis.fits.values()),
        ),
        structures=StructureCounts(
            plain=len(analysis.plain.prototypes), rotated=len(analysis.rotated.prototypes)
        ),
        accuracy_is="simulated",
        trained_on=list(analysis.train_parts),
        touches=TouchCounts(
            train=len(split.train),
            same_parts=len(split.same_parts),
            other_parts=len(split.other_parts),
        ),
        accuracy=DemoAccuracy(
            same_parts=best[0].accuracy,
            other_parts=best[1].accuracy,
            other_parts_histogram=histogram[1].accuracy,
            other_parts_paper=paper[1].accuracy,
        ),
        table=[
            ScoreRow(
                classifier=name,
                tested_on=where,
                accuracy=one.accuracy,
                touches=one.touches,
                per_label=dict(one.per_label),
                per_part=dict(one.per_part),
            )
            for name, pair in analysis.scores.items()
            for where, one in zip(("same_parts", "other_parts"), pair, strict=True)
        ],
        physics=other_physics(),
        seed=seed,
        files=files,
        seconds=seconds,
    )


def other_physics() -> OtherPhysics | None:
    """What was kept of the classifier in another physics, installed or in a checkout."""
    data = data_folder()
    installed = data / "results"
    folder = installed if installed.is_dir() else data.parent / "benchmarks" / "results"
    if not (folder / KEPT).is_file():
        return None
    kept = json.loads((folder / KEPT).read_text(encoding="utf-8"))
    rows = [row for row in kept["rows"] if row["trained_on"] == OURS != row["tested_on"]]
    means = {row["tested_on"]: row["mean"] for row in rows}
    return OtherPhysics(trained_on=OURS, mean=means, frozen=kept["frozen"])
