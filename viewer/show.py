"""`skinmap view`: touches on the body in a window, a picture or a movie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.classify.classifier import DEFAULT, TouchClassifier, classifiers
from skinmap.classify.descriptors import Touch
from skinmap.classify.model_file import load_classifier
from skinmap.cli.classify import prepare_skins
from skinmap.io.output import staged_file
from skinmap.skin.robot import Robot
from skinmap.touch.prepared import PreparedSkin
from skinmap.touch.recording import Recording, load_recordings
from skinmap.touch.simulator import RATE, simulate
from viewer.demo import EVERY, MOVIE_SIZE, Stage, make_scene, movie_frames, show_window, write_still
from viewer.movie import write_movie

TRAINING = 16  # simulated touches of each gesture and part when no model is given


def show(
    robot: Robot,
    parts: Sequence[str],
    *,
    source: Path | None,
    model: Path | None,
    screenshot: Path | None,
    movie: Path | None,
    seed: int,
) -> dict[str, Any]:
    """Name the touches of a recording (or of the simulator) and show them.

    Returns the touches of the still and the files written. Without `screenshot` and `movie` a
    window opens and stays until it is closed.
    """
    rng = np.random.default_rng(seed)
    if source is not None:
        recordings = [one for one in load_recordings(source) if one.part in parts]
        skins = prepare_skins(robot, recordings)
    else:
        skins = {part: PreparedSkin(robot.skin(part)) for part in parts}
        recordings = [simulate(skin.skin, rng=rng, per_gesture=1) for skin in skins.values()]
    classifier = _train(skins, rng) if model is None else load_classifier(model)
    tracks = {recording.part: recording.pressures for recording in recordings}
    stage = Stage(robot, skins, tracks, classifier)
    named: list[dict[str, Any]] = []
    if screenshot is not None:
        with staged_file(screenshot) as path:
            scene = make_scene(robot, skins)
            touches = write_still(scene, skins, first_touches(skins, recordings), classifier, path)
            scene.close()
        named = [
            {"part": touch.part, "label": touch.label, "confidence": touch.confidence}
            for touch in touches
        ]
    if movie is not None:
        with staged_file(movie) as path:
            scene = make_scene(robot, skins, window_size=MOVIE_SIZE)
            write_movie(path, movie_frames(scene, stage), RATE / EVERY)
            scene.close()
    if screenshot is None and movie is None:
        show_window(stage)
    files = [file for file in (screenshot, movie) if file is not None]
    return {"robot": robot.name, "parts": list(skins), "touches": named, "files": files}


def first_touches(
    skins: Mapping[str, PreparedSkin], recordings: Sequence[Recording]
) -> dict[str, Touch]:
    """The first touch of each recorded part."""
    chosen = {}
    for recording in recordings:
        for _, label, samples in recording.touches():
            chosen[recording.part] = Touch(skins[recording.part], samples, label)
            break
    return chosen


def _train(skins: Mapping[str, PreparedSkin], rng: np.random.Generator) -> TouchClassifier:
    touches = [
        Touch(skin, samples, label)
        for skin in skins.values()
        for _, label, samples in simulate(skin.skin, rng=rng, per_gesture=TRAINING).touches()
    ]
    return classifiers.get(DEFAULT)().fit(touches, rng=rng)
