"""Reports of mounts, responses and scans: the verdict, numbers in words, pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from calibration.commands.results import MM
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.proximity import closest_on_mesh
from skinmap.geometry.rigid import transform_points
from skinmap.geometry.triangles import face_normals
from skinmap.report.figure import picture_bytes, plain_figure
from skinmap.report.image import image
from skinmap.report.page import facts, heading, note, page, verdict_lines
from skinmap.report.projection import View, draw_surface
from skinmap.report.verdict import Verdict

if TYPE_CHECKING:
    from calibration.plane.fit import PlaneFit
    from calibration.response.response import ResponseCalibration
    from calibration.scan.registration import ScanRegistration

Picture = tuple[str, bytes, str]  # heading, PNG, and what one sees on it
PLACED = "Calibrated taxels from two sides, coloured by their predicted error."
FAR_MM = 3.0  # end of the colour scale of a scan
MAX_FACES, MAX_DRAWN = 30_000, 4_000  # of a mesh, and points of a scan
COLOURS = {
    "ok": "#00795c", "never touched": "#9aa5b1", "dead": "#1d2733", "stuck": "#7a3fb0",
    "saturated": "#b04a00", "noisy": "#d4a000",
}  # fmt: skip


def judged_page(
    title: str,
    verdict: Verdict,
    rows: Iterable[tuple[str, str]],
    pictures: Sequence[Picture],
) -> str:
    """A whole page.

    Parameters
    ----------
    title : str
    verdict : Verdict
        Comes first, with its reasons.
    rows : iterable of two str
        Numbers in words.
    pictures : sequence of Picture
    """
    shown = [heading(head) + note(words) + image(png, head) for head, png, words in pictures]
    return page(title, [verdict_lines(verdict), facts(rows), *shown])


def distance_picture(before: FloatArray | None, after: FloatArray) -> bytes:
    """PNG: how many touches miss by how much, before and after the fit [mm]."""
    figure = plain_figure((7.0, 3.2))
    axis = figure.subplots()
    both = after if before is None else np.concatenate([before, after])
    edges = np.linspace(0.0, MM * max(float(np.percentile(both, 99)), 1e-6), 41)
    if before is not None:
        axis.hist(MM * before, edges, color="#9aa5b1", label="as it came")
    axis.hist(MM * after, edges, color="#00795c", alpha=0.75, label="calibrated")
    axis.set_xlabel("distance of what touched [mm]")
    axis.set_ylabel("touches")
    axis.legend(frameon=False)
    return picture_bytes(figure)


def taxel_picture(positions: FloatArray, sd: FloatArray) -> bytes:
    """PNG: taxels (n, 3) [m] in the frame of their link, coloured by sd (n,) [m]."""
    return _two_sides(positions, MM * sd, "predicted error [mm]")


def coverage_picture(positions: FloatArray, touched: IntArray) -> bytes:
    """PNG: taxels (n, 3) [m], coloured by how often (n,) they felt a press; grey: never."""
    return _two_sides(positions, touched, "presses that it felt", touched > 0, 0.0)


def _two_sides(
    positions: FloatArray,
    values: FloatArray | IntArray,
    label: str,
    known: BoolArray | None = None,
    low: float | None = None,
) -> bytes:
    """PNG: points from above and from beside, the nearer ones in front, those unknown grey."""
    middle = positions.mean(axis=0)
    _, _, axes = np.linalg.svd(positions - middle, full_matrices=False)
    across = MM * (positions - middle) @ axes.T
    figure = plain_figure((9.4, 3.8))
    both = figure.subplots(1, 2)
    known = np.ones(len(positions), bool) if known is None else known
    for axis, (up, depth) in zip(both, ((1, 2), (2, 1)), strict=True):
        order = np.argsort(across[:, depth])
        seen, unseen = order[known[order]], order[~known[order]]
        axis.scatter(*across[unseen][:, (0, up)].T, c="#c9cfd6", s=12)
        shown = axis.scatter(
            *across[seen][:, (0, up)].T, c=values[seen], s=14, cmap="viridis", vmin=low
        )
        axis.set_aspect("equal")
        axis.set_xlabel("along the patch [mm]")
        axis.set_ylabel(("across the patch [mm]", "out of the patch [mm]")[up - 1])
    figure.colorbar(shown, ax=list(both), shrink=0.8).set_label(label)
    return picture_bytes(figure)


def response_picture(response: ResponseCalibration) -> bytes:
    """PNG: baseline, noise and threshold of each channel, coloured by its health."""
    figure = plain_figure((9.0, 5.0))
    axes = figure.subplots(2, 1, sharex=True)
    channel = np.arange(len(response))
    for state in dict.fromkeys(response.health.tolist()):
        own = response.health == state
        for axis, values in zip(axes, (response.baseline, response.noise), strict=True):
            axis.scatter(channel[own], values[own], s=9, color=COLOURS[state], label=state)
    axes[0].set_ylabel("baseline [counts]")
    axes[1].set_ylabel("noise [counts]")
    axes[1].set_xlabel("channel")
    axes[0].legend(frameon=False, ncols=6, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return picture_bytes(figure)


def contact_picture(fit: PlaneFit, contacts: int) -> bytes:
    """PNG: press depth of each contact against the common one, and the loss of its readings."""
    kept = np.setdiff1d(np.arange(contacts), fit.dropped)
    odd = np.isin(kept, fit.inconsistent)
    figure = plain_figure((9.4, 4.2))
    above, below = figure.subplots(2, 1, sharex=True)
    for rows, colour in ((~odd, "#00795c"), (odd, "#d4700a")):
        above.bar(kept[rows], MM * fit.depths[rows], color=colour)
        below.bar(kept[rows], fit.losses[rows], color=colour)
    above.axhline(0.0, color="#6b7580", linewidth=0.8)
    above.set_ylabel("extra depth [mm]")
    below.set_ylabel("misfit of its readings")
    below.set_xlabel("contact")
    return picture_bytes(figure)


def scan_picture(
    found: ScanRegistration, points: FloatArray, link: tuple[FloatArray, IntArray]
) -> bytes:
    """PNG of the scan on the mesh from two sides, and how far it lies off."""
    vertices, faces = link
    here = transform_points(found.T_mesh_scan, points)[:: max(1, len(points) // MAX_DRAWN)]
    distance, _, _ = closest_on_mesh(here, vertices, faces)
    off = MM * distance
    figure = plain_figure((11.0, 4.2))
    axes = figure.subplots(1, 3)
    drawn = faces[:: max(1, len(faces) // MAX_FACES)]
    grey = np.tile([0.80, 0.82, 0.85, 1.0], (len(drawn), 1))
    for axis, view in zip(axes[:2], _views(vertices), strict=True):
        normals = face_normals(vertices, drawn)
        draw_surface(axis, view, MM * vertices[drawn], normals, grey, both_sides=True)
        places = view.project(MM * here)
        order = np.argsort(places[:, 2])
        shown = axis.scatter(
            *places[order, :2].T, c=off[order], s=3, cmap="viridis", vmin=0, vmax=FAR_MM, zorder=3
        )
        axis.set_aspect("equal")
        axis.margins(0.05)
        axis.set_title(view.name, fontsize=9)
        axis.set_xlabel("mm", fontsize=8)
        axis.tick_params(labelsize=7)
    figure.colorbar(shown, ax=axes[1], extend="max").set_label("distance from the mesh [mm]")
    axes[2].hist(np.clip(off, 0, 2 * FAR_MM), bins=50, color="#3b6ea8")
    axes[2].set_xlabel(f"distance [mm], all above {2 * FAR_MM:g} in the last bar")
    axes[2].set_ylabel("points")
    axes[2].spines[["top", "right"]].set_visible(False)
    return picture_bytes(figure)


def _views(vertices: FloatArray) -> list[View]:
    _, axes = np.linalg.eigh(np.cov(vertices.T))
    thin, middle, long = axes.T
    return [View("across its short axis", thin, long), View("across its middle axis", middle, long)]
