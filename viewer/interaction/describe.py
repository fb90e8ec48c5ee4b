"""What is known of one taxel: for the page as it is, for the window's box in lines of text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from skinmap.arrays import IntArray
from skinmap.errors import InvalidArrayError, check_known
from skinmap.live.moment import Moment
from skinmap.summary import first_few
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.drawing.panel.touch_list import caption
from viewer.drawing.skin.taxel_drawing import SIGNS
from viewer.layers import Layer, Layers
from viewer.web.scene_data import finite

MANY = 8  # neighbours that are listed by number


def neighbours(skin: PreparedSkin, taxel: int) -> IntArray:
    """(k,) taxels that share an edge of the surface mesh with a taxel."""
    faces = skin.mesh.faces
    own = skin.mesh.representative[taxel]
    around = np.unique(faces[(faces == own).any(axis=1)])
    return around[around != own]


def describe(
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
    check_known("part shown", [part], layers.skins)
    prepared = layers.skins[part]
    skin = prepared.skin
    if not 0 <= taxel < len(skin):
        raise InvalidArrayError(f"{part!r} has taxels 0 to {len(skin) - 1}, not {taxel}")
    touches = () if moment is None else moment.touches
    found: str | None = "being found"
    if structure:
        found = _category(layers.get("structures"), part, taxel, None)
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
        **_felt(part, taxel, moment),
        "structure": found or "unknown",
        "health": _category(layers.get("health"), part, taxel, moment),
        "shown": _shown(layers.get(shown), part, taxel, moment),
        "touches": [caption(t) for t in touches if t.part == part and taxel in t.taxels],
    }


def _felt(part: str, taxel: int, moment: Moment | None) -> dict[str, Any]:
    """Pressure and raw value as they came, and which of them did."""
    found: dict[str, Any] = {"sent": []}
    for name, kind in (("pressure", "pressures"), ("raw", "raw")):
        values = {} if moment is None else getattr(moment, kind)
        found[name] = finite(float(values[part][taxel])) if part in values else None
        found["sent"] += [name] if part in values else []
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


def lines(about: Mapping[str, Any]) -> tuple[str, ...]:
    """What is known of a taxel, as `describe` has it, for the box beside it."""
    position = " ".join(f"{value:.1f}" for value in about["position_mm"])
    normal = " ".join(f"{value:.2f}" for value in about["normal"])
    told = [
        f"{name} {about[name]:.4g}" if about[name] is not None else f"{name} unknown"
        for name in about["sent"]
    ]
    written = [
        f"{about['part'].replace('_', ' ')}, channel {about['channel']}",
        f"module {about['module']}, patch {about['patch']}, taxel {about['taxel']}",
        f"position {position} mm",
        f"normal {normal}",
        f"neighbours {first_few(about['neighbours'], MANY, ' ') or 'none'}",
    ]
    if told:
        written.append(", ".join(told) + " counts")
    shown = about["shown"]
    if shown["name"] not in ("pressure", "raw", "structures", "patches"):
        value = "unknown" if shown["category"] is None else shown["category"]
        if shown["value"] is not None:
            value = f"{shown['value']:.3g} {shown['unit'].partition(',')[0]}"
        written.append(f"{shown['title']} {value}")
    if shown["name"] != "health" and about["health"] in SIGNS:
        written.append(f"health {about['health']}")
    written.append(f"structure {about['structure']}")
    return (*written, *(f"in {touch}" for touch in about["touches"]))
