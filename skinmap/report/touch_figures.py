"""Figures of what is felt: pressures on the body, contacts numbered, touches named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import SkinMismatchError
from skinmap.geometry.triangles import face_normals
from skinmap.live.contacts.named_touch import UNNAMED, Moment, NamedTouch
from skinmap.report.flat_figures import draw_surface, mesh_views
from skinmap.report.page import plain_figure
from skinmap.surface.surface_mesh import SurfaceMesh
from skinmap.touch.contacts.skin_geometry import ACTIVE, Contacts, find_contacts
from skinmap.touch.prepared_skin import PreparedSkin

PANEL = 3.4  # inches
MOST = 4  # parts in a figure
FULL = 255.0  # counts


def contacts_figure(contacts: Contacts) -> Any:
    """Contacts on the body, numbered in their order."""
    mesh = contacts.geometry.mesh
    labels = [(one.centre, str(k)) for k, one in enumerate(contacts)]
    count = f"{len(contacts)} {'contact' if len(contacts) == 1 else 'contacts'}"
    return _figure([(mesh, contacts.pressures, labels, f"{mesh.skin.part}: {count}")])


def with_contacts(moment: Moment, skins: Mapping[str, PreparedSkin]) -> Moment:
    """The moment; one made by hand with its contacts as touches without a name."""
    if moment.touches or moment.states:  # of a loop, which has looked
        return moment
    found = [
        NamedTouch(part, one.taxels, one.centre, UNNAMED, np.nan, area=one.area,
                   peak=one.peak, mean=one.mean, area_least=one.area_least)
        for part, skin in skins.items() if part in moment.pressures
        for one in find_contacts(skin.geometry, moment.pressures[part])
    ]  # fmt: skip
    return replace(moment, touches=tuple(found))


def moment_figure(moment: Moment) -> Any:
    """Touched parts of a moment with the names of their touches; the most pressed without any."""
    if not moment.skins:
        raise SkinMismatchError("a moment without skins has no figure; a TouchLoop's moments do")
    moment = with_contacts(moment, moment.skins)
    load: Mapping[str, float] = {k: float(v.sum()) for k, v in moment.pressures.items()}
    touched = {one.part for one in moment.touches}
    order = sorted(touched or load, key=lambda part: -load[part])[: MOST if touched else 1]
    rows = []
    for part in order:
        own = [one for one in moment.touches if one.part == part]
        words = ", ".join(map(_words, own)) or "no touch"
        labels = [(one.centre, one.label) for one in own]
        title = f"{part} at {moment.time:.2f} s: {words}"
        rows.append((moment.skins[part].mesh, moment.pressures[part], labels, title))
    return _figure(rows)


def _words(touch: NamedTouch) -> str:
    return touch.label + (f" {touch.confidence:.0%}" if touch.confidence >= 0.0 else "")


def _figure(
    rows: Sequence[tuple[SurfaceMesh, NDArray[Any], list[tuple[FloatArray, str]], str]],
) -> Any:
    """A row of views for each part: mesh, pressures (n,), labels with their places, title."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    paint = ScalarMappable(Normalize(0.0, FULL), colormaps["YlOrRd"])
    views = [mesh_views(mesh) for mesh, *_ in rows]
    across = max(map(len, views))
    figure = plain_figure((PANEL * across + 0.9, PANEL * len(rows) + 0.4))
    axes = figure.subplots(len(rows), across, squeeze=False)
    for axis in axes.ravel():
        axis.set_axis_off()
    for line, (mesh, pressures, labels, title), seen in zip(axes, rows, views, strict=True):
        body = mesh.vertices[mesh.faces]
        normals = face_normals(body.reshape(-1, 3), np.arange(body[..., 0].size).reshape(-1, 3))
        felt = np.asarray(pressures, np.float64)[mesh.faces].max(1)
        colours = np.where((felt > ACTIVE)[:, None], paint.to_rgba(felt), (0.9, 0.91, 0.92, 1.0))
        for axis, view in zip(line, seen, strict=False):
            draw_surface(axis, view, body, normals, colours)
            middle = view.project(body.reshape(-1, 3))[:, 0].mean()
            for place, word in labels:
                near = np.linalg.norm(body.mean(1) - place, axis=1).argmin()
                if normals[near] @ view.out > 0.0:
                    x, y, _ = view.project(place)
                    left = x > middle  # of the view: words run inwards, on a ground of their own
                    axis.annotate(word, (x, y), (-9 if left else 9, 9), fontsize=9,
                                  textcoords="offset points", ha="right" if left else "left",
                                  bbox={"boxstyle": "round,pad=0.15", "fc": "white", "lw": 0.3},
                                  arrowprops={"arrowstyle": "-", "lw": 0.7})  # fmt: skip
            axis.set_aspect("equal")
            axis.autoscale_view()
            axis.set_title(view.name, fontsize=8, y=-0.08)
        line[0].text(0.0, 1.04, title, transform=line[0].transAxes, fontsize=10)
    figure.colorbar(paint, ax=axes, shrink=0.6, pad=0.01).set_label("pressure [counts of 255]")
    return figure
