"""A scene as one web page that holds everything itself: body, skin, layers, touches, flat maps.

The page draws with the browser's own WebGL and asks nobody for anything: its policy forbids it.
"""

from __future__ import annotations

import base64
import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.rigid import transform_directions, transform_points
from skinmap.io.output import staged_file
from viewer.colours import class_colour, luminance, rgb
from viewer.drawing.camera import VIEW_ANGLE
from viewer.drawing.touch_list import caption
from viewer.export.solids import Solid, body_solids, disc_solid
from viewer.scene import Scene

STEPS = 12  # colours of a scalar bar
PLACES = 65535  # of the body, along each side of its box: 0.02 mm on a robot of 1.2 m


def write_html(scene: Scene, path: Path) -> Path:
    """Write what a scene shows now, with all layers to choose from.

    Raises
    ------
    OutputError
        The folder does not exist or cannot be written to.
    """
    page = files("viewer.export").joinpath("page.html").read_text(encoding="utf-8")
    # A name with </script> in it must not end the script.
    data = json.dumps(page_data(scene), allow_nan=False, separators=(",", ":"))
    with staged_file(path) as stage:
        stage.write_text(page.replace("@DATA@", data.replace("<", "\\u003c")), encoding="utf-8")
    return path


def page_data(scene: Scene) -> dict[str, Any]:
    """All that the page needs, arrays as base64 of little-endian numbers."""
    order: list[tuple[str, int, int]] = []
    first = 0
    discs: list[tuple[Solid, NDArray[Any]]] = []
    for part, drawn in scene.layers.items():
        solid, owner = disc_solid(drawn.skin)
        discs.append((_placed(scene, solid), owner + first))
        order.append((part, first, len(drawn.skin)))
        first += len(drawn.skin)
    return {
        "title": f"{scene.robot.name}   {first:,} taxels",
        "body": _body(scene),
        "discs": _discs(discs),
        "taxels": _taxels(scene),
        "order": order,
        "layers": [_layer(scene, name) for name in scene.data.names],
        "layer": scene.layer.name,
        "parts": {part: _map(scene, part, start) for part, start, _ in order},
        "part": scene.panel.part if scene.panel is not None else order[0][0],
        "touches": [_touch(scene, touch) for touch in scene.touches],
        "camera": _camera(scene),
    }


def _pack(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, np.dtype(kind)).tobytes()).decode()


def _placed(scene: Scene, solid: Solid) -> Solid:
    pose = scene.poses[solid.link]
    return Solid(
        solid.name,
        solid.link,
        transform_points(pose, solid.vertices),
        transform_directions(pose, solid.normals),
        solid.faces,
    )


def _joined(solids: list[Solid]) -> tuple[FloatArray, FloatArray, NDArray[Any]]:
    sizes = np.cumsum([0] + [len(solid.vertices) for solid in solids])
    empty = np.zeros((0, 3))
    return (
        np.concatenate([empty, *(solid.vertices for solid in solids)]),
        np.concatenate([empty, *(solid.normals for solid in solids)]),
        np.concatenate(
            [empty.astype(np.int64), *(s.faces + k for s, k in zip(solids, sizes, strict=False))]
        ),
    )


def _body(scene: Scene) -> dict[str, Any]:
    vertices, normals, faces = _joined([_placed(scene, s) for s in body_solids(scene)])
    low = vertices.min(axis=0) if len(vertices) else np.zeros(3)
    size = np.maximum(np.ptp(vertices, axis=0), 1e-6) if len(vertices) else np.ones(3)
    return {
        "low": low.tolist(),
        "size": size.tolist(),
        "place": _pack(np.round(PLACES * (vertices - low) / size), "<u2"),
        "normal": _pack(np.round(127 * np.clip(normals, -1, 1)), "i1"),
        "faces": _pack(faces, "<u4"),
    }


def _discs(discs: list[tuple[Solid, NDArray[Any]]]) -> dict[str, str]:
    vertices, normals, faces = _joined([solid for solid, _ in discs])
    return {
        "place": _pack(vertices, "<f4"),
        "normal": _pack(np.round(127 * normals), "i1"),
        "faces": _pack(faces, "<u4"),
        "taxel": _pack(np.concatenate([owner for _, owner in discs]), "<u4"),
    }


def _taxels(scene: Scene) -> dict[str, str]:
    skins = [drawn.skin for drawn in scene.layers.values()]
    poses = [scene.poses[skin.link] for skin in skins]
    place = [transform_points(T, s.positions) for T, s in zip(poses, skins, strict=True)]
    normal = [transform_directions(T, s.normals) for T, s in zip(poses, skins, strict=True)]
    patches = [drawn.mesh.taxel_patches for drawn in scene.layers.values()]
    return {
        "place": _pack(np.concatenate(place), "<f4"),
        "normal": _pack(np.concatenate(normal), "<f4"),
        "channel": _pack(np.concatenate([skin.channels for skin in skins]), "<i4"),
        "module": _pack(np.concatenate([skin.modules for skin in skins]), "<i4"),
        "patch": _pack(np.concatenate(patches), "<i4"),
    }


def _layer(scene: Scene, name: str) -> dict[str, Any]:
    layer = scene.data.get(name)
    values = [layer.values(part, scene.moment) for part in scene.layers]
    rows = np.linspace(0, len(layer.table) - 1, STEPS).round().astype(int)
    table = layer.table if layer.categories else layer.table[rows]
    return {
        "name": name,
        "title": layer.title,
        "unit": layer.unit,
        "limits": list(layer.limits),
        "categories": list(layer.categories),
        "table": table[:, :3].tolist(),
        "colours": _pack(np.concatenate([layer.colours(one) for one in values]), "u1"),
        "values": _pack(np.concatenate(values), "<f4"),
    }


def _map(scene: Scene, part: str, first: int) -> dict[str, Any]:
    charts = scene.data.skins[part].flat.charts
    uv = [
        [int(taxel) + first, round(float(u), 6), round(float(v), 6)]
        for chart in charts
        for taxel, (u, v) in zip(chart.taxels, chart.uv, strict=True)
    ]
    return {"uv": uv, "spacing": median_spacing(scene.layers[part].skin.positions)}


def _touch(scene: Scene, touch: Any) -> dict[str, Any]:
    colour = class_colour(touch.label)
    pose = scene.poses[scene.layers[touch.part].skin.link]
    return {
        "part": touch.part,
        "text": caption(touch),
        "colour": colour,
        "ink": "#ffffff" if luminance(rgb(colour)) < 0.5 else "#20262e",
        "place": transform_points(pose, touch.centre[None])[0].tolist(),
    }


def _camera(scene: Scene) -> dict[str, Any]:
    """The scene's camera as an orbit about its focus."""
    camera = scene.plotter.renderers[0].GetActiveCamera()
    focus = np.array(camera.GetFocalPoint())
    back = np.array(camera.GetPosition()) - focus
    distance = float(np.linalg.norm(back))
    x, y, z = back / distance
    return {
        "focus": focus.tolist(),
        "distance": distance,
        "azimuth": float(np.degrees(np.arctan2(y, x))),
        "elevation": float(np.degrees(np.arcsin(np.clip(z, -1, 1)))),
        "angle": VIEW_ANGLE,
    }
