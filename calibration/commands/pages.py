"""Reports of calibrations: the verdict, numbers in words, pictures, what to do next."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.commands.results import MM, PatchResult
from calibration.files.tables import BoardTable
from calibration.patch.patch_calibration import PatchCalibration
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.proximity import closest_on_mesh
from skinmap.geometry.rigid import transform_points
from skinmap.geometry.triangles import face_normals, unit
from skinmap.report.page import (
    facts,
    heading,
    image,
    note,
    page,
    paragraph,
    picture_bytes,
    plain_figure,
    verdict_lines,
)
from skinmap.report.projection import View, draw_surface
from skinmap.report.table import Table

if TYPE_CHECKING:
    from calibration.commands.results import Calibrated
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
WORDS = {
    "ok": "The patch may be used as it is.",
    "low_coverage": "The evidence covers too little of the patch.",
    "ambiguous": "The measurements do not determine the place of the patch.",
    "unobservable": "The patch can still move freely in some way.",
    "not_settled": "The search ended before it came to rest.",
}
TURN = np.radians(50.0)  # of each of the two side views
MARGIN = 12e-3  # round the patch: what of the link lies further is cut off [m]
SHADES = "viridis"
MAX_NAMED = 24  # taxels with evidence that are named


def judged_page(
    title: str,
    result: Calibrated,
    rows: Iterable[tuple[str, str]],
    pictures: Sequence[Picture],
) -> str:
    """A whole page.

    Parameters
    ----------
    title : str
    result : Calibrated
        Its status and reasons come first.
    rows : iterable of two str
        Numbers in words.
    pictures : sequence of Picture
    """
    shown = [heading(head) + note(words) + image(png, head) for head, png, words in pictures]
    return page(title, [verdict_lines(result.verdict(accept=False)), facts(rows), *shown])


def taxel_picture(positions: FloatArray, sd: FloatArray) -> bytes:
    """PNG: taxels (n, 3) [m] in the frame of their link, coloured by sd (n,) [m].

    From above and from beside, the nearer ones in front.
    """
    middle = positions.mean(axis=0)
    _, _, axes = np.linalg.svd(positions - middle, full_matrices=False)
    across = MM * (positions - middle) @ axes.T
    figure = plain_figure((9.4, 3.8))
    both = figure.subplots(1, 2)
    for axis, (up, depth) in zip(both, ((1, 2), (2, 1)), strict=True):
        order = np.argsort(across[:, depth])
        places = across[order][:, (0, up)].T
        shown = axis.scatter(*places, c=MM * sd[order], s=14, cmap="viridis")
        axis.set_aspect("equal")
        axis.set_xlabel("along the patch [mm]")
        axis.set_ylabel(("across the patch [mm]", "out of the patch [mm]")[up - 1])
    figure.colorbar(shown, ax=list(both), shrink=0.8).set_label("predicted error [mm]")
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
    axes[1].xaxis.get_major_locator().set_params(integer=True)
    axes[0].legend(frameon=False, ncols=6, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return picture_bytes(figure)


def scan_picture(
    found: ScanRegistration, points: FloatArray, link: tuple[FloatArray, IntArray]
) -> bytes:
    """PNG of the scan on the mesh from two sides, coloured by how far it lies off."""
    vertices, faces = link
    here = transform_points(found.T_mesh_scan, points)[:: max(1, len(points) // MAX_DRAWN)]
    distance, _, _ = closest_on_mesh(here, vertices, faces)
    off = MM * distance
    figure = plain_figure((9.0, 4.2))
    axes = figure.subplots(1, 2)
    drawn = faces[:: max(1, len(faces) // MAX_FACES)]
    for axis, view in zip(axes, _views(vertices), strict=True):
        _draw_link(axis, view, vertices, drawn)
        places = view.project(MM * here)
        order = np.argsort(places[:, 2])
        shown = axis.scatter(
            *places[order, :2].T, c=off[order], s=3, cmap="viridis", vmin=0, vmax=FAR_MM, zorder=3
        )
        axis.margins(0.05)
    figure.colorbar(shown, ax=list(axes), extend="max").set_label("distance from the mesh [mm]")
    return picture_bytes(figure)


def _draw_link(axis: Any, view: View, vertices: FloatArray, faces: IntArray) -> None:
    """Faces of a link in grey, on an axis in mm: of both turns, as visual meshes have them."""
    normals = face_normals(vertices, faces)
    grey = np.tile([0.80, 0.82, 0.85, 1.0], (len(faces), 1))
    draw_surface(axis, view, MM * vertices[faces], normals, grey, both_sides=True)
    axis.set_aspect("equal")
    axis.set_title(view.name, fontsize=9)
    axis.set_xlabel("mm", fontsize=8)
    axis.tick_params(labelsize=7)


def _views(vertices: FloatArray) -> list[View]:
    _, axes = np.linalg.eigh(np.cov(vertices.T))
    thin, middle, long = axes.T
    return [View("across its short axis", thin, long), View("across its middle axis", middle, long)]


def patch_page(
    title: str,
    result: PatchResult,
    found: PatchCalibration,
    board: BoardTable,
    link: tuple[FloatArray, IntArray],
    kind: str,
) -> str:
    """The whole page.

    Parameters
    ----------
    title : str
        What was laid on what.
    result : PatchResult
        What the command prints as JSON.
    found : PatchCalibration
    board : BoardTable
        Seen from outside.
    link : (v, 3) array of float [m], (f, 3) array of int
    kind : str
        "anchors" or "touches": what the patch was calibrated by.
    """
    rows = {int(channel): row for row, channel in enumerate(board.channels)}
    taxels = np.array([rows[one.channel] for one in result.evidence], np.int64)
    drawn = board_picture(found, board.layout, board.channels, kind, taxels)
    return page(
        title,
        [
            verdict_lines(result.verdict(accept=False), WORDS[result.status]),
            facts(_numbers(result)),
            heading("On the link"),
            image(patch_picture(found, link), "patch on its link, coloured by predicted error"),
            heading("On the board"),
            image(drawn, "board, by predicted error"),
            paragraph(
                f"Weakest direction: {result.weakest}. Measure next: channels "
                f"{', '.join(map(str, result.next))}, in this order."
            ),
            heading(kind.capitalize()),
            note(
                f"How far each of the {kind} is from where it was laid, and from where all others "
                "predict it, beside the error that is expected there."
            ),
            _evidence(result).html(),
        ],
    )


def _numbers(result: PatchResult) -> list[tuple[str, str]]:
    sd, left, expected = (
        result.predicted_mm, result.leave_one_out_mm, result.leave_one_out_expected_mm
    )  # fmt: skip
    return [
        ("taxels", str(result.taxels)),
        ("predicted error, median", f"{sd.median:.2f} mm"),
        ("predicted error, 95 % of the taxels below", f"{sd.p95:.2f} mm"),
        ("predicted error, worst taxel", f"{sd.max:.2f} mm"),
        ("leave-one-out error, median (expected)",
         f"{left.median:.2f} mm ({expected.median:.2f} mm)"),
        ("leave-one-out error, worst (expected)", f"{left.max:.2f} mm ({expected.max:.2f} mm)"),
        ("strain, rms (expected of a flat map of this place)",
         f"{result.strain_percent:.2f} % ({result.expected_strain_percent:.2f} %)"),
        ("strain that was not expected, rms", f"{result.unexpected_strain_percent:.2f} %"),
        ("coverage: share of the patch inside the hull of the evidence",
         f"{100 * result.coverage:.0f} %"),
        ("scale of the body against the layout", f"{result.scale:.4f}"),
        ("layout drawn from the other side", "yes" if result.mirrored else "no"),
        ("mean height above the link", f"{result.height_mm:.2f} mm"),
    ]  # fmt: skip


def _evidence(result: PatchResult) -> Table:
    columns = ("channel", "missed by [mm]", "left out, missed by [mm]", "expected [mm]", "misfit")
    rows = [
        (one.channel, round(one.missed_mm, 2), round(one.leave_one_out_mm, 2),
         round(one.expected_mm, 2), round(one.misfit, 1))
        for one in result.evidence
    ]  # fmt: skip
    return Table(columns, rows)


def patch_picture(found: PatchCalibration, link: tuple[FloatArray, IntArray]) -> bytes:
    """PNG of the patch on its link from three sides, coloured by the predicted error."""
    sd = MM * found.predicted_sd
    views = _patch_views(found)
    figure = plain_figure((4.0 * len(views) + 0.8, 4.4))
    axes = figure.subplots(1, len(views))
    paint = _paint(sd)
    vertices, faces = link
    near = _near(found, vertices, faces)
    for axis, view in zip(axes, views, strict=True):
        _draw_link(axis, view, vertices, near)
        seen = found.normals @ view.out > 0.0
        points = view.project(MM * found.positions)
        colours = paint.to_rgba(sd[seen])
        axis.scatter(*points[seen, :2].T, c=colours, s=14, linewidths=0, zorder=3)
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        axis.set_xlim(low[0] - MM * MARGIN, high[0] + MM * MARGIN)
        axis.set_ylim(low[1] - MM * MARGIN, high[1] + MM * MARGIN)
    bar = figure.colorbar(paint, ax=axes, shrink=0.8)
    bar.set_label("predicted error [mm]")
    return picture_bytes(figure)


def board_picture(
    found: PatchCalibration,
    layout: FloatArray,
    channels: IntArray,
    kind: str,
    taxels: IntArray,
) -> bytes:
    """PNG of the flat board coloured by the predicted error, with the evidence on it.

    Parameters
    ----------
    found : PatchCalibration
    layout : (n, 2) array of float
        [m].
    channels : (n,) array of int
        Names of the taxels.
    kind : str
        What is known: "anchors" or "touches".
    taxels : (k,) array of int
        Where.
    """
    sd = MM * found.predicted_sd
    wide, tall = np.ptp(layout, axis=0)
    height = float(np.clip(7.5 * tall / max(wide, 1e-9), 2.5, 7.0))
    figure = plain_figure((8.6, height + 1.4))
    axis = figure.subplots()
    places = MM * layout
    paint = _paint(sd)
    axis.scatter(*places.T, c=paint.to_rgba(sd), s=26, linewidths=0)
    style = {"s": 110, "linewidths": 1.4, "edgecolors": "black", "label": kind}
    names = [str(channels[taxel]) for taxel in taxels[:MAX_NAMED]]
    _ring(axis, places[taxels], names, (6, 6), **style)
    following = found.next_taxels
    if len(following):
        style = {"s": 130, "linewidths": 1.6, "edgecolors": "#d3202f", "label": "measure next"}
        names = [f"{rank}: {channels[taxel]}" for rank, taxel in enumerate(following, start=1)]
        _ring(axis, places[following], names, (6, -13), marker="s", **style)
    axis.set_aspect("equal")
    axis.margins(0.08)
    axis.set_xlabel("mm on the board, seen from outside", fontsize=9)
    axis.tick_params(labelsize=8)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.colorbar(paint, ax=axis, shrink=0.8).set_label("predicted error [mm]")
    return picture_bytes(figure)


def _ring(
    axis: Any, places: FloatArray, names: Sequence[str], off: tuple[int, int], **style: Any
) -> None:
    """Marks round places (k, 2), and the names of the first of them."""
    axis.scatter(*places.T, facecolors="none", **style)
    for place, name in zip(places, names, strict=False):
        axis.annotate(
            name, place, xytext=off, textcoords="offset points", fontsize=8,
            color=style["edgecolors"],
        )  # fmt: skip


def _paint(values: FloatArray) -> Any:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    paint = ScalarMappable(Normalize(0.0, float(values.max())), SHADES)
    paint.set_array(values)
    return paint


def _patch_views(found: PatchCalibration) -> list[View]:
    """From the front of the patch and from both sides; its long axis up, or the link's z."""
    looks = unit(found.normals.mean(axis=0))
    _, _, axes = np.linalg.svd(found.positions - found.positions.mean(axis=0), full_matrices=False)
    up = axes[0] - (axes[0] @ looks) * looks
    up = unit(up if np.linalg.norm(up) > 0.1 else axes[1] - (axes[1] @ looks) * looks)
    side = np.cross(up, looks)
    names = {"from its left": -TURN, "from the front of the patch": 0.0, "from its right": TURN}
    return [
        View(name, np.cos(turn) * looks + np.sin(turn) * side, up) for name, turn in names.items()
    ]


def _near(found: PatchCalibration, vertices: FloatArray, faces: IntArray) -> IntArray:
    """Faces of the link round the patch, no more than can be seen."""
    low = found.positions.min(axis=0) - 5 * MARGIN
    high = found.positions.max(axis=0) + 5 * MARGIN
    middle = vertices[faces].mean(axis=1)
    near = faces[((middle > low) & (middle < high)).all(axis=1)]
    if len(near) == 0:  # huge triangles: all of them
        near = faces
    return near[:: max(1, len(near) // MAX_FACES)]
