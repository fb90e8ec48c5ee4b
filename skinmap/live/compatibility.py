"""Whether a stream, a classifier and the skins fit together, and where each taxel stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skinmap.arrays import IntArray
from skinmap.classify.classifier import TouchClassifier
from skinmap.errors import SkinMismatchError, UnknownNameError
from skinmap.live.sources.source import StreamInfo
from skinmap.touch.prepared_skin import PreparedSkin


def gather(info: StreamInfo, skins: Mapping[str, PreparedSkin]) -> IntArray:
    """(N,) place in a stream's sample of each taxel of some parts, in dense rows."""
    places = []
    for part, skin in skins.items():
        rows = info.part_slice(part)
        dense = rows.stop - rows.start == len(skin)
        places.append(rows.start + (np.arange(len(skin)) if dense else skin.skin.channels))
    return np.concatenate(places)


def check_classifier(classifier: TouchClassifier, skins: Any) -> None:
    """Refuse a classifier that cannot name touches on one of some skins.

    Raises
    ------
    SkinMismatchError
        It reads taxels by their number, and learnt another skin.
    """
    for skin in skins:
        difference = classifier.difference(skin.skin)
        if not difference.may_go_on:
            raise SkinMismatchError(f"{classifier.name!r} cannot go on: {difference.message}")


def chosen_parts(info: StreamInfo, parts: Sequence[str] | None) -> tuple[str, ...]:
    """Parts of a stream that were asked for, in its order; all where none was.

    Raises
    ------
    UnknownNameError
        The stream has no such part.
    """
    for part in parts or ():
        if part not in info.parts:
            raise UnknownNameError(f"part in stream {info.name!r}", part, info.parts)
    return tuple(part for part in info.parts if not parts or part in parts)


def dense_info(info: StreamInfo, robot: str, skins: Mapping[str, PreparedSkin]) -> StreamInfo:
    """How a publisher describes the pressures of a stream's skins: dense rows of each part."""
    from skinmap.skin.fingerprint import fingerprint

    return StreamInfo(
        info.name,
        tuple(skins),
        tuple(map(len, skins.values())),
        info.rate,
        "pressure",
        robot,
        {part: fingerprint(skin.skin) for part, skin in skins.items()},
        info.clock,
    )
