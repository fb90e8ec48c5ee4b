"""Plots of periodic structures: each of them once, and where on the flat maps."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.neighbours.structures import Structures
from skinmap.report.page import MM, plain_figure, save_figure
from skinmap.touch.histograms.codebook import COUNTS, Codebook, learn_codebook, patterns
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate

GREY = "#b4bac1"
COLOURS = 40  # structures with a colour of their own; more could not be distinguished
COLUMNS = 12
TOUCHES, SAMPLES = 6, 400  # of each gesture, and of what they read: for codewords
LEAST = 10.0  # of what a panel shows, wide and high [mm]: one taxel has no size
BARS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # mm
CELL = np.array([2.1, 2.5])  # of a structure, in its reaches: wide, high with its words


def structures_figure(skins: Mapping[str, PreparedSkin], found: Structures, path: Path) -> None:
    """Each structure once, and the flat maps of all parts coloured by structure."""
    palette = structure_colours(len(found.prototypes))
    rows = max(-(-len(found.prototypes) // COLUMNS), 1)
    width = len(skins) if len(skins) < 4 else -(-len(skins) // 3)
    maps = 7.5 if len(skins) >= 4 else 4.5
    figure = plain_figure((13.0, 1.25 * rows + 0.4 + maps))
    top, bottom = figure.subfigures(2, 1, height_ratios=[1.25 * rows + 0.4, maps])
    _draw_prototypes(top.subplots(), found, palette)
    more = f" ({COLOURS} colours, rarer ones black)" if len(found.prototypes) > COLOURS else ""
    turned = "with" if found.prototypes.rotations > 1 else "without"
    top.suptitle(
        f"{len(found.prototypes)} structure{'s' * (len(found.prototypes) != 1)} {turned} "
        f"rotation{more}; number: taxels that have it; hollow: optional",
        fontsize=11,
    )
    every = np.split(found.labels, np.cumsum([len(skin) for skin in skins.values()])[:-1])
    for place, ((name, skin), labels) in enumerate(zip(skins.items(), every, strict=True)):
        axis = bottom.add_subplot(-(-len(skins) // width), width, place + 1)
        _draw_members(axis, skin.flat.uv * MM, labels, palette)
        axis.set_title(name, fontsize=9, pad=2, y=1.0)
    save_figure(figure, path)


def codewords_figure(skins: Mapping[str, PreparedSkin], found: Structures, path: Path) -> None:
    """The commonest structures with their codewords below them, and what each taxel votes for.

    Codewords are learnt from simulated touches of the largest part; one of these is drawn with its
    pressures, the pressure of the codeword that each taxel votes for, and that word's number.
    """
    name = max(skins, key=lambda one: len(skins[one]))
    start = sum(len(skins[one]) for one in list(skins)[: list(skins).index(name)])
    own = slice(start, start + len(skins[name]))
    touches = simulate(skins[name].skin, rng=0, per_gesture=TOUCHES)
    touched = touches.pressures[(touches.pressures > 0).any(axis=1)]
    chosen = np.random.default_rng(0).permutation(len(touched))[:SAMPLES]
    samples = np.zeros((len(chosen), len(found.labels)), np.uint8)
    samples[:, own] = touched[chosen]
    book = learn_codebook([(found, samples)], rng=0)
    widest = samples[[np.count_nonzero(samples > COUNTS / 10.0, axis=1).argmax()]] / COUNTS
    word, heart = np.zeros(len(found.labels), np.int64), np.zeros(len(found.labels))
    for s in range(len(book.prototypes)):
        seen, members = patterns(found, s, widest)[0], found.labels == s
        gap = ((seen[:, None] - book.words[s]) ** 2).sum(axis=2)
        word[members] = np.where(np.isnan(gap), np.inf, gap).argmin(axis=1)
        heart[members] = book.words[s, word[members], 0]
    figure = plain_figure((13.0, 9.0))
    top, bottom = figure.subfigures(2, 1, height_ratios=[5.2, 3.8])
    _draw_words(top.subplots(), found, book, found.labels[own])
    top.suptitle(
        f"codewords (rows) of the commonest structures of {name} (columns, with number of taxels), "
        f"of {len(samples)} simulated samples; dark: pressed",
        fontsize=11,
    )
    heads = ("a touch: pressure", "its codewords: pressure of the middle", "number of the codeword")
    uv = skins[name].flat.uv * MM
    for axis, head, values in zip(
        bottom.subplots(1, 3), heads, (widest[0], heart, word), strict=True
    ):
        colours, low, high = ("tab10", -0.5, 9.5) if values is word else ("magma_r", 0.0, 1.0)
        dots = axis.scatter(*uv.T, s=16, edgecolors=GREY, linewidths=0.3, c=values[own],
                            cmap=colours, vmin=low, vmax=high)  # fmt: skip
        key = bottom.colorbar(dots, ax=axis, shrink=0.6)
        if values is word:
            key.set_ticks(range(book.words.shape[1]))
            key.ax.set_ylim(-0.5, book.words.shape[1] - 0.5)
        axis.set_title(head, fontsize=9)
        axis.set_aspect("equal")
        axis.set_axis_off()
    save_figure(figure, path)


def _draw_words(axis: Any, found: Structures, book: Codebook, labels: IntArray) -> None:
    """Draw the words of the commonest labels, each as its middle and its neighbours."""
    shapes = found.prototypes
    counts = np.bincount(labels[labels >= 0], minlength=len(shapes))
    common = np.argsort(-counts, kind="stable")[: min(COLUMNS, np.count_nonzero(counts))]
    reach = 1.15 * float(np.linalg.norm(shapes.offsets, axis=2).max(initial=1e-3)) * MM
    for column, s in enumerate(common.tolist()):
        around = np.concatenate([[[0.0, 0.0]], shapes.offsets[s][shapes.filled[s]] * MM])
        for row, word in enumerate(book.words[s]):
            if np.isnan(word).all():
                continue
            x, y = (around + np.array([2.7 * column, -2.1 * row]) * reach).T
            levels = word[: len(around)]
            axis.scatter(x, y, s=30, c=levels, cmap="magma_r", vmin=0.0, vmax=1.0,
                         edgecolors=GREY, linewidths=0.5)  # fmt: skip
        axis.text(2.7 * column * reach, 1.2 * reach, f"{s}: {counts[s]}", ha="center")
    for row in range(book.words.shape[1]):
        axis.text(-1.7 * reach, -2.1 * row * reach, f"{row}", ha="center", va="center")
    axis.set_aspect("equal")
    axis.set_axis_off()


def structure_colours(n: int) -> FloatArray:
    """(n, 4) colours, one each for the most common structures, black for all others."""
    from matplotlib import colormaps

    # tab20 pairs strong with pale: strong ones first.
    order = [*range(0, 20, 2), *range(1, 20, 2)]
    known = np.concatenate([colormaps[name](np.array(order)) for name in ("tab20", "tab20b")])
    colours = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    colours[: len(known)] = known[:n]
    return colours


def _draw_prototypes(axis: Any, found: Structures, palette: FloatArray) -> None:
    """Draw each structure in a cell of its own, its number and count of taxels above it."""
    shapes, order = found.prototypes, np.arange(len(found.prototypes))
    reach = 1.15 * float(np.linalg.norm(shapes.offsets, axis=2).max(initial=1e-3)) * MM
    centres = np.column_stack([order % COLUMNS, -(order // COLUMNS)]) * CELL * reach
    points = centres[:, None] + shapes.offsets * MM
    maybe = shapes.filled & ~shapes.required
    axis.plot(*points[maybe].T, "o", color="white", markeredgecolor=GREY, markersize=4.5)
    axis.plot(*points[shapes.required].T, "o", color=GREY, markersize=4.5)
    axis.scatter(*centres.T, s=42, c=palette, edgecolors="black", zorder=3)
    for s, (x, y) in enumerate(centres.tolist()):
        axis.text(x, y + reach, f"{s}: {found.counts[s]}", fontsize=8, ha="center")
    rows = -(-len(order) // COLUMNS)
    axis.set_xlim(-reach, (CELL[0] * (COLUMNS - 1) + 1.0) * reach)
    axis.set_ylim(-(CELL[1] * max(rows - 1, 0) + 1.0) * reach, 1.4 * reach)
    axis.set_aspect("equal")
    axis.set_axis_off()
    _draw_bar(axis)


def _draw_members(axis: Any, places: FloatArray, labels: IntArray, palette: FloatArray) -> None:
    known = labels >= 0
    axis.scatter(*places[known].T, s=7, linewidths=0, color=palette[labels[known]], zorder=3)
    axis.scatter(*places[~known].T, s=7, color=GREY, marker="x", zorder=3)
    axis.set_aspect("equal")
    axis.autoscale_view()
    for low, high, setter in ((*axis.get_xlim(), axis.set_xlim), (*axis.get_ylim(), axis.set_ylim)):
        middle, half = 0.5 * (low + high), 0.5 * max(high - low, LEAST)
        setter(middle - half, middle + half)
    axis.set_axis_off()
    _draw_bar(axis)


def _draw_bar(axis: Any) -> None:
    """A bar of a round length [mm] below the left corner of what is drawn."""
    (left, right), (low, high) = axis.get_xlim(), axis.get_ylim()
    length = max(one for one in BARS if one <= max(0.15 * (right - left), BARS[0]))
    step = 0.02 * max(high - low, right - left)
    below = low - step
    axis.plot([left, left + length], [below, below], color="black", linewidth=1.5, clip_on=False)
    label = f"{length:g} mm"
    axis.text(left, below - 0.5 * step, label, fontsize=7, va="top")
