"""What the skin can show: one value for each taxel, with its colours, limits and unit.

layers = Layers(skins)
layer = layers.get("pressure")
layer.colours(layer.values("torso", moment))
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import FloatArray, check_finite
from skinmap.errors import SkinMismatchError, UnknownNameError
from skinmap.live.moment import Moment
from skinmap.neighbours.offsets import concatenate
from skinmap.neighbours.structures import find_structures
from skinmap.touch.contacts import ACTIVE
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.colours import (
    CATEGORIES,
    DISTORTION_STOPS,
    HEALTH,
    NONE,
    PRESSURE_STOPS,
    RARER,
    RAW_STOPS,
    TOUCHED,
    UNCERTAINTY_STOPS,
    UNTOUCHED,
    ramp,
)
from viewer.health import STATES, HealthWatch
from viewer.layer import Layer as Layer
from viewer.layer import categories, check_values

LAYERS = (
    "pressure",
    "raw",
    "binary",
    "structures",
    "uncertainty",
    "distortion",
    "health",
    "patches",
)
FULL_SCALE = 255.0  # counts
WORST_SD = 3.0  # [mm]: half a pitch of the finest skins; beyond, taxels are taken for neighbours
WORST_STRAIN = 5.0  # [%]
AUTO: Literal["auto"] = "auto"
Range = tuple[float, float] | Literal["auto"]
# What one of a layer's own unit is in another.
UNITS: dict[str, dict[str, float]] = {
    "%": {"counts": 100.0 / FULL_SCALE},
    "um": {"mm": 1e3},
    "cm": {"mm": 0.1},
}
TURNS = 6  # structures that are turned by multiples of 60 degrees count as one


class Layers:
    """All layers of a robot's skin, each made when first asked for.

    Parameters
    ----------
    skins : mapping of str to PreparedSkin
        The parts.
    covariances : mapping of str to (n, 3, 3) array-like, optional
        Of the calibrated positions of each part's taxels [m2].
    healths : mapping of str to (n,) array-like of str, optional
        States of each part's taxels, named as in `viewer.health.STATES`.
    ranges : mapping of str to (float, float) or "auto", optional
        Values of a layer's first and last colour, in its unit. "auto" takes the least and the
        largest value that were seen so far: such limits grow, and never shrink.
    units : iterable of str, optional
        Of `UNITS`: what values of layers are told in.
    """

    def __init__(
        self,
        skins: Mapping[str, PreparedSkin],
        *,
        covariances: Mapping[str, ArrayLike] | None = None,
        healths: Mapping[str, ArrayLike] | None = None,
        ranges: Mapping[str, Range] | None = None,
        units: Iterable[str] = (),
    ) -> None:
        for name in ranges or {}:
            check_layer(name)
        self._ranges = dict(ranges or {})
        self._units = tuple(units)
        self.skins = dict(skins)
        self._sd = {part: self._worst_sd(part, c) for part, c in (covariances or {}).items()}
        for part in healths or {}:
            self._check(part)
        self.watch = HealthWatch({p: len(s) for p, s in self.skins.items()}, healths)
        self._made: dict[str, Layer] = {}
        self._seen: dict[str, tuple[float, float]] = {}  # limits of the layers that find them

    @property
    def names(self) -> tuple[str, ...]:
        """What `get` knows."""
        return LAYERS

    def get(self, name: str) -> Layer:
        """A layer by name.

        Raises
        ------
        UnknownNameError
            No such layer (says which there are).
        """
        check_layer(name)
        if name not in self._made:
            makers: dict[str, Callable[[], Layer]] = {
                "pressure": self._pressure,
                "raw": self._raw,
                "binary": self._binary,
                "structures": self._structures,
                "uncertainty": self._uncertainty,
                "distortion": self._distortion,
                "health": self._health,
                "patches": self._patches,
            }
            self._made[name] = self._as_wished(makers[name]())
        return self._made[name]

    @property
    def felt(self) -> Layer:
        """Pressures in counts from 0 to 255, whatever range and unit the layer of them has."""
        return self._pressure()

    def observe(self, moment: Moment) -> None:
        """See a moment: what was touched or sits at full scale, and how far values go."""
        self.watch.observe(moment)
        for name, wanted in self._ranges.items():
            layer = self._made.get(name)
            if wanted == AUTO and layer is not None and layer.live:
                self._made[name] = self._widened(layer, moment)

    def _as_wished(self, layer: Layer) -> Layer:
        """A layer in the unit and with the limits that were asked for."""
        for unit in self._units:
            if (factor := UNITS[unit].get(layer.unit.partition(",")[0])) is not None:
                layer = in_unit(layer, unit, factor)
        wanted = self._ranges.get(layer.name)
        if wanted is None or layer.categories:
            return layer
        if wanted != AUTO:
            return replace(layer, limits=wanted)
        return self._widened(layer, None, layer.limits)

    def _widened(
        self, layer: Layer, moment: Moment | None, least: tuple[float, float] = (0.0, 1.0)
    ) -> Layer:
        """Limits that hold the values of a moment too; as they are where nothing is known."""
        values = np.concatenate([layer.values(part, moment) for part in self.skins])
        known = values[np.isfinite(values)]
        low, high = self._seen.get(layer.name, (math.inf, -math.inf))
        if len(known):
            low, high = min(low, float(known.min())), max(high, float(known.max()))
            self._seen[layer.name] = (low, high)
        if not low < high:
            low, high = least if not math.isfinite(low) else (low, low + 1.0)
        return layer if layer.limits == (low, high) else replace(layer, limits=(low, high))

    def _check(self, part: str) -> None:
        if part not in self.skins:
            raise UnknownNameError("part with skin here", part, self.skins)

    def _worst_sd(self, part: str, covariance: ArrayLike) -> FloatArray:
        """(n,) predicted standard deviation of each position in its worst direction [mm]."""
        self._check(part)
        matrices = np.asarray(covariance, np.float64)
        # A table may know some rows only: those of NaN throughout are unknown, but not all of them.
        known = ~np.isnan(matrices).all(axis=(1, 2)) if matrices.ndim == 3 else np.array(False)
        checked = matrices[known] if known.any() else matrices
        check_finite(checked, f"covariance of {part!r}", (None, 3, 3))
        if len(matrices) != len(self.skins[part]):
            raise SkinMismatchError(
                f"covariances of {len(matrices)} taxels for the {len(self.skins[part])} of {part!r}"
            )
        sd = np.full(len(matrices), np.nan)
        largest = np.linalg.eigvalsh(matrices[known])[:, -1]
        sd[known] = 1e3 * np.sqrt(np.maximum(largest, 0.0))
        return sd

    def _sent(self, kind: str, part: str, moment: Moment | None) -> FloatArray:
        self._check(part)
        sent = {} if moment is None else getattr(moment, kind)
        if part not in sent:
            return np.full(len(self.skins[part]), np.nan)
        return check_values(sent[part], len(self.skins[part]), part)

    def _fixed(self, table: Mapping[str, FloatArray], part: str, _: Moment | None) -> FloatArray:
        self._check(part)
        return table[part] if part in table else np.full(len(self.skins[part]), np.nan)

    def _pressure(self) -> Layer:
        return self._counts("pressure", "pressure", "pressures", PRESSURE_STOPS)

    def _raw(self) -> Layer:
        return self._counts("raw", "raw value", "raw", RAW_STOPS)

    def _counts(
        self, name: str, label: str, kind: str, stops: Sequence[tuple[float, str]]
    ) -> Layer:
        absent = f"no {label}s in this source"
        limits, sent = (0.0, FULL_SCALE), partial(self._sent, kind)
        return Layer(name, label, "counts", limits, ramp(stops), (), True, absent, sent)

    def _binary(self) -> Layer:
        def touched(part: str, moment: Moment | None) -> FloatArray:
            counts = self._sent("pressures", part, moment)
            return np.where(np.isfinite(counts), counts > ACTIVE, np.nan)

        names = ("not touched", "touched")
        return categories(
            "binary", f"above {ACTIVE:g} counts", names, (UNTOUCHED, TOUCHED), touched, live=True
        )

    def _structures(self) -> Layer:
        """The most common periodic structures of all parts together, turned ones being one."""
        parts = list(self.skins)
        hoods = concatenate([self.skins[part].hoods for part in parts])
        found = find_structures(hoods, rotations=TURNS)
        named = min(len(CATEGORIES), len(found.prototypes))
        rank = np.where(found.labels < 0, named + 1, np.minimum(found.labels, named))
        count = np.bincount(rank, minlength=named + 2)
        names = [f"{s + 1}: {count[s]:,} taxels" for s in range(named)]
        names += [f"rarer: {count[named]:,}", f"none: {count[named + 1]:,}"]
        ends = np.cumsum([len(self.skins[part]) for part in parts])[:-1]
        ranks = np.split(rank.astype(np.float64), ends)
        table = dict(zip(parts, ranks, strict=True))
        colours = (*CATEGORIES[:named], RARER, NONE)
        source = partial(self._fixed, table)
        return categories("structures", "periodic structure", tuple(names), colours, source)

    def _uncertainty(self) -> Layer:
        return Layer(
            "uncertainty",
            "uncertainty",
            "mm, predicted sd in the worst direction",
            (0.0, WORST_SD),
            ramp(UNCERTAINTY_STOPS),
            (),
            False,
            "no calibration given",
            partial(self._fixed, self._sd),
        )

    def _distortion(self) -> Layer:
        strain = {part: taxel_strain(skin) for part, skin in self.skins.items()}
        return Layer(
            "distortion",
            "distortion of the flat map",
            "% of length, rms of a taxel's edges",
            (0.0, WORST_STRAIN),
            ramp(DISTORTION_STOPS),
            (),
            False,
            "no flat map",
            partial(self._fixed, strain),
        )

    def _health(self) -> Layer:
        def state(part: str, moment: Moment | None) -> FloatArray:
            self._check(part)
            return self.watch.states(part, moment).astype(np.float64)

        colours = tuple(HEALTH[name] for name in STATES)
        return categories("health", "health", STATES, colours, state, live=True)

    def _patches(self) -> Layer:
        most = max(
            (int(skin.patches.max(initial=0)) + 1 for skin in self.skins.values()), default=1
        )
        named = min(most, len(CATEGORIES))
        names = [f"patch {k + 1}" for k in range(named)]
        if most > named:
            names[-1] = f"patch {named} and more"
        table = {}
        for part, skin in self.skins.items():
            patch = np.minimum(skin.patches, named - 1).astype(np.float64)
            table[part] = np.where(skin.patches < 0, float(named), patch)
        colours = (*CATEGORIES[:named], NONE)
        source = partial(self._fixed, table)
        return categories("patches", "patch", (*names, "none"), colours, source)


def check_layer(name: str) -> str:
    """A layer that exists.

    Raises
    ------
    UnknownNameError
    """
    if name not in LAYERS:
        raise UnknownNameError("layer", name, LAYERS)
    return name


def in_unit(layer: Layer, unit: str, factor: float) -> Layer:
    """A layer whose values are told in another unit."""
    low, high = layer.limits
    _, comma, more = layer.unit.partition(",")
    full = " of full scale" if unit == "%" else ""

    def values(part: str, moment: Moment | None) -> FloatArray:
        return factor * layer.values(part, moment)

    limits = (factor * low, factor * high)
    return replace(layer, unit=f"{unit}{full}{comma}{more}", limits=limits, source=values)


def taxel_strain(skin: PreparedSkin) -> FloatArray:
    """(n,) root mean square of the length errors of each taxel's edges on the flat map [%]."""
    n = len(skin)
    squares, count = np.zeros(n), np.zeros(n)
    for chart in skin.flat.charts:
        ends = chart.taxels[chart.distortion.edges]
        for column in (0, 1):
            np.add.at(squares, ends[:, column], chart.distortion.edge_strain**2)
            np.add.at(count, ends[:, column], 1.0)
    with np.errstate(invalid="ignore"):
        strain = 100.0 * np.sqrt(squares / count)
    return np.asarray(strain[skin.mesh.representative])
