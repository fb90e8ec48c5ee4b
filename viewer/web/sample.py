"""Moments as bytes: a byte for each taxel, outlines as places on edges, touches as JSON.

One at a time for a page that is served, or several that a page without a server plays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import SkinError
from skinmap.geometry.topology import edges
from skinmap.geometry.triangles import unit
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from viewer.colours import touch_colour
from viewer.drawing.body.bare_body import posed
from viewer.drawing.panel.touch_list import caption, details
from viewer.drawing.touches.touch_marks import motion_way, outline_touch
from viewer.drawing.touches.traces import touch_force
from viewer.layers import STATES, Layer, Layers
from viewer.playing.recent_moments import Timeline
from viewer.results import LAYERS
from viewer.web.scene_data import WebScene, finite, pack, pack_poses

UNKNOWN = 255  # the byte of a taxel of which nothing is known
STEPS = 255  # colours of a table: bytes 0 to 254
SHARES = 65535  # steps of where an outline crosses an edge


def layer_message(layer: Layer) -> dict[str, Any]:
    """What a page needs to know of a layer: its colours, limits and unit."""
    rows = table_rows(len(layer.table))
    return {
        "kind": "layer",
        "name": layer.name,
        "title": layer.title,
        "unit": layer.unit,
        "limits": [float(value) for value in layer.limits],
        "table": layer.table[rows, :3].tolist(),
        "categories": list(layer.categories),
        "missing": layer.missing,
        "heard": layer.heard,
        "grey": layer.grey,
        "cut": list(layer.cut),
    }


def table_rows(size: int) -> NDArray[np.int64]:
    """(k,) rows of a table of `size` colours that a page gets: at most `STEPS`, ends included."""
    return np.rint(np.linspace(0, size - 1, min(size, STEPS))).astype(np.int64)


def taxel_bytes(layer: Layer, part: str, moment: Moment | None) -> NDArray[np.uint8]:
    """(n,) row of the page's table for each taxel of a part, or `UNKNOWN`."""
    rows = layer.rows(layer.values(part, moment))
    size = len(layer.table)
    fewer = min(size, STEPS)
    places = rows if fewer == size else np.rint(rows * ((fewer - 1) / (size - 1)))
    return np.where(rows < 0, UNKNOWN, places).astype(np.uint8)


class SampleWriter:
    """Writes moments for pages.

    Parameters
    ----------
    scene : WebScene
    data : Layers
        What has been seen of the scene's skins.
    """

    def __init__(self, scene: WebScene, data: Layers) -> None:
        self.scene, self.data = scene, data
        self._angles: dict[str, float] = {}
        self._poses: NDArray[np.float32] | None = None
        self.problem = ""  # why the last moment could not be shown in full

    def write(self, moment: Moment | None, layer: Layer, about: Mapping[str, Any]) -> bytes:
        """A message of kind "sample".

        Parameters
        ----------
        moment : Moment or None
            None before the first sample.
        layer : Layer
            Whose colours the page shows.
        about : mapping
            More for the header.
        """
        header, arrays = self.parts(moment, layer.name)
        values = [taxel_bytes(layer, part, moment) for part in self.scene.skins]
        about = {"kind": "sample", "layer": layer.name, **about}
        return pack({**about, **header}, {"values": np.concatenate(values), **arrays})

    def parts(
        self, moment: Moment | None, layer: str = ""
    ) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Header and arrays of a moment, as a layer shows it, but for the values of its taxels."""
        self.problem = ""
        parts = self.scene.skins
        header: dict[str, Any] = {}
        arrays: dict[str, NDArray[Any]] = {}
        touches: Sequence[NamedTouch] = () if moment is None else moment.touches
        if layer == "difference" and self.data.pair is not None:
            touches = self.data.pair.touches(math.nan if moment is None else moment.time)
        touches = [touch for touch in touches if touch.part in parts]
        if moment is not None:
            header.update(
                time=finite(moment.time),
                stale=moment.stale,
                rate=finite(moment.rate),
                latency=finite(moment.latency),
                dropped=moment.dropped,
            )
            self._pose(moment)
            for part, pressures in self.data.felt(moment).items():
                self.scene.layers[part].set_pressures(pressures)
        if self._poses is not None:
            arrays["poses"] = self._poses
        header["signs"] = self._signs()
        header["touches"] = [self._touch(touch, touches, moment, arrays) for touch in touches]
        if self.problem:
            header["problem"] = self.problem
        return header, arrays

    def _signs(self) -> dict[str, list[int]]:
        """Numbers among all taxels of those whose values mean nothing, by the sign that says why.

        Of those that sent nothing the page knows by itself.
        """
        found: dict[str, list[int]] = {}
        for part, first in self.scene.first_taxel.items():
            states = self.data.watch.known(part)
            for row in np.flatnonzero(self.data.watch.unfit(part)).tolist():
                found.setdefault(STATES[states[row]], []).append(first + row)
        return found

    def _pose(self, moment: Moment) -> None:
        """Place the links by the joint angles of a moment; wrong ones leave them as they are."""
        if not moment.angles or moment.angles == self._angles:
            return
        self._angles = dict(moment.angles)
        try:
            poses = posed(self.scene.robot, {**self.scene.angles, **moment.angles})
        except SkinError as error:
            self.problem = str(error)
            return
        self._poses = pack_poses(poses, self.scene.links)

    def _touch(
        self,
        touch: NamedTouch,
        others: Sequence[NamedTouch],
        moment: Moment | None,
        arrays: dict[str, NDArray[Any]],
    ) -> dict[str, Any]:
        layer = self.scene.layers[touch.part]
        outline = outline_touch(layer, touch, others)
        name = f"outline{len(arrays)}"
        # Both ends of each segment: vertices of the edge that it lies on, and where.
        ends = np.stack([outline.first, outline.second], axis=-1)
        ends += self.scene.first_vertex[touch.part]
        small = sum(len(one.points) for one in self.scene.layers.values()) < 65536
        arrays[name] = ends.astype(np.uint16 if small else np.uint32)
        arrays[f"{name}.share"] = np.rint(SHARES * outline.share).astype(np.uint16)
        normal, way = touch.normal, motion_way(touch, layer.places.scale)
        if normal is None:
            normal = unit(layer.skin.normals[touch.taxels].sum(axis=0))
        return {
            "part": touch.part,
            "label": touch.label,
            "confidence": finite(round(touch.confidence, 4)),
            "text": caption(touch),
            "colour": touch_colour(touch),
            "identity": touch.identity,
            "centre": np.asarray(touch.centre, np.float64).round(5).tolist(),
            "normal": np.asarray(normal).round(4).tolist(),
            "taxels": len(touch.taxels),
            "area_mm2": finite(1e6 * touch.area),
            "peak": finite(touch.peak),
            "force": finite(touch_force(touch)),
            "about": details(touch, math.nan if moment is None else moment.time),
            "path": None if touch.path is None else np.asarray(touch.path[-60:]).round(4).tolist(),
            "ahead": None if way is None else (way[0] * way[1]).round(5).tolist(),
            "outline": name,
        }


def pack_reel(
    scene: WebScene,
    layers: Layers,
    moments: Sequence[Moment],
    *,
    now: int = 0,
    layer: str = "pressure",
    style: str = "surface",
    size: tuple[int, int] | None = None,
) -> bytes:
    """A message of kind "reel".

    Parameters
    ----------
    scene : WebScene
    layers : Layers
    moments : sequence of Moment
        In the order of their times; one or more.
    now : int
        Which of them is shown first.
    layer, style : str
        What is shown first.
    size : (int, int), optional
        Width and height of the robot's picture [px].
    """
    arrays: dict[str, NDArray[Any]] = {}
    shown = [layers.get(name) for name in LAYERS]
    writer = SampleWriter(scene, layers)
    nothing = {part: np.full(len(skin), np.nan) for part, skin in scene.skins.items()}
    headers: list[dict[str, Any]] = []
    for number, moment in enumerate(moments):
        layers.observe(moment)
        about, own = writer.parts(moment)
        header: dict[str, Any] = {"kind": "sample", "layer": shown[0].name, **about}
        felt = (touch for touch in moment.touches if touch.part in scene.skins)
        for touch, own_touch in zip(header["touches"], felt, strict=True):
            touch["outline"] = f"{number}.{touch['outline']}"
            touch["members"] = np.asarray(own_touch.taxels).tolist()
        arrays.update({f"{number}.{name}": array for name, array in own.items()})
        header["poses"] = f"{number}.poses" if "poses" in own else None
        header["values"], header["felt"] = {}, {}
        for one in shown:
            name = f"{number}.{one.name}" if one.live else one.name
            header["values"][one.name] = name
            if name not in arrays:  # what is not live is written once
                codes = [taxel_bytes(one, part, moment) for part in scene.skins]
                arrays[name] = np.concatenate(codes)
        for name, sent in (("pressure", moment.pressures), ("raw", moment.raw)):
            values = np.concatenate([sent.get(part, none) for part, none in nothing.items()])
            known = bool(np.isfinite(values).any())
            header["felt"][name] = f"{number}.felt.{name}" if known else None
            if known:
                arrays[f"{number}.felt.{name}"] = values.astype(np.float32)
        headers.append(header)
    _add_about(arrays, scene)
    return pack(
        {
            "kind": "reel",
            "layers": [layer_message(one) for one in shown],
            "moments": headers,
            "now": now,
            "layer": layer,
            "style": style,
            "size": size,
            "spans": [span.to_json(moments[0].time) for span in Timeline.of(moments).spans()],
        },
        arrays,
    )


def _add_about(arrays: dict[str, NDArray[Any]], scene: WebScene) -> None:
    """Add what is told of a taxel beside what the scene has: place, normal, neighbours."""
    skins = scene.skins.values()
    arrays["positions"] = np.concatenate([skin.skin.positions for skin in skins]).astype(np.float32)
    arrays["normals"] = np.concatenate([skin.skin.normals for skin in skins]).astype(np.float32)
    pairs = [edges(skin.mesh.faces) + scene.first_taxel[part] for part, skin in scene.skins.items()]
    both = np.concatenate([pair[:, order] for pair in pairs for order in ([0, 1], [1, 0])])
    both = both[np.lexsort(both.T[::-1])]
    arrays["beside"] = both[:, 1].astype(np.uint32)
    starts = np.searchsorted(both[:, 0], np.arange(len(arrays["positions"]) + 1))
    arrays["beside.starts"] = starts.astype(np.uint32)
