"""What a scene refuses to show: values, touches and taxels of another skin."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import IntArray
from skinmap.errors import InvalidArrayError, SkinMismatchError, UnknownNameError
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.moment import Moment
from viewer.drawing.skin.skin_layer import SkinLayer
from viewer.layer import check_values


def check_part(part: str, layers: Mapping[str, SkinLayer]) -> SkinLayer:
    """The layer of a part.

    Raises
    ------
    UnknownNameError
        No such part.
    """
    if part not in layers:
        raise UnknownNameError("part in this scene", part, layers)
    return layers[part]


def check_moment(moment: Moment, layers: Mapping[str, SkinLayer]) -> tuple[NamedTouch, ...]:
    """The touches of a moment that lie on the parts shown.

    Raises
    ------
    SkinMismatchError
        None of its parts is shown, or values or touches of another skin.
    """
    if moment.pressures and not any(part in layers for part in moment.pressures):
        raise SkinMismatchError(
            f"a moment of {', '.join(moment.pressures)} for a scene of {', '.join(layers)}"
        )
    for values in (moment.pressures, moment.raw):
        for part in values:
            if part in layers:
                check_values(values[part], len(layers[part].skin), part)
    touches = tuple(touch for touch in moment.touches if touch.part in layers)
    check_touches(touches, layers)
    return touches


def check_touches(touches: Iterable[NamedTouch], layers: Mapping[str, SkinLayer]) -> None:
    """Refuse touches of parts or taxels that are not there.

    Raises
    ------
    UnknownNameError, SkinMismatchError
    """
    for touch in touches:
        n = len(check_part(touch.part, layers).skin)
        if touch.taxels.size and not 0 <= touch.taxels.min() <= touch.taxels.max() < n:
            raise SkinMismatchError(
                f"a touch of taxels {touch.taxels.min()} to {touch.taxels.max()} for the {n} "
                f"of {touch.part!r}"
            )


def check_taxels(taxels: ArrayLike, part: str, n: int) -> IntArray:
    """Different taxels (k,) of a part with n of them, in their order.

    Raises
    ------
    InvalidArrayError
        Taxels that are not there.
    """
    chosen = np.unique(np.asarray(taxels, np.int64))
    if chosen.size and not 0 <= chosen[0] <= chosen[-1] < n:
        raise InvalidArrayError(
            f"part {part!r} has taxels 0 to {n - 1}, not {chosen[0]} to {chosen[-1]}"
        )
    return chosen
