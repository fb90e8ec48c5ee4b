"""`skinmap demo`: the numbers, the pictures, the movie and the report of the first run."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from skinmap.flat.distortion import spread
from skinmap.io.output import staged_folder
from skinmap.io.recordings.touch_files import save_recordings
from skinmap.recognition.model_file import save_classifier
from skinmap.report.flat_figures import part_figure
from skinmap.report.page import cards, grid, heading, media, note, page, save_figure
from skinmap.report.present import PAGE
from skinmap.report.result import plain
from skinmap.report.structure_figures import structures_figure
from skinmap.report.table import Cell, Table
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate
from viewer.analysis import Analysis, analyse, demo_result
from viewer.results import DemoResult, DemoSeconds, OtherPhysics, ScoreRow
from viewer.view_files import Wanted, write_files
from viewer.view_options import Look, Session

NUMBERS = "demo.json"
PICTURE, MOVIE = "robot.png", "replay.mp4"
STEPS = 11  # progress steps beside those per part
SHOWN = 6  # parts that are touched at most: more labels than that cannot be read


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
        analysis = analyse(robot, parts, seed=seed, advance=advance)
        analysed = time.perf_counter()
        (folder / "flatmaps").mkdir()
        for part, skin in analysis.skins.items():
            advance(f"{part}: picture of the flat map")
            save_figure(part_figure(skin.flat), folder / "flatmaps" / f"{part}.png")
        advance("picture of the structures")
        structures_figure(analysis.skins, analysis.rotated, folder / "structures.png")
        advance("still and movie")
        movie = _show(analysis, folder, seed)
        drawn = time.perf_counter()
        advance("report")
        pictures = [f"flatmaps/{part}.png" for part in analysis.skins]
        files = [PICTURE, "structures.png", movie, *pictures, PAGE, NUMBERS]
        seconds = DemoSeconds(
            analysis=analysed - started, pictures=drawn - analysed, total=drawn - started
        )
        result = demo_result(analysis, seed, files, seconds)
        (folder / PAGE).write_text(demo_page(result, folder, analysis.skins), "utf-8")
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
    if result.physics is not None:
        yield f"  pressed by MuJoCo instead: {_range(result.physics)} (kept from an evaluation)"
    yield f"{result.seconds.total:.0f} s; {PAGE} shows all of it:"


def demo_page(result: DemoResult, folder: Path, skins: Mapping[str, PreparedSkin]) -> str:
    """The report, from the numbers and the pictures that lie in the folder."""
    movie = next(name for name in result.files if Path(name).stem == Path(MOVIE).stem)
    return page(
        result.robot,
        [
            note(f"Skinmap demo, seed {result.seed}, {result.seconds.total:.0f} s"),
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
                    round(100 * found.edge_rms, 2), round(angle.mean or 0.0, 4),
                    round(found.area_sd, 4),
                )
            )  # fmt: skip
    return Table(
        ("part", "patch", "taxels", "holes", "method", "flips", "edge rms [%]",
         "quasi-conformal", "area sd"),
        rows,
    )  # fmt: skip


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
