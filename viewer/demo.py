"""`skinmap demo`: the numbers, the pictures, the movie and the report of the first run."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from skinmap.io.output import staged_folder
from skinmap.io.recordings.touch_files import save_recordings
from skinmap.neighbours.offsets import concatenate
from skinmap.neighbours.structures import find_structures
from skinmap.recognition.classifier import TouchClassifier, classifiers
from skinmap.recognition.evaluate import Score, score, split_touches
from skinmap.recognition.model_file import save_classifier
from skinmap.report.flat_figures import part_figure
from skinmap.report.page import cards, grid, heading, media, note, page, save_figure
from skinmap.report.present import PAGE
from skinmap.report.result import plain
from skinmap.report.structure_figures import structures_figure
from skinmap.report.table import Cell, Table
from skinmap.skin.cover import SkinFit, measure_fit
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate
from viewer.results import (
    DemoAccuracy,
    DemoResult,
    EdgeError,
    NormalFit,
    ScoreRow,
    StructureCounts,
    TouchCounts,
)
from viewer.view_files import Wanted, write_files
from viewer.view_options import Look, Session

PER_GESTURE = 24  # touches of each of the four gestures on each part
METHODS = ("contact-geometry", "histogram", "paper")
NUMBERS = "demo.json"
PICTURE, MOVIE = "robot.png", "replay.mp4"
STEPS = 11  # progress steps beside those per part
SHOWN = 6  # parts that are touched at most: more labels than that cannot be read


class Analysis:
    """All that the first run finds out: surfaces, maps, structures, touches and their names.

    Half of the kinds of parts are trained on and the other half only tested; a part and its
    mirror image are of one kind, so no twin of a tested part was ever seen.

    Parameters
    ----------
    robot : Robot
    parts : sequence of str
    seed : int
    advance : callable
        Is called per step.
    """

    def __init__(
        self, robot: Robot, parts: Sequence[str], *, seed: int, advance: Callable[[str], None]
    ) -> None:
        draw, *streams = np.random.default_rng(seed).spawn(len(parts) + 1)
        self.robot, self.train_parts = robot, training_parts(parts)
        self.skins: dict[str, PreparedSkin] = {}
        self.fits: dict[str, SkinFit] = {}
        recordings = []
        for part, rng in zip(parts, streams, strict=True):
            advance(f"{part}: surface and flat map")
            skin = robot.skin(part)
            self.skins[part] = PreparedSkin(skin)
            self.fits[part] = measure_fit(skin, robot.mesh_under(part))
            _ = self.skins[part].flat
            advance(f"{part}: touches")
            recordings.append(simulate(skin, rng=rng, per_gesture=PER_GESTURE))
        hoods = concatenate([skin.hoods for skin in self.skins.values()])
        advance("structures")
        self.plain = find_structures(hoods, rotations=1)
        advance("structures with rotation")
        self.rotated = find_structures(hoods, rotations=6)
        self.split = split = split_touches(self.skins, recordings, self.train_parts, rng=draw)
        self.models: dict[str, TouchClassifier] = {}
        self.scores: dict[str, tuple[Score, Score]] = {}
        for method in METHODS:
            advance(f"training: {method}")
            model = classifiers.get(method)().fit(split.train, rng=draw)
            advance(f"testing: {method}")
            self.models[method] = model
            self.scores[method] = score(model, split.same_parts), score(model, split.other_parts)


def training_parts(parts: Sequence[str]) -> tuple[str, ...]:
    """Every other kind of part, left and right being one kind; the first part if all are one."""
    kinds = list(dict.fromkeys(_kind(part) for part in parts))
    if len(kinds) < 2:
        return tuple(parts[:1])
    return tuple(part for part in parts if kinds.index(_kind(part)) % 2 == 0)


def _kind(part: str) -> str:
    return part.removeprefix("left_").removeprefix("right_")


def demo_result(analysis: Analysis, seed: int, files: list[str], seconds: float) -> DemoResult:
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
            )
            for name, pair in analysis.scores.items()
            for where, one in zip(("same_parts", "other_parts"), pair, strict=True)
        ],
        seed=seed,
        files=files,
        seconds=seconds,
    )


def run_demo(
    robot: Robot,
    parts: Sequence[str],
    out: Path,
    *,
    seed: int,
    advance: Callable[[str], None],
) -> DemoResult:
    """Analyse the parts, write everything into `out` and return the numbers.

    Raises
    ------
    OutputError
        `out` cannot be written to; nothing is left half written.
    """
    started = time.perf_counter()
    with staged_folder(out) as folder:
        analysis = Analysis(robot, parts, seed=seed, advance=advance)
        (folder / "flatmaps").mkdir()
        for part, skin in analysis.skins.items():
            advance(f"{part}: picture of the flat map")
            save_figure(part_figure(skin.flat), folder / "flatmaps" / f"{part}.png")
        advance("picture of the structures")
        structures_figure(analysis.skins, analysis.rotated, folder / "structures.png")
        advance("still and movie")
        movie = _show(analysis, folder, seed)
        advance("report")
        pictures = [f"flatmaps/{part}.png" for part in analysis.skins]
        files = [PICTURE, "structures.png", movie, *pictures, PAGE, NUMBERS]
        result = demo_result(analysis, seed, files, time.perf_counter() - started)
        (folder / PAGE).write_text(demo_page(result, folder), "utf-8")
        numbers = json.dumps(plain(result), indent=2)
        (folder / NUMBERS).write_text(numbers + "\n", encoding="utf-8")
    return result


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
    yield f"{result.seconds:.0f} s; {PAGE} shows all of it:"


def demo_page(result: DemoResult, folder: Path) -> str:
    """The report, from the numbers and the pictures that lie in the folder."""
    movie = next(name for name in result.files if Path(name).stem == Path(MOVIE).stem)
    return page(
        result.robot,
        [
            note(f"Skinmap demo, seed {result.seed}, {result.seconds:.0f} s"),
            cards(_figures(result)),
            heading("Touches on the body"),
            media(folder / PICTURE, "named touches on the body"),
            note(
                "Simulated touches on parts that the classifier was never trained on. Boxes: the "
                "name given and its confidence."
            ),
            heading("As they come"),
            media(folder / movie, "simulated touches as they come"),
            heading("How often the name is right"),
            _accuracy(result).html(),
            note(
                "Simulated touches, counted per touch event; trained on "
                f"{', '.join(result.trained_on)} ({result.touches.train} touches). No tested "
                "touch, and for other parts no part or mirror image, was trained on. A gesture "
                "that does not fit a part is not simulated there."
            ),
            heading("Flat maps"),
            grid(media(folder / "flatmaps" / f"{part}.png", part) for part in result.parts),
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
    rows: list[list[Cell]] = [
        [
            row.classifier,
            row.tested_on.replace("_", " "),
            row.touches,
            _percent(row.accuracy),
            *(_percent(row.per_label.get(label)) for label in labels),
        ]
        for row in result.table
    ]
    names = [label.replace("_", " ") for label in labels]
    heads = ("classifier", "tested on", "touches", "all", *names)
    return Table(heads, rows)


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _show(analysis: Analysis, folder: Path, seed: int) -> str:
    """Write the still and the movie of touches on parts that were never trained on.

    The name of the movie comes back: without ffmpeg it is a .gif.
    """
    tested = [part for part in analysis.skins if part not in analysis.train_parts][:SHOWN]
    with tempfile.TemporaryDirectory(prefix="skinmap-") as place:
        model = Path(place) / "demo.skinmodel"
        save_classifier(analysis.models["contact-geometry"], model)
        # Apart from the streams that train and test.
        rngs = np.random.default_rng([seed, 1]).spawn(len(tested))
        source = Path(place) / "touches.npz"
        recordings = [
            simulate(analysis.skins[part].skin, rng=rng, per_gesture=1)
            for part, rng in zip(tested, rngs, strict=True)
        ]
        save_recordings(recordings, source, robot=analysis.robot)
        session = Session(
            analysis.robot,
            tuple(tested),
            source=str(source),
            model=model,
            skins=dict(analysis.skins),
        )
        wanted = Wanted(screenshot=folder / PICTURE, movie=folder / MOVIE)
        shown = write_files(session, Look(), wanted)
    return next(Path(file).name for file in shown.files if Path(file).stem == Path(MOVIE).stem)
