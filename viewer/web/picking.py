"""What is known of one taxel: the answer to a click."""

from __future__ import annotations

from typing import Any

import numpy as np

from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.geometry.topology import edges
from skinmap.live.moment import Moment
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
    pairs = edges(prepared.mesh.faces)
    beside = np.unique(pairs[(pairs == taxel).any(axis=1)])
    pressure = layers.get("pressure").values(part, moment)[taxel]
    raw = layers.get("raw").values(part, moment)[taxel]
    health = layers.get("health")
    state = health.values(part, moment)[taxel]
    return {
        "kind": "pick",
        "part": part,
        "taxel": taxel,
        "channel": int(skin.channels[taxel]),
        "module": int(skin.modules[taxel]),
        "patch": int(prepared.patches[taxel]) + 1,
        "link": skin.link,
        "position_mm": (1e3 * skin.positions[taxel]).round(1).tolist(),
        "normal": skin.normals[taxel].round(3).tolist(),
        "neighbours": [int(skin.channels[k]) for k in beside if k != taxel],
        "pressure": finite(pressure),
        "raw": finite(raw),
        "structure": _structure(layers, part, taxel) if structure else "being found",
        "health": health.categories[int(state)] if np.isfinite(state) else None,
    }


def _structure(layers: Layers, part: str, taxel: int) -> str | None:
    structures = layers.get("structures")
    kind = structures.values(part, None)[taxel]
    return structures.categories[int(kind)] if np.isfinite(kind) else None
