"""What is known of one taxel, in lines of text."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from skinmap.arrays import IntArray
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.moment import Moment
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.interaction.picking import Pick
from viewer.layers import Layer

MANY = 8  # neighbours that are listed by number


def neighbours(skin: PreparedSkin, taxel: int) -> IntArray:
    """(k,) taxels that share an edge of the surface mesh with a taxel."""
    faces = skin.mesh.faces
    own = skin.mesh.representative[taxel]
    around = np.unique(faces[(faces == own).any(axis=1)])
    return around[around != own]


def describe(
    pick: Pick, skin: PreparedSkin, moment: Moment | None, shown: Layer, structures: Layer | None
) -> tuple[str, ...]:
    """Lines for the box at a taxel.

    Parameters
    ----------
    pick : Pick
    skin : PreparedSkin
        Of the part.
    moment : Moment or None
        What is shown now.
    shown : Layer
        Its value is told beside pressure and raw value.
    structures : Layer or None
        None where they are not known yet.
    """
    table, taxel = skin.skin, pick.taxel
    position = " ".join(f"{1e3 * value:.1f}" for value in table.positions[taxel])
    normal = " ".join(f"{value:.2f}" for value in table.normals[taxel])
    around = table.channels[neighbours(skin, taxel)]
    listed = " ".join(str(channel) for channel in around[:MANY])
    more = f" and {len(around) - MANY} more" if len(around) > MANY else ""
    lines = [
        f"{pick.part.replace('_', ' ')}, channel {table.channels[taxel]}",
        f"module {table.modules[taxel]}, patch {skin.patches[taxel] + 1}, taxel {taxel}",
        f"position {position} mm",
        f"normal {normal}",
        f"neighbours {listed or 'none'}{more}",
        *_values(pick, moment, shown),
    ]
    if structures is not None:
        lines.append(f"structure {_value(structures, pick, moment)}")
    if moment is not None:
        lines += [
            f"in {_named(touch)}"
            for touch in moment.touches
            if touch.part == pick.part and taxel in touch.taxels
        ]
    return tuple(lines)


def _values(pick: Pick, moment: Moment | None, shown: Layer) -> list[str]:
    """Pressure and raw value as they came, and what the layer shows if it is neither."""
    lines = []
    if moment is not None:
        sent: tuple[tuple[str, Mapping[str, object]], ...] = (
            ("pressure", moment.pressures),
            ("raw", moment.raw),
        )
        told = [
            f"{name} {_number(values[pick.part], pick.taxel)}"
            for name, values in sent
            if pick.part in values
        ]
        if told:
            lines.append(", ".join(told) + " counts")
    if shown.name not in ("pressure", "raw", "structures", "patches"):
        lines.append(f"{shown.title} {_value(shown, pick, moment)}")
    return lines


def _number(values: object, taxel: int) -> str:
    value = float(np.asarray(values)[taxel])
    return f"{value:.4g}" if math.isfinite(value) else "unknown"


def _value(layer: Layer, pick: Pick, moment: Moment | None) -> str:
    value = float(layer.values(pick.part, moment)[pick.taxel])
    if not math.isfinite(value):
        return "unknown"
    if layer.categories:
        return layer.categories[round(value)]
    return f"{value:.3g} {layer.unit.partition(',')[0]}"


def _named(touch: NamedTouch) -> str:
    name = touch.label.replace("_", " ")
    sure = f" {100 * touch.confidence:.0f} %" if math.isfinite(touch.confidence) else ""
    return f"{name}{sure}"
