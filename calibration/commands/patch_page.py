"""The report of a calibrated patch: pictures, numbers and what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calibration.commands.results import MM, PatchResult
from calibration.files.tables import BoardTable
from calibration.patch.patch_calibration import PatchCalibration
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.triangles import face_normals, unit
from skinmap.report.figure import picture_bytes, plain_figure
from skinmap.report.image import image
from skinmap.report.page import facts, heading, note, page, paragraph, verdict_lines
from skinmap.report.projection import View, draw_surface
from skinmap.report.table import Table

WORDS = {
    "ok": "The patch may be used as it is.",
    "low_coverage": "The evidence covers too little of the patch.",
    "ambiguous": "What was measured does not settle where the patch is.",
    "unobservable": "The patch can still move freely in some way.",
}
TURN = np.radians(50.0)  # of each of the two side views
MARGIN = 12e-3  # round the patch: what of the link lies further is cut off [m]
MAX_FACES = 30_000  # of the link: more cannot be seen at this size
COLOURS = "viridis"
MAX_NAMED = 24  # taxels with evidence that are named
MAX_DOTS = 4000  # pairs whose strain is drawn


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
    drawn = board_picture(found, board.layout, board.channels, {kind: taxels})
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
            heading("Predicted against measured"),
            note(
                f"Each of the {kind} where all others predict it, beside the error that is "
                "expected there (bars, and black lines); and the strain of the sheet beside the "
                "strain that a flat map of this place has (on the line where they agree)."
            ),
            image(judged_picture(result, found), "leave-one-out errors and strain"),
            heading(kind.capitalize()),
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
    views = _views(found)
    figure = plain_figure((4.0 * len(views) + 0.8, 4.4))
    axes = figure.subplots(1, len(views))
    paint = _paint(sd)
    vertices, faces = link
    near = _near(found, vertices, faces)
    normals = face_normals(vertices, near)
    grey = np.tile([0.80, 0.82, 0.85, 1.0], (len(near), 1))
    for axis, view in zip(axes, views, strict=True):
        # Visual meshes have faces of both turns: none is left out.
        draw_surface(axis, view, MM * vertices[near], normals, grey, both_sides=True)
        seen = found.normals @ view.out > 0.0
        points = view.project(MM * found.positions)
        colours = paint.to_rgba(sd[seen])
        axis.scatter(*points[seen, :2].T, c=colours, s=14, linewidths=0, zorder=3)
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        axis.set_xlim(low[0] - MM * MARGIN, high[0] + MM * MARGIN)
        axis.set_ylim(low[1] - MM * MARGIN, high[1] + MM * MARGIN)
        axis.set_aspect("equal")
        axis.set_title(view.name, fontsize=9)
        axis.set_xlabel("mm", fontsize=8)
        axis.tick_params(labelsize=7)
    bar = figure.colorbar(paint, ax=axes, shrink=0.8)
    bar.set_label("predicted error [mm]")
    return picture_bytes(figure)


def board_picture(
    found: PatchCalibration,
    layout: FloatArray,
    channels: IntArray,
    evidence: Mapping[str, IntArray],
) -> bytes:
    """PNG of the flat board coloured by the predicted error, with the evidence on it.

    Parameters
    ----------
    found : PatchCalibration
    layout : (n, 2) array of float
        [m].
    channels : (n,) array of int
        Names of the taxels.
    evidence : mapping of str to (k,) array of int
        What is known ("anchors"), and at which taxels.
    """
    sd = MM * found.predicted_sd
    wide, tall = np.ptp(layout, axis=0)
    height = float(np.clip(7.5 * tall / max(wide, 1e-9), 2.5, 7.0))
    figure = plain_figure((8.6, height + 1.4))
    axis = figure.subplots()
    places = MM * layout
    paint = _paint(sd)
    axis.scatter(*places.T, c=paint.to_rgba(sd), s=26, linewidths=0)
    for name, taxels in evidence.items():
        axis.scatter(
            *places[taxels].T, s=110, facecolors="none", edgecolors="black", linewidths=1.4,
            label=name,
        )  # fmt: skip
        for taxel in taxels[:MAX_NAMED]:
            axis.annotate(
                str(channels[taxel]), places[taxel], xytext=(6, 6), textcoords="offset points",
                fontsize=8,
            )  # fmt: skip
    if len(found.next_taxels):
        following = found.next_taxels
        axis.scatter(
            *places[following].T, s=130, marker="s", facecolors="none", edgecolors="#d3202f",
            linewidths=1.6, label="measure next",
        )  # fmt: skip
        for rank, taxel in enumerate(following, start=1):
            axis.annotate(
                f"{rank}: {channels[taxel]}", places[taxel], xytext=(6, -13), fontsize=8,
                textcoords="offset points", color="#d3202f",
            )  # fmt: skip
    axis.set_aspect("equal")
    axis.margins(0.08)
    axis.set_xlabel("mm on the board, seen from outside", fontsize=9)
    axis.tick_params(labelsize=8)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.colorbar(paint, ax=axis, shrink=0.8).set_label("predicted error [mm]")
    return picture_bytes(figure)


def judged_picture(result: PatchResult, found: PatchCalibration) -> bytes:
    """PNG of leave-one-out errors beside what is expected, and of strain against what is."""
    figure = plain_figure((10.0, 3.6))
    errors, strains = figure.subplots(1, 2, width_ratios=(1.4, 1.0))
    left = np.array([one.leave_one_out_mm for one in result.evidence])
    expected = np.array([one.expected_mm for one in result.evidence])
    place = np.arange(len(left))
    errors.bar(place, left, color="#3b6ea8", label="left out, missed by")
    errors.step(
        np.append(place - 0.5, len(left) - 0.5), np.append(expected, expected[-1]), where="post",
        color="black", linewidth=1.2, label="expected (rms)",
    )  # fmt: skip
    if len(left) <= MAX_NAMED:
        errors.set_xticks(place, [str(one.channel) for one in result.evidence])
    errors.set_xlabel("channel of the anchor or touch", fontsize=9)
    errors.set_ylabel("mm", fontsize=9)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    wanted, got = 100.0 * found.expected_strain, 100.0 * found.strain
    rows = slice(None, None, max(1, len(got) // MAX_DOTS))
    strains.scatter(wanted[rows], got[rows], s=4, color="#3b6ea8", linewidths=0, alpha=0.5)
    reach = float(max(np.percentile(np.abs(wanted), 99), np.percentile(np.abs(got), 99), 0.5))
    strains.plot([-reach, reach], [-reach, reach], color="black", linewidth=1.0)
    strains.set_xlim(-reach, reach)
    strains.set_ylim(-reach, reach)
    strains.set_aspect("equal")
    strains.set_xlabel("expected strain of a pair [%]", fontsize=9)
    strains.set_ylabel("found [%]", fontsize=9)
    for axis in (errors, strains):
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=8)
    return picture_bytes(figure)


def _paint(values: FloatArray) -> Any:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    paint = ScalarMappable(Normalize(0.0, float(values.max())), COLOURS)
    paint.set_array(values)
    return paint


def _views(found: PatchCalibration) -> list[View]:
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
