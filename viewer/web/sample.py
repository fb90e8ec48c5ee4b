"""One moment as bytes: a byte for each taxel, outlines as places on edges, touches as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import SkinError
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.moment import Moment
from skinmap.recognition.answers import answers_object
from viewer.colours import touch_colour
from viewer.drawing.body.bare_body import posed
from viewer.drawing.panel.touch_list import caption, details
from viewer.drawing.touches.outlines import Outline, outline_touch
from viewer.drawing.touches.touch_marks import reach_of
from viewer.health import STATES
from viewer.layers import Layer, Layers
from viewer.web.packing import finite, pack
from viewer.web.scene_data import WebScene, pack_poses

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
        "live": layer.live,
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

    def write(
        self,
        moment: Moment | None,
        layer: Layer,
        about: Mapping[str, Any],
    ) -> bytes:
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
        self.problem = ""
        parts = self.scene.skins
        arrays: dict[str, NDArray[Any]] = {}
        arrays["values"] = np.concatenate([taxel_bytes(layer, part, moment) for part in parts])
        touches = [] if moment is None else [t for t in moment.touches if t.part in parts]
        header: dict[str, Any] = {"kind": "sample", "layer": layer.name, **about}
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
        return pack(header, arrays)

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
        self._add_outline(arrays, name, outline, self.scene.first_vertex[touch.part])
        normal = touch.normal
        if normal is None:
            normal = mean_direction(layer.skin.normals[touch.taxels])
        return {
            "part": touch.part,
            "label": touch.label,
            "confidence": finite(round(touch.confidence, 4)),
            **answers_object(touch.answers),
            "text": caption(touch),
            "colour": touch_colour(touch),
            "identity": touch.identity,
            "centre": np.asarray(touch.centre, np.float64).round(5).tolist(),
            "normal": np.asarray(normal).round(4).tolist(),
            "taxels": len(touch.taxels),
            "area_mm2": finite(1e6 * touch.area),
            "peak": finite(touch.peak),
            "force": finite(touch.force),
            "about": details(touch, math.nan if moment is None else moment.time),
            "path": None if touch.path is None else np.asarray(touch.path[-60:]).round(4).tolist(),
            "ahead": ahead(touch),
            "outline": name,
        }

    def _add_outline(
        self, arrays: dict[str, NDArray[Any]], name: str, outline: Outline, first: int
    ) -> None:
        """Both ends of each segment: vertices of the edge that it lies on, and where."""
        small = sum(len(layer.points) for layer in self.scene.layers.values()) < 65536
        ends = np.stack([outline.first, outline.second], axis=-1) + first
        arrays[name] = ends.astype(np.uint16 if small else np.uint32)
        arrays[f"{name}.share"] = np.rint(SHARES * outline.share).astype(np.uint16)


def ahead(touch: NamedTouch) -> list[float] | None:
    """Where the arrow of a touch that moves ends, from its centre [m]; None of one that stays."""
    if touch.motion is None or touch.motion.heading == "still":
        return None
    step = touch.motion.velocity / touch.motion.speed * reach_of(touch)
    return np.asarray(step).round(5).tolist()


def mean_direction(normals: FloatArray) -> FloatArray:
    """(3,) unit vector along the sum of unit vectors (k, 3); zero where they cancel."""
    total = np.asarray(normals.sum(axis=0))
    length = float(np.linalg.norm(total))
    return total / length if length > 1e-9 else np.zeros(3)
