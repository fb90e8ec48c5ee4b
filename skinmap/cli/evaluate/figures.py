"""Pictures of evaluations: tables as bars, the sweep of r and k, accuracy by patch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from skinmap.cli.evaluate.result.cross_patch import CrossPatchResult
from skinmap.cli.evaluate.result.in_time import TimeResult
from skinmap.cli.evaluate.result.kaspar import KasparResult, SweepRow
from skinmap.cli.evaluate.result.real_skin import FingersResult, HandsResult
from skinmap.cli.evaluate.result.recordings import RecordingsResult
from skinmap.report.figure import plain_figure, save_figure
from skinmap.report.result import given

BLUE, ORANGE, GREY = "#3b6ea8", "#d98032", "#9aa3ad"
CONTACTS = (
    BLUE, ORANGE, "#2f8f6b", "#a83b5e", "#7a5ea8", "#b8a32e", "#3ba0a8", "#6b4a2b", "#5a6470",
)  # fmt: skip
COLOURS = (BLUE, "#7fa6d0", "#2f8f6b", ORANGE, "#e8b98a")


def kaspar_figure(result: KasparResult, path: Path) -> None:
    """Accuracy by features, plain folds beside folds by event, the paper's as lines."""
    percents = list(dict.fromkeys(row.percent for row in result.table))
    figure = plain_figure((5.6 * len(percents), 5.0))
    axes = figure.subplots(1, len(percents), sharey=True, squeeze=False)[0]
    for axis, percent in zip(axes, percents, strict=True):
        rows = [row for row in result.table if row.percent == percent]
        kinds = list(dict.fromkeys(row.folds for row in rows))
        pairs = list(dict.fromkeys((row.features, row.classifier) for row in rows))
        for number, (features, classifier) in enumerate(pairs):
            own = [row for row in rows if (row.features, row.classifier) == pairs[number]]
            place = np.arange(len(kinds)) + 0.16 * (number - (len(pairs) - 1) / 2)
            values = [100.0 * row.mean for row in own]
            spread = [100.0 * (given(row.std) or 0.0) for row in own]
            label = f"{features}, {classifier}"
            axis.bar(place, values, 0.15, yerr=spread, color=COLOURS[number % 5], label=label)
        for row in result.paper:
            if row.percent == percent:
                style = "-" if row.features == "histogram" else "--"
                text = f"paper: {row.features}, plain folds, real touches"
                axis.axhline(100.0 * row.mean, color="black", lw=1.0, ls=style, label=text)
        axis.set_xticks(range(len(kinds)), [f"{kind} folds" for kind in kinds])
        axis.set_title(f"{percent} % of the samples")
        axis.set_ylim(25.0, 100.0)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("mean of the classes [%], simulated")
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8
    )
    figure.suptitle(f"{result.robot} {result.part}: four touches, 4 folds")
    save_figure(figure, path)


def sweep_figure(rows: Sequence[SweepRow], path: Path) -> None:
    """Accuracy over radius and codewords, a number in each cell."""
    words = list(dict.fromkeys(row.words for row in rows))
    radii = list(dict.fromkeys(row.radius_mm for row in rows))
    cells = {(row.radius_mm, row.words): row for row in rows}
    values = np.array([[100.0 * cells[r, k].mean for k in words] for r in radii])
    figure = plain_figure((7.6, 4.6))
    axis = figure.subplots()
    image = axis.imshow(values, cmap="viridis", aspect="auto")
    middle = 0.5 * (values.min() + values.max())
    for (row, column), value in np.ndenumerate(values):
        spread = cells[radii[row], words[column]].std
        text = f"{value:.1f}\n± {100.0 * spread:.1f}" if spread else f"{value:.1f}"
        colour = "white" if value < middle else "black"
        axis.text(column, row, text, ha="center", va="center", color=colour, fontsize=8)
    axis.set_xticks(range(len(words)), [str(k) for k in words])
    labels = [
        f"{r:g} mm ({cells[r, words[0]].neighbours}, {cells[r, words[0]].structures})"
        for r in radii
    ]
    axis.set_yticks(range(len(radii)), labels)
    axis.set_xlabel("codewords a structure k, rest included")
    axis.set_ylabel("radius r (neighbours of most taxels, structures)")
    axis.set_title("Histograms by radius and codewords, folds by event", fontsize=11)
    figure.colorbar(image, ax=axis, label="mean of the classes [%], simulated")
    save_figure(figure, path)


def patches_figure(result: CrossPatchResult, path: Path) -> None:
    """Accuracy of each classifier on each patch."""
    patches = list(result.patches)
    rows = result.rows
    values = np.array([[100.0 * row.per_patch[name] for name in patches] for row in rows])
    figure = plain_figure((max(2.8 + 0.45 * len(patches), 6.5), 2.8 + 0.55 * len(rows)))
    axis = figure.subplots()
    image = axis.imshow(values, cmap="viridis", vmin=0.0, vmax=100.0, aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        colour = "white" if value < 60.0 else "black"
        axis.text(column, row, f"{value:.0f}", ha="center", va="center", color=colour, fontsize=8)
    names = [f"{name} ({result.patches[name]})" for name in patches]
    axis.set_xticks(range(len(patches)), names, rotation=60, ha="right", fontsize=8)
    labels = [f"{row.features}: {100 * row.mean:.1f}" for row in rows]
    axis.set_yticks(range(len(rows)), labels)
    trained = result.train_robot
    how = f"trained on {trained}" if trained else "trained on all other patches"
    figure.suptitle(
        f"{result.robot}: touches named right on each patch [%]\n{how} (simulated)", fontsize=11
    )
    figure.colorbar(image, ax=axis, pad=0.01)
    save_figure(figure, path)


def time_figure(result: TimeResult, path: Path) -> None:
    """Accuracy against the share of a touch seen, and by gesture with and without motion."""
    figure = plain_figure((11.0, 4.6))
    course, bars = figure.subplots(1, 2, width_ratios=(1.0, 1.4))
    for number, key in enumerate(dict.fromkeys((r.features, r.tested_on) for r in result.rows)):
        own = [row for row in result.rows if (row.features, row.tested_on) == key]
        seen, mean = [100 * row.seen for row in own], [100 * row.mean for row in own]
        course.plot(seen, mean, "o-", color=COLOURS[number % 5], label=", ".join(key))
    course.set_xlabel("seen of the touch [%]")
    course.set_ylabel("mean of the classes [%], simulated")
    course.set_ylim(0.0, 100.0)
    course.legend(fontsize=8, frameon=False)
    whole = [row for row in result.rows if row.seen == 1.0 and row.tested_on == "ours"]
    place = np.arange(len(result.gestures))
    for shift, (row, colour) in enumerate(zip(whole, (GREY, BLUE), strict=False)):
        values = [100.0 * row.per_class.get(name, 0.0) for name in result.gestures]
        bars.bar(place + 0.38 * (shift - 0.5), values, 0.36, color=colour, label=row.features)
    bars.set_xticks(place, result.gestures, rotation=30, ha="right")
    bars.set_ylim(0.0, 100.0)
    bars.legend(fontsize=8, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    for axis in (course, bars):
        axis.spines[["top", "right"]].set_visible(False)
    figure.suptitle(f"{result.robot}: touches in time, parts and people left out")
    save_figure(figure, path)


def fingers_figure(result: FingersResult, path: Path) -> None:
    """Fingers that touched against fingers counted, by each method."""
    rows = (result.live, result.width, result.chosen, result.trained)
    figure = plain_figure((4.2 * len(rows), 4.6))
    for axis, row in zip(figure.subplots(1, len(rows), squeeze=False)[0], rows, strict=True):
        values = np.array(row.confusion)
        values = values[: max(map(int, result.recordings)) + 1]
        share = 100.0 * values / np.maximum(values.sum(axis=1, keepdims=True), 1e-9)
        axis.imshow(share, cmap="viridis", vmin=0.0, vmax=100.0, aspect="auto")
        for (true, counted), value in np.ndenumerate(share):
            if value >= 0.5:
                colour = "white" if value < 60.0 else "black"
                axis.text(
                    counted,
                    true,
                    f"{value:.0f}",
                    ha="center",
                    va="center",
                    color=colour,
                    fontsize=9,
                )
        axis.set_xticks(range(share.shape[1]))
        axis.set_yticks(range(share.shape[0]))
        axis.set_xlabel("counted")
        control = f"control {100 * row.control:.0f}"
        axis.set_title(f"{row.method}\n{100 * row.exact:.0f} % exact, {control}", fontsize=10)
    figure.axes[0].set_ylabel("fingers that touched")
    figure.suptitle(f"{result.robot}: real fingers, share of the recordings of each row [%]")
    save_figure(figure, path)


def hands_figure(result: HandsResult, path: Path) -> None:
    """Contact images of grasps as published, and below each the contacts on the flat map."""
    from skinmap.cli.evaluate.hands import follow, shown
    from skinmap.io.recordings.cyskin_arrays import read_pressed
    from skinmap.touch.paper_image import paper_images
    from skinmap.touch.prepared_skin import PreparedSkin

    data = read_pressed(Path(result.archive), Path(result.patch))
    skin = PreparedSkin(data.skin)
    seen = follow(skin, data)
    samples = shown(seen)
    pressures = np.concatenate(data.files)[samples]
    figure = plain_figure((2.3 * len(samples), 5.4))
    rows = figure.subplots(2, len(samples), squeeze=False, height_ratios=(0.6, 1.0))
    places = skin.flat.uv * 1e3
    for column, image in enumerate(paper_images(skin.image_geometry, pressures)):
        above, below = rows[:, column]
        above.imshow(image, cmap="gray", vmin=0, vmax=255)
        owner = seen.owners[samples[column]]
        below.scatter(*places[owner < 0].T, s=2.0, color="#d5d9de")
        for number in range(int(owner.max()) + 1):
            own = owner == number
            below.scatter(*places[own].T, s=9.0, color=CONTACTS[number % len(CONTACTS)])
        below.set_aspect("equal")
        below.set_title(f"{owner.max() + 1} contacts", fontsize=9)
        for axis in (above, below):
            axis.set_xticks([])
            axis.set_yticks([])
            axis.spines[:].set_visible(False)
    figure.suptitle(f"{result.robot}: contact images of real hands, and contacts on the flat map")
    save_figure(figure, path)


def leak_figure(result: RecordingsResult, path: Path) -> None:
    """Accuracy of each classifier, plain folds beside folds by event."""
    names = list(dict.fromkeys(row.classifier for row in result.table))
    figure = plain_figure((2.5 + 1.1 * len(names), 4.6))
    axis = figure.subplots()
    for shift, (kind, colour) in enumerate((("event", BLUE), ("plain", GREY))):
        rows = [row for row in result.table if row.folds == kind]
        place = np.arange(len(names)) + 0.38 * (shift - 0.5)
        values = [100.0 * row.mean for row in rows]
        spread = [100.0 * (given(row.std) or 0.0) for row in rows]
        axis.bar(place, values, 0.36, yerr=spread, color=colour, label=f"{kind} folds")
    axis.set_xticks(range(len(names)), names, rotation=30, ha="right")
    axis.set_ylabel("mean of the classes [%]")
    axis.set_ylim(0.0, 100.0)
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper right", ncols=2)
    save_figure(figure, path)
