"""Writing flat maps for other programs: meshes with texture coordinates, seams opened.

Vertices keep the order of the taxels; a chart's vertex on a seam comes once for each copy, so that
every file has one texture coordinate a vertex (VTP) or a corner (OBJ).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.face_metrics import METRICS
from skinmap.flat.flat_map import FlatMap
from skinmap.io.taxels.export import data_array


def write_flat_obj(flat: FlatMap, path: Path) -> None:
    """OBJ of a part: taxels in their order, faces with the corners of the charts as vt."""
    start = np.cumsum([0, *(len(chart.taxels) for chart in flat.charts)])
    faces = [chart.taxels[chart.faces] for chart in flat.charts]
    corners = [chart.faces + at for chart, at in zip(flat.charts, start, strict=False)]
    uv = np.concatenate([chart.uv for chart in flat.charts])
    write_obj_with_uv(path, flat.mesh.vertices, np.concatenate(faces), uv, np.concatenate(corners))


def write_flat_vtp(flat: FlatMap, path: Path) -> None:
    """VTP of a part: taxels in their order, the further copies of seam taxels after them."""
    order, start = [], 0
    for chart in flat.charts:
        order.append(np.column_stack([chart.taxels, np.arange(len(chart.taxels)) + start]))
        start += len(chart.taxels)
    pairs = np.concatenate(order)  # taxel, corner
    skin = flat.mesh.skin
    taxels, first = np.unique(pairs[:, 0], return_index=True)
    again = np.setdiff1d(np.arange(len(pairs)), first)
    row = np.empty(len(pairs), np.int64)
    row[first], row[again] = taxels, len(skin) + np.arange(len(again))
    # A taxel merged into another lies where that one lies on the map; NaN where no face is.
    uv = np.concatenate([flat.uv, np.concatenate([chart.uv for chart in flat.charts])[again]])
    taxel = np.concatenate([np.arange(len(skin)), pairs[again, 0]])
    offsets = np.cumsum([0, *(len(chart.taxels) for chart in flat.charts)])
    faces = [row[chart.faces + at] for chart, at in zip(flat.charts, offsets, strict=False)]
    uv[pairs[first, 0]] = np.concatenate([chart.uv for chart in flat.charts])[first]
    cells = {
        name: np.concatenate([metric.of(chart) for chart in flat.charts])
        for name, metric in METRICS.items()
    }
    patch = np.concatenate([np.full(len(c.faces), c.patch) for c in flat.charts])
    write_vtp_with_uv(
        path,
        skin.positions[taxel],
        np.concatenate(faces),
        {"uv": uv, "channel": skin.channels[taxel], "module": skin.modules[taxel]},
        {**cells, "patch": patch},
    )


def write_obj_with_uv(
    path: Path, vertices: FloatArray, faces: IntArray, uv: FloatArray, corners: IntArray
) -> None:
    """Write a Wavefront OBJ.

    Parameters
    ----------
    path : Path
    vertices : (n, 3) array of float
        In the order of the taxels [m].
    faces : (m, 3) array of int
        Over them.
    uv : (k, 2) array of float
        Texture coordinates, those of a seam doubled [m].
    corners : (m, 3) array of int
        Row of `uv` of each corner of each face.
    """
    lines = ["# metres; vt are flat-map coordinates in metres, vertices in the order of the taxels"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"vt {u!r} {v!r}" for u, v in uv.tolist()]
    pairs = np.stack([faces + 1, corners + 1], axis=2).reshape(-1, 6)
    lines += [f"f {a}/{b} {c}/{d} {e}/{f}" for a, b, c, d, e, f in pairs.tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def write_vtp_with_uv(
    path: Path,
    vertices: FloatArray,
    faces: IntArray,
    point_data: Mapping[str, NDArray[np.generic]],
    face_data: Mapping[str, NDArray[np.generic]],
) -> None:
    """Write VTK polydata (XML, base64): triangles with data at points and faces.

    Parameters
    ----------
    path : Path
    vertices : (k, 3) array of float
        [m].
    faces : (m, 3) array of int
    point_data : mapping of str to (k,) or (k, c) array
        `uv` among them is marked as the texture coordinates.
    face_data : mapping of str to (m,) array
    """
    root = ET.Element(
        "VTKFile",
        type="PolyData",
        version="1.0",
        byte_order="LittleEndian",
        header_type="UInt64",
    )
    piece = ET.SubElement(
        ET.SubElement(root, "PolyData"),
        "Piece",
        NumberOfPoints=str(len(vertices)),
        NumberOfPolys=str(len(faces)),
    )
    points = ET.SubElement(piece, "PointData", TCoords="uv")
    for name, values in point_data.items():
        data_array(points, name, values)
    cells = ET.SubElement(piece, "CellData")
    for name, values in face_data.items():
        data_array(cells, name, values)
    data_array(ET.SubElement(piece, "Points"), "Points", vertices)
    polys = ET.SubElement(piece, "Polys")
    data_array(polys, "connectivity", faces.ravel())
    data_array(polys, "offsets", np.arange(3, 3 * len(faces) + 1, 3))
    ET.indent(root)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
