"""The taxels of one part in one renderer: coloured discs, or a coloured sheet through them.

Body and flat map are drawn by the same code from the same values, so they cannot differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkLookupTable

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import check_known
from skinmap.geometry.triangles import unit
from viewer.colours import DOT, INK, SHEET, UNKNOWN, rgb
from viewer.drawing.body.body_view import flat, light
from viewer.drawing.frame.polydata import add_actor, make_mesh
from viewer.drawing.skin.skin_layer import DISC_SHARE, Places, polygons, unsplit
from viewer.layers import Layer

THIN = 0.17  # half the width of a stroke, in radii


STYLES = ("surface", "discs")
VALUES = "value"
FADED = 0.45  # how far colours go to grey where the stream is silent
HALO = 0.12  # white around signs, in their radii


def _stroke(a: tuple[float, float], b: tuple[float, float]) -> list[tuple[float, float]]:
    """Corners of a bar from a to b."""
    start, end = np.array(a), np.array(b)
    along = THIN * (end - start) / np.linalg.norm(end - start)
    side = np.array([-along[1], along[0]])
    corners = (start - along - side, end + along - side, end + along + side, start - along + side)
    return [(float(x), float(y)) for x, y in corners]


_FALLING = _stroke((-0.6, 0.6), (0.6, -0.6))
_RISING = _stroke((-0.6, -0.6), (0.6, 0.6))
# Quadrilaterals of each sign in a circle of radius 1.
SIGNS: dict[str, list[list[tuple[float, float]]]] = {
    "dead": [_FALLING, _RISING],
    "stuck": [[(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]],
    "saturated": [[(-0.75, -0.5), (0.75, -0.5), (0.0, 0.8), (0.0, 0.8)]],
    "noisy": [
        _stroke((-0.75, -0.35), (-0.3, 0.4)),
        _stroke((-0.3, 0.4), (0.25, -0.4)),
        _stroke((0.25, -0.4), (0.75, 0.35)),
    ],
    "unheard": [_stroke((-0.6, 0.0), (0.6, 0.0))],
    "stale": [_RISING],
}


def sign_quads(name: str, grown: float = 0.0) -> FloatArray:
    """(q, 4, 2) corners of a sign; `grown` outwards for a halo."""
    quads = np.array(SIGNS[name])
    if grown:
        middle = quads.mean(axis=1, keepdims=True)
        quads = quads + grown * np.sign(np.round(quads - middle, 6))
    return quads


def sign_mesh(
    names: Sequence[str], centres: FloatArray, normals: FloatArray, radius: float, grown: float = 0
) -> pv.PolyData:
    """The signs `names` at centres (n, 3), lying across their normals (n, 3), z up [m]."""
    right = np.cross([0.0, 0.0, 1.0], normals)
    steep = np.linalg.norm(right, axis=1) < 0.1
    right[steep] = [1.0, 0.0, 0.0]
    right = unit(right - np.einsum("ij,ij->i", right, normals)[:, None] * normals)
    up = np.cross(normals, right)
    corners = []
    for name, centre, x, y in zip(names, centres, right, up, strict=True):
        quads = radius * sign_quads(name, grown)
        corners.append(centre + quads[..., :1] * x + quads[..., 1:] * y)
    points = np.concatenate(corners).reshape(-1, 3) if corners else np.zeros((0, 3))
    return make_mesh(points, np.arange(len(points)).reshape(-1, 4))


def check_style(style: str) -> str:
    """A style that exists.

    Raises
    ------
    UnknownNameError
    """
    check_known("style", [style], STYLES)
    return style


class ColourTable:
    """Colours of the layer shown: one table for body, flat map and every part."""

    def __init__(self) -> None:
        self.vtk = vtkLookupTable()
        self.vtk.SetNanColor([*rgb(UNKNOWN).tolist(), 1.0])
        self._shown: tuple[str, tuple[float, float], bool] | None = None

    def use(self, layer: Layer, *, faded: bool = False) -> None:
        """Turn to the colours of another layer; faded for what is no longer true."""
        if self._shown == (layer.name, layer.limits, faded):
            return
        self._shown = (layer.name, layer.limits, faded)
        self.vtk.SetNumberOfTableValues(len(layer.table))
        self.vtk.SetTable(numpy_to_vtk(fade(layer.table) if faded else layer.table, deep=True))
        self.vtk.SetTableRange(*layer.limits)
        self.vtk.Modified()


def fade(table: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colours (k, 4) on their way to the grey of what is unknown."""
    grey = np.append(rgb(UNKNOWN) * 255, 255)
    return np.rint((1 - FADED) * table + FADED * grey).astype(np.uint8)


class TaxelDrawing:
    """Actors of one part in a plotter's active renderer; what is not needed is not made."""

    def __init__(self, plotter: pv.Plotter, table: ColourTable) -> None:
        self.table = table
        add = partial(new_actor, plotter, pv.PolyData(), table)
        # Under discs: of one colour, so that it may rest while the discs change.
        self.ground = add(None)
        self.ground.prop.color = SHEET
        self.sheet = add("point")
        self.cells = add("cell")
        self.discs = add("cell")
        self.dots = add(None)
        self.dots.prop.color = DOT
        self.signs = [add(None) for _ in range(2)]
        for actor, colour in zip(self.signs, ("white", INK), strict=True):
            actor.prop.color = colour
        for actor in (self.dots, *self.signs):
            actor.prop.lighting = False
        self.coarse = False  # whether a triangle between taxels is too small to be drawn as four
        self.quick = False  # whether it moves, and speed counts more than detail
        self.joined = False  # whether the sheet is drawn with those of other parts, as one
        self._places: Places | None = None
        self._made: dict[tuple[int, str], pv.PolyData] = {}
        self._drawn: dict[pv.Actor, tuple[int, str]] = {}
        self._signed: tuple[Any, ...] = ()

    @property
    def actors(self) -> tuple[pv.Actor, ...]:
        """All of them."""
        return (self.ground, self.sheet, self.cells, self.discs, self.dots, *self.signs)

    @property
    def spacing(self) -> float:
        """About how far taxels are from each other [m]."""
        return self._at().disc / DISC_SHARE

    @property
    def sheet_kind(self) -> str:
        """Which sheet is drawn: "fine" or "coarse"."""
        return "coarse" if self.coarse or self.quick else "fine"

    def turn_to(self, places: Places) -> None:
        """Draw another part, or the same one elsewhere."""
        if places is self._places:
            return
        self._places = places
        self._signed = ()
        for actor in (self.ground, self.sheet, self.cells, self.discs):
            actor.prop.lighting = places.lit
            if places.lit:
                light(actor)  # VTK's own lights cost twice as much
            else:  # VTK adds both also where no light falls
                actor.prop.ambient, actor.prop.diffuse = 0.0, 1.0
                flat(actor)

    def show(self, layer: Layer, style: str, field: FloatArray | None, values: FloatArray) -> None:
        """Colour the taxels by values (n,), a sheet between them by its field (v,).

        `field` is for the style "surface" only, of layers that are no categories.
        """
        places = self._at()
        smooth = style == "surface" and not layer.categories
        self.ground.SetVisibility(style == "discs")
        self.sheet.SetVisibility(smooth and not self.joined)
        self.cells.SetVisibility(style == "surface" and bool(layer.categories))
        self.discs.SetVisibility(style == "discs")
        # Specks of a pixel: they are missed only in a picture that rests.
        specks = self.quick and self.coarse
        self.dots.SetVisibility(style == "surface" and not specks)
        if style == "discs":
            self._dataset(self.ground, f"{self.sheet_kind} ground")
            write(self._dataset(self.discs, "discs"), values[places.taxels])
            return
        self._dataset(self.dots, "quick dots" if self.quick else "dots")
        if field is not None and self.joined:
            return
        if field is not None:
            mesh = self._dataset(self.sheet, f"{self.sheet_kind} sheet")
            write(mesh, field[places.vertex[: mesh.n_points]])
        else:
            write(self._dataset(self.cells, "cells"), values[places.owner])

    def sign(self, taxels: IntArray, names: Sequence[str]) -> None:
        """Put signs (of `SIGNS`) on some taxels, and on no others."""
        key = (tuple(taxels.tolist()), tuple(names))
        if key == self._signed:
            return
        self._signed = key
        places = self._at()
        named = dict(zip(taxels.tolist(), names, strict=True))
        rows = np.flatnonzero(np.isin(places.taxels, taxels))
        at, facing = places.centres[rows], places.facing[rows]
        words = [named[int(taxel)] for taxel in places.taxels[rows]]
        for actor, grown, rise in zip(self.signs, (HALO, 0.0), (2e-4, 4e-4), strict=True):
            centres = at + rise * facing
            actor.mapper.dataset = sign_mesh(words, centres, facing, places.disc, grown)
            actor.SetVisibility(bool(words))

    def _at(self) -> Places:
        assert self._places is not None, "turn_to comes first"
        return self._places

    def _dataset(self, actor: pv.Actor, kind: str) -> pv.PolyData:
        places = self._at()
        key = (id(places), kind)
        if key not in self._made:
            self._made[key] = _make(places, kind)
        if self._drawn.get(actor) != key:
            self._drawn[actor] = key
            actor.mapper.dataset = self._made[key]
        return self._made[key]


def new_actor(
    plotter: pv.Plotter, mesh: pv.PolyData, table: ColourTable, scalars: str | None
) -> pv.Actor:
    """An actor of one colour, or coloured by the values of "point" or "cell"."""
    actor = add_actor(plotter, mesh, lit=True)
    mapper: Any = actor.mapper
    if scalars is not None:
        mapper.SetLookupTable(table.vtk)
        mapper.SetUseLookupTableScalarRange(True)
        mapper.SetColorModeToMapScalars()
        mapper.SetScalarVisibility(True)
        if scalars == "point":
            mapper.SetScalarModeToUsePointData()
            mapper.SetInterpolateScalarsBeforeMapping(True)
        else:
            mapper.SetScalarModeToUseCellData()
    prop = actor.prop
    # Matt, lightly shaded: the colour must stay readable as a value.
    prop.ambient, prop.diffuse, prop.specular = 0.5, 0.52, 0.0
    prop.interpolation = "Gouraud"
    prop.culling = "back"
    return actor


def new_sheet(places: Places, kind: str) -> tuple[FloatArray, IntArray]:
    """Points (k, 3) and triangles of a "fine" or "coarse" sheet [m]."""
    faces = places.faces if kind == "fine" else unsplit(places.faces)
    return places.points[: int(faces.max(initial=-1)) + 1], faces


def _make(places: Places, kind: str) -> pv.PolyData:
    if kind.endswith(("sheet", "ground")):
        points, faces = new_sheet(places, kind.split()[0])
        mesh, count = make_mesh(points, faces), len(points)
        set_normals(mesh, places.normals[:count])
        if kind.endswith("ground"):
            return mesh
        return with_values(mesh)
    if kind == "cells":
        mesh, count = make_mesh(places.cell_points, places.cells), len(places.cells)
        set_normals(mesh, places.cell_normals)
    else:
        radius = places.disc if kind == "discs" else places.dot
        corners, count = 4 if kind.startswith("quick") else 6, len(places.centres)
        mesh = polygons(places.centres, places.facing, radius, corners)
        set_normals(mesh, np.repeat(places.facing, corners, axis=0))
    if not kind.endswith("dots"):
        mesh.cell_data[VALUES] = np.full(count, np.nan, np.float32)
        mesh.set_active_scalars(VALUES, preference="cell")
    return mesh


def with_values(mesh: pv.PolyData) -> pv.PolyData:
    """The mesh with a place for the values of its points."""
    mesh.point_data[VALUES] = np.full(mesh.n_points, np.nan, np.float32)
    mesh.set_active_scalars(VALUES, preference="point")
    return mesh


def set_normals(mesh: pv.PolyData, normals: FloatArray) -> None:
    """Give the points of a mesh their normals (n, 3)."""
    mesh.point_data["Normals"] = normals.astype(np.float32)
    mesh.point_data.active_normals_name = "Normals"


def write(mesh: pv.PolyData, values: FloatArray) -> None:
    """Replace the values of points or cells in place, if they are others than before."""
    # VTK's own array and a view of it: PyVista's look-ups take ten times as long as the rest.
    data: Any = mesh.GetPointData().GetArray(VALUES) or mesh.GetCellData().GetArray(VALUES)
    array, new = vtk_to_numpy(data), values.astype(np.float32)
    if not np.array_equal(array.view(np.int32), new.view(np.int32)):
        array[:] = new
        data.Modified()
