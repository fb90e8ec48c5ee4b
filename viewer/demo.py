"""`skinmap demo`: the numbers, the pictures, the movie and the report of the first run."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinmap.classify.classifier import TouchClassifier
from skinmap.classify.descriptors import Touch
from skinmap.flat.distortion import spread
from skinmap.io.output import staged_folder
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.contacts.sample_contacts import centre_of_pressure
from skinmap.live.moment import Moment
from skinmap.live.sources.replay import replay
from skinmap.report.figure import FlatMapSheet
from skinmap.report.image import media
from skinmap.report.page import cards, grid, heading, note, page
from skinmap.report.present import PAGE
from skinmap.report.result import plain
from skinmap.report.structure_figures import structures_figure
from skinmap.report.table import Cell, Table
from skinmap.skin.robot import Robot
from skinmap.touch.contacts import ACTIVE, pool_event
from skinmap.touch.gestures import GESTURES
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulator import RATE, simulate
from viewer.analysis import Analysis, analyse, demo_result
from viewer.export.movie import MOVIE_FPS, write_movie
from viewer.results import DemoResult, DemoSeconds, OtherPhysics, ScoreRow
from viewer.scene import Scene
from viewer.view_files import movie_frames

NUMBERS = "demo.json"
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
) -> tuple[DemoResult, Stage]:
    """Analyse the parts, write everything into `out` and return the numbers.

    Raises
    ------
    OutputError
        `out` cannot be written to; nothing is left half written.
    """
    started = time.perf_counter()
    with staged_folder(out) as folder:
        analysis = analyse(robot, parts, seed=seed, advance=advance)
        analysed = time.perf_counter()
        (folder / "flatmaps").mkdir()
        sheet = FlatMapSheet()
        for part, skin in analysis.skins.items():
            advance(f"{part}: picture of the flat map")
            sheet.write(skin.flat, folder / "flatmaps" / f"{part}.png")
        advance("picture of the structures")
        structures_figure(analysis.skins, analysis.rotated, folder / "structures.png")
        stage, movie = _show(analysis, folder, seed, advance)
        drawn = time.perf_counter()
        advance("report")
        pictures = [f"flatmaps/{part}.png" for part in analysis.skins]
        files = ["robot.png", "structures.png", movie.name, *pictures, PAGE, NUMBERS]
        seconds = DemoSeconds(
            analysis=analysed - started, pictures=drawn - analysed, total=drawn - started
        )
        result = demo_result(analysis, seed, files, seconds)
        (folder / PAGE).write_text(demo_page(result, folder, movie, analysis.skins), "utf-8")
        numbers = json.dumps(plain(result), indent=2)
        (folder / NUMBERS).write_text(numbers + "\n", encoding="utf-8")
    return result, stage


def demo_lines(result: DemoResult) -> Iterator[str]:
    """What the demo found, in a few lines for people."""
    named, edges = result.accuracy, result.edge_rms_percent
    yield (
        f"{result.robot}: {result.taxels} taxels on {len(result.parts)} parts, "
        f"{result.patches} patches, {result.meshed_taxels} taxels meshed"
    )
    yield (
        f"flat maps: {result.flips} flipped triangles, edge rms {edges.median:.2f} % (median "
        f"patch), {edges.max:.2f} % (worst)"
    )
    yield f"structures: {result.structures.plain} plain, {result.structures.rotated} rotated"
    yield (
        f"simulated touches named right: {_percent(named.same_parts)} on trained parts, "
        f"{_percent(named.other_parts)} on parts never trained on"
    )
    yield (
        f"  there, histograms reach {_percent(named.other_parts_histogram)}, "
        f"the paper's literal ones {_percent(named.other_parts_paper)}"
    )
    if result.physics is not None:
        yield f"  pressed by MuJoCo instead: {_range(result.physics)} (kept from an evaluation)"
    yield f"{result.seconds.total:.0f} s; {PAGE} shows all of it:"


def demo_page(
    result: DemoResult, folder: Path, movie: Path, skins: Mapping[str, PreparedSkin]
) -> str:
    """The report, from the numbers and the pictures that lie in the folder."""
    return page(
        result.robot,
        [
            note(f"Skinmap demo, seed {result.seed}, {result.seconds.total:.0f} s"),
            cards(_figures(result)),
            heading("Touches on the body"),
            media(folder / "robot.png", "named touches on the body"),
            note(
                "Simulated touches on parts that the classifier was never trained on. Boxes: the "
                "name given and its confidence."
            ),
            heading("Replay"),
            media(folder / movie.name, "replay of simulated touches"),
            heading("How often the name is right"),
            _accuracy(result).html(),
            note(
                "Simulated touches, counted per touch event; trained on "
                f"{', '.join(result.trained_on)} ({result.touches.train} touches). No tested "
                "touch, and for other parts no part or mirror image, was trained on. A gesture "
                "that does not fit a part is not simulated there."
            ),
            *_physics_note(result),
            heading("Flat maps"),
            _charts(skins).html(),
            grid(media(folder / "flatmaps" / f"{part}.png", part) for part in skins),
            heading("Periodic structures"),
            media(folder / "structures.png", "structures"),
        ],
    )


def _figures(result: DemoResult) -> list[tuple[str, str]]:
    strain, found = result.edge_rms_percent, result.structures
    return [
        (f"{result.taxels:,}", f"taxels on {len(result.parts)} parts"),
        (f"{result.meshed_taxels:,}", f"of them meshed, in {result.patches} patches"),
        (f"{result.flips}", "flipped triangles"),
        (f"{strain.median:.2f} %", f"edge rms, median patch (worst {strain.max:.2f} %)"),
        (f"{result.normals.median_deg:.1f}\u00b0", "normals against the body, median"),
        (f"{found.plain} / {found.rotated}", "structures, plain / with rotation"),
        (_percent(result.accuracy.same_parts), "named right, parts trained on (simulated)"),
        (_percent(result.accuracy.other_parts), "named right, other parts (simulated)"),
    ]


def _accuracy(result: DemoResult) -> Table:
    labels = sorted({label for row in result.table for label in row.per_label})
    best = result.table[0].classifier
    rows: list[list[Cell]] = [
        [
            row.classifier,
            row.tested_on.replace("_", " "),
            row.touches,
            _percent(row.accuracy),
            _range(result.physics) if _is_kept(row, best) else "-",
            *(_percent(row.per_label.get(label)) for label in labels),
        ]
        for row in result.table
    ]
    names = [label.replace("_", " ") for label in labels]
    heads = ("classifier", "tested on", "touches", "all", "pressed by MuJoCo", *names)
    return Table(heads, rows)


def _is_kept(row: ScoreRow, best: str) -> bool:
    """Whether the other physics was measured like a row: the default on parts left out."""
    return row.classifier == best and row.tested_on == "other_parts"


def _range(physics: OtherPhysics | None) -> str:
    """Least and most of the variants."""
    if physics is None:
        return "-"
    shares = [100 * share for share in physics.mean.values()]
    return f"{min(shares):.0f} to {max(shares):.0f} %"


def _physics_note(result: DemoResult) -> Iterator[str]:
    if result.physics is not None:
        variants = result.physics.mean
        each = ", ".join(f"{name} {_percent(one)}" for name, one in variants.items())
        yield note(
            "Pressed by MuJoCo: not measured in this run but kept from `skinmap evaluate "
            "--protocol physics`, which trained this classifier on simulated touches of ours with "
            f"parts left out and tested it in {len(variants)} variants of another physics: {each}. "
            f"Nothing was trained or tuned on {result.physics.frozen}."
        )


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _charts(skins: Mapping[str, PreparedSkin]) -> Table:
    rows = []
    for part, skin in skins.items():
        for chart in skin.flat.charts:
            found = chart.distortion
            angle = spread(found.quasi_conformal, found.face_areas)
            rows.append(
                (
                    part, chart.patch, len(chart.taxels), chart.holes, chart.method, found.flips,
                    round(100 * found.edge_rms, 2), round(angle["mean"], 4),
                    round(found.area_sd, 4),
                )
            )  # fmt: skip
    return Table(
        ("part", "patch", "taxels", "holes", "method", "flips", "edge rms [%]",
         "quasi-conformal", "area sd"),
        rows,
    )  # fmt: skip


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
