"""Reports of calibrations: the verdict, numbers in words, pictures, what to do next."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.commands.results import MM, PatchResult
from calibration.files.tables import BoardTable
from calibration.patch.patch_calibration import PatchCalibration
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.proximity import closest_on_mesh
from skinmap.geometry.rigid import transform_points
from skinmap.geometry.triangles import face_normals, unit
from skinmap.report.figure import picture_bytes, plain_figure
from skinmap.report.image import image
from skinmap.report.page import facts, heading, note, page, paragraph, verdict_lines
from skinmap.report.projection import View, draw_surface
from skinmap.report.table import Table
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
WORDS = {
    "ok": "The patch may be used as it is.",
    "low_coverage": "The evidence covers too little of the patch.",
    "ambiguous": "What was measured does not settle where the patch is.",
    "unobservable": "The patch can still move freely in some way.",
}
TURN = np.radians(50.0)  # of each of the two side views
MARGIN = 12e-3  # round the patch: what of the link lies further is cut off [m]
SHADES = "viridis"
MAX_NAMED = 24  # taxels with evidence that are named
MAX_DOTS = 4000  # pairs whose strain is drawn


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
    for axis, view in zip(axes[:2], _views(vertices), strict=True):
        _draw_link(axis, view, vertices, drawn)
        places = view.project(MM * here)
        order = np.argsort(places[:, 2])
        shown = axis.scatter(
            *places[order, :2].T, c=off[order], s=3, cmap="viridis", vmin=0, vmax=FAR_MM, zorder=3
        )
        axis.margins(0.05)
    figure.colorbar(shown, ax=axes[1], extend="max").set_label("distance from the mesh [mm]")
    axes[2].hist(np.clip(off, 0, 2 * FAR_MM), bins=50, color="#3b6ea8")
    axes[2].set_xlabel(f"distance [mm], all above {2 * FAR_MM:g} in the last bar")
    axes[2].set_ylabel("points")
    axes[2].spines[["top", "right"]].set_visible(False)
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
