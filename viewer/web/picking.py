"""What is known of one taxel: the answer to a click, or to a pointer that rests on it.

`page/describe.js` makes the words of it that the window's box has (`viewer.interaction.describe`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.live.moment import Moment
from viewer.drawing.panel.touch_list import caption
from viewer.interaction.describe import neighbours
from viewer.layer import Layer
from viewer.layers import Layers
from viewer.web.packing import finite
from viewer.web.scene_data import WebScene


def describe(
    scene: WebScene,
    layers: Layers,
    part: str,
    taxel: int,
    moment: Moment | None,
    *,
    shown: str = "pressure",
    structure: bool = True,
) -> dict[str, Any]:
    """Channel, module, place and values of a taxel.

    Parameters
    ----------
    part : str
    taxel : int
        Dense row.
    moment : Moment or None
        What is shown now.
    shown : str
        The page's layer.
    structure : bool
        Whether to name its structure: finding those of a robot takes a second the first time.

    Raises
    ------
    UnknownNameError, InvalidArrayError
        A part or a taxel that is not there.
    """
    if part not in scene.skins:
        raise UnknownNameError("part shown", part, scene.skins)
    prepared = scene.skins[part]
    skin = prepared.skin
    if not 0 <= taxel < len(skin):
        raise InvalidArrayError(f"{part!r} has taxels 0 to {len(skin) - 1}, not {taxel}")
    touches = () if moment is None else moment.touches
    return {
        "part": part,
        "taxel": taxel,
        "channel": int(skin.channels[taxel]),
        "module": int(skin.modules[taxel]),
        "patch": int(prepared.patches[taxel]) + 1,
        "link": skin.link,
        "position_mm": (1e3 * skin.positions[taxel]).round(1).tolist(),
        "normal": skin.normals[taxel].round(2).tolist(),
        "neighbours": skin.channels[neighbours(prepared, taxel)].tolist(),
        **_felt(layers, part, taxel, moment),
        "structure": _structure(layers, part, taxel) if structure else "being found",
        "health": _category(layers.get("health"), part, taxel, moment),
        "shown": _shown(layers.get(shown), part, taxel, moment),
        "touches": [caption(t) for t in touches if t.part == part and taxel in t.taxels],
    }


def _felt(layers: Layers, part: str, taxel: int, moment: Moment | None) -> dict[str, Any]:
    """Pressure and raw value, and which of them came."""
    found: dict[str, Any] = {"sent": []}
    for name, sent in (("pressure", "pressures"), ("raw", "raw")):
        found[name] = finite(layers.get(name).values(part, moment)[taxel])
        if moment is not None and part in getattr(moment, sent):
            found["sent"].append(name)
    return found


def _shown(layer: Layer, part: str, taxel: int, moment: Moment | None) -> dict[str, Any]:
    """What the layer that is shown says."""
    known = not layer.categories
    return {
        "name": layer.name,
        "title": layer.title,
        "unit": layer.unit,
        "value": finite(layer.values(part, moment)[taxel]) if known else None,
        "category": _category(layer, part, taxel, moment),
    }


def _category(layer: Layer, part: str, taxel: int, moment: Moment | None) -> str | None:
    if not layer.categories:
        return None
    kind = layer.values(part, moment)[taxel]
    return layer.categories[round(kind)] if np.isfinite(kind) else None


def _structure(layers: Layers, part: str, taxel: int) -> str:
    return _category(layers.get("structures"), part, taxel, None) or "unknown"
