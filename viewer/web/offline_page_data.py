"""Some moments of all layers in one message: what the page plays where there is no server."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.geometry.topology import edges
from skinmap.live.moment import Moment
from viewer.layers import Layer, Layers
from viewer.playing.recent_moments import Timeline
from viewer.web.packing import pack, unpack
from viewer.web.sample import SampleWriter, layer_message, taxel_bytes
from viewer.web.scene_data import WebScene


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
    shown = [layers.get(name) for name in layers.names]
    writer = SampleWriter(scene, layers)
    headers = []
    for number, moment in enumerate(moments):
        layers.observe(moment)
        header, own = unpack(writer.write(moment, shown[0], {}))
        del own["values"]
        felt = (touch for touch in moment.touches if touch.part in scene.skins)
        for touch, own_touch in zip(header["touches"], felt, strict=True):
            touch["outline"] = f"{number}.{touch['outline']}"
            touch["members"] = np.asarray(own_touch.taxels).tolist()
        arrays.update({f"{number}.{name}": array for name, array in own.items()})
        header["poses"] = f"{number}.poses" if "poses" in own else None
        header["values"] = {
            one.name: _add_codes(arrays, scene, one, number, moment) for one in shown
        }
        header["felt"] = {
            name: _add_felt(arrays, scene, name, sent, number)
            for name, sent in (("pressure", moment.pressures), ("raw", moment.raw))
        }
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


def _add_codes(
    arrays: dict[str, NDArray[Any]], scene: WebScene, layer: Layer, number: int, moment: Moment
) -> str:
    """Add a layer's bytes, once where it is the same at all times; their name comes back."""
    name = f"{number}.{layer.name}" if layer.live else layer.name
    if name not in arrays:
        arrays[name] = np.concatenate([taxel_bytes(layer, part, moment) for part in scene.skins])
    return name


def _add_felt(
    arrays: dict[str, NDArray[Any]],
    scene: WebScene,
    kind: str,
    sent: Mapping[str, NDArray[Any]],
    number: int,
) -> str | None:
    """Add values as they came; None where nothing is known of any."""
    nothing = {part: np.full(len(skin), np.nan) for part, skin in scene.skins.items()}
    values = np.concatenate([sent.get(part, none) for part, none in nothing.items()])
    if not np.isfinite(values).any():
        return None
    name = f"{number}.felt.{kind}"
    arrays[name] = values.astype(np.float32)
    return name


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
