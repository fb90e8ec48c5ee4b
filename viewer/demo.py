"""`skinmap demo`: the numbers, the pictures, the movie and the report of the first run."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.classify.classifier import TouchClassifier
from skinmap.classify.descriptors import Touch
from skinmap.io.output import staged_folder
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.contacts.sample_contacts import centre_of_pressure
from skinmap.live.moment import Moment
from skinmap.live.sources.replay import replay
from skinmap.report.figure import flat_map_figure
from skinmap.report.result import plain
from skinmap.report.structure_figures import structures_figure
from skinmap.skin.robot import Robot
from skinmap.touch.contacts import ACTIVE, pool_event
from skinmap.touch.gestures import GESTURES
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulator import RATE, simulate
from viewer.analysis import Analysis, analyse, summarise
from viewer.export.movie import MOVIE_FPS, write_movie
from viewer.report import write_report
from viewer.scene import Scene
from viewer.view_files import movie_frames

STEPS = 12  # progress steps beside those per part
STAGGER = 0.45  # between the starts of two touches of the replay [s]
ROUNDS = 2  # touches on each part of the replay
SHOWN = 6  # parts of the replay at most: more labels than that cannot be read
TRIES = 4  # simulated touches of each gesture that the one that faces the camera is chosen from
FACING = 0.3  # cosine: touches that turn further from the camera are left out of the still
STILL_SIZE = (1600, 1100)
MOVIE_SIZE = (1024, 768)


@dataclass(frozen=True, eq=False, slots=True)
class Stage:
    """What a live window needs to play the replay again."""

    robot: Robot
    skins: Mapping[str, PreparedSkin]
    tracks: Mapping[str, NDArray[np.uint8]]
    classifier: TouchClassifier


def run_demo(
    robot: Robot,
    parts: Sequence[str],
    out: Path,
    *,
    seed: int,
    advance: Callable[[str], None],
) -> tuple[dict[str, Any], Stage]:
    """Analyse the parts, write everything into `out` and return the numbers.

    Raises
    ------
    OutputError
        `out` cannot be written to; nothing is left half written.
    """
    started = time.perf_counter()
    with staged_folder(out) as folder:
        analysis = analyse(robot, parts, seed=seed, advance=advance)
        seconds = {"analysis": time.perf_counter() - started}
        (folder / "flatmaps").mkdir()
        for part, skin in analysis.skins.items():
            advance(f"{part}: picture of the flat map")
            flat_map_figure(skin.flat, folder / "flatmaps" / f"{part}.png")
        advance("picture of the structures")
        structures_figure(analysis.skins, analysis.rotated, folder / "structures.png")
        stage, movie = _show(analysis, folder, seed, advance)
        seconds["pictures"] = time.perf_counter() - started - seconds["analysis"]
        advance("report")
        result = summarise(analysis)
        result["seed"] = seed
        pictures = [f"flatmaps/{part}.png" for part in analysis.skins]
        result["files"] = [
            "robot.png",
            "structures.png",
            movie.name,
            *pictures,
            "report.html",
            "demo.json",
        ]
        seconds["total"] = time.perf_counter() - started
        result["seconds"] = seconds
        result = plain(result)
        write_report(result, folder, analysis.skins)
        (folder / "demo.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return result, stage


def show_window(stage: Stage) -> None:
    """Play the replay over and over in a live window until it is closed."""
    from viewer.window import play

    scene = make_scene(stage.robot, stage.skins, off_screen=False, window_size=MOVIE_SIZE)
    play(scene, _moments(stage))


def _moments(stage: Stage) -> Iterator[Moment]:
    """What the window shows, without end."""
    while True:
        yield from replayed(stage)
        if not any(len(track) for track in stage.tracks.values()):
            return


def make_scene(
    robot: Robot,
    skins: Mapping[str, PreparedSkin],
    *,
    off_screen: bool = True,
    window_size: tuple[int, int] = STILL_SIZE,
) -> Scene:
    """The robot's body with the skins of some parts."""
    return Scene(
        robot,
        {part: skin.mesh for part, skin in skins.items()},
        {part: skin.flat for part, skin in skins.items()},
        window_size=window_size,
        off_screen=off_screen,
    )


def _show(
    analysis: Analysis, folder: Path, seed: int, advance: Callable[[str], None]
) -> tuple[Stage, Path]:
    """Write the still and the movie of touches on parts that were never trained on."""
    classifier = analysis.models["contact-geometry"]
    tested = [part for part in analysis.skins if part not in analysis.train_parts][:SHOWN]
    rng = np.random.default_rng([seed, 1])  # apart from the streams that train and test
    advance("scene")
    scene = make_scene(analysis.robot, analysis.skins)
    touches = visible_touches(analysis, scene, tested, rng)
    advance("still")
    seen = {
        part: [touch for touch in events if _facing(touch, scene) >= FACING]
        for part, events in touches.items()
    }
    first = {part: events[0] for part, events in seen.items() if events}
    write_still(scene, analysis.skins, first, classifier, folder / "robot.png")
    scene.close()
    tracks = {part: track(events, start) for start, (part, events) in enumerate(touches.items())}
    stage = Stage(analysis.robot, analysis.skins, tracks, classifier)
    advance("movie")
    scene = make_scene(analysis.robot, analysis.skins, window_size=MOVIE_SIZE)
    movie = write_movie(folder / "replay.mp4", movie_frames(scene, replayed(stage)), MOVIE_FPS)
    scene.close()
    return stage, movie


def visible_touches(
    analysis: Analysis, scene: Scene, parts: Sequence[str], rng: np.random.Generator
) -> dict[str, list[Touch]]:
    """For each part a few fresh touches on the side that the camera sees, gestures in turn."""
    chosen: dict[str, list[Touch]] = {}
    for number, part in enumerate(parts):
        skin = analysis.skins[part]
        recording = simulate(skin.skin, rng=rng, per_gesture=TRIES)
        pool = [Touch(skin, samples, label) for _, label, samples in recording.touches()]
        labels = [name for name in reversed(GESTURES) if name in recording.labels]
        chosen[part] = []
        for turn in range(min(ROUNDS, len(labels))):
            label = labels[(number + 2 + 2 * turn) % len(labels)]
            same = [touch for touch in pool if touch.label == label]
            chosen[part].append(max(same, key=lambda touch: _facing(touch, scene)))
    return chosen


def _facing(touch: Touch, scene: Scene) -> float:
    """Cosine between the loaded skin's mean normal and the direction to the camera."""
    load = pool_event(touch.samples)
    normal = (touch.skin.skin.normals * load[:, None]).sum(axis=0)
    normal /= max(float(np.linalg.norm(normal)), 1e-12)
    T_root_link = scene.poses[touch.skin.skin.link]
    return float(T_root_link[:3, :3] @ normal @ scene.front.direction)


def write_still(
    scene: Scene,
    skins: Mapping[str, PreparedSkin],
    touches: Mapping[str, Touch],
    classifier: TouchClassifier,
    path: Path,
) -> list[NamedTouch]:
    """All touches at their height in one picture, each with the name that it was given."""
    named = []
    for part, touch in touches.items():
        pressures = pool_event(touch.samples)
        scene.set_pressures(part, pressures)
        prediction = classifier.predict(touch)
        named.append(
            NamedTouch(
                part,
                np.flatnonzero(pressures > ACTIVE),
                centre_of_pressure(skins[part], pressures),
                prediction.label,
                prediction.confidence,
            )
        )
    if named:
        scene.show_flat_map(max(named, key=lambda touch: len(touch.taxels)).part)
    scene.set_touches(named)
    scene.screenshot(path)
    return named


def track(touches: Sequence[Touch], start: int) -> NDArray[np.uint8]:
    """Samples (t, n) of touches one after another, the first one `start` staggers late."""
    n = len(touches[0].skin) if touches else 0
    quiet = np.zeros((int(STAGGER * RATE), n), np.uint8)
    blocks = [quiet] * start
    for touch in touches:
        blocks += [touch.samples, quiet, quiet]
    return np.concatenate(blocks) if blocks else quiet


def replayed(stage: Stage) -> Iterator[Moment]:
    """The replay, once."""
    return replay(stage.robot, stage.tracks, stage.classifier, rate=RATE, skins=stage.skins)
