"""What the skin can show: one value for each taxel, with its colours, limits and unit.

layers = Layers(skins)
layer = layers.get("pressure")
layer.colours(layer.values("torso", moment))

Two sources side by side show parts and touches that they have in common, and how these differ.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import starmap

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite
from skinmap.errors import SkinMismatchError, UnknownNameError, check_known
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from skinmap.live.response.loads import far_rest
from skinmap.live.touched_taxels import Touched
from skinmap.neighbours.offsets import auto_radius, concatenate
from skinmap.neighbours.structures import find_structures, usual_radius, usual_tolerance
from skinmap.skin.skin import fingerprint
from skinmap.touch.contacts.skin_geometry import ACTIVE
from skinmap.touch.load_calibration import LoadCalibration
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.colours import (
    CATEGORIES,
    DIFFERENCE_STOPS,
    DISTORTION_STOPS,
    HEALTH,
    NONE,
    PRESSURE_STOPS,
    RARER,
    RAW_STOPS,
    TOUCHED,
    TOUCHED_STOPS,
    UNCERTAINTY_STOPS,
    UNKNOWN,
    UNTOUCHED,
    ramp,
    rgb,
    steps,
)
from viewer.results import LAYERS

Values = Callable[[str, Moment | None], FloatArray]


# What "touched" shows, as "touched:dwell"; how often by itself: title, unit in what is recorded.
TOUCHED_KINDS = {
    "": ("touches", "of each taxel, in {}"),
    "dwell": ("touched for", "s, all touches of {}"),
    "largest": ("largest pressure", "counts, in {}"),
    "last": ("touched last", "s, from the beginning of the recording"),
}
# Changes of a taxel between check-ups, each with its colour.
CHANGES = {
    "as before": UNTOUCHED,
    "weaker": CATEGORIES[0],
    "stronger": CATEGORIES[6],
    "rest moved": CATEGORIES[1],
    "noisier": CATEGORIES[2],
    "feels elsewhere": CATEGORIES[4],
}
FULL_SCALE = 255.0  # counts
DIFFERENT = 128.0  # counts, at the ends of the scale of differences
KILOPASCALS = 100.0  # in a bar
WORST_SD = 3.0  # [mm]: half a pitch of the finest skins; beyond, taxels are taken for neighbours
WORST_STRAIN = 5.0  # [%]
TURNS = 6  # structures that are turned by multiples of 60 degrees count as one


@dataclass(frozen=True, eq=False, slots=True)
class Layer:
    """One thing that the skin can show.

    Attributes
    ----------
    name : str
        One of `viewer.layers.LAYERS`.
    title, unit : str
        What stands at the colour bar; categories have no unit.
    limits : (float, float)
        Values of the table's first and last colour: fixed, so that pictures compare.
    table : (k, 4) uint8
        Colours from low to high, or of each category.
    categories : tuple of str
        Names of the values 0, 1, ... where these have no order; empty otherwise.
    live : bool
        Whether values change from moment to moment.
    missing : str
        Why there are no values, for where all are NaN.
    grey : str
        Why a sound taxel has no value where others of its part do; empty where one that lacks it
        is stale.
    cut : (bool, bool)
        Whether lower and higher values than the limits have the colours of these.
    values : callable
        (part, moment) to (n,) what the taxels of a part show; NaN where nothing is known. Of a part
        that is not there, or a moment of another skin, UnknownNameError or SkinMismatchError.
    """

    name: str
    title: str
    unit: str
    limits: tuple[float, float]
    table: NDArray[np.uint8]
    values: Values
    categories: tuple[str, ...] = ()
    live: bool = False
    missing: str = "nothing known"
    grey: str = ""
    cut: tuple[bool, bool] = (False, False)

    @property
    def heard(self) -> bool:
        """Whether a part without values is none of the source's."""
        return self.live or (self.name.partition(":")[0] == "touched" and not self.grey)

    def rows(self, values: FloatArray) -> IntArray:
        """(n,) row of the table for each value (n,); -1 where nothing is known."""
        low, high = self.limits
        k = len(self.table)
        known = np.isfinite(values)
        share = (np.where(known, values, low) - low) / (high - low)
        return np.where(known, np.clip(np.floor(share * k), 0, k - 1), -1).astype(np.int64)

    def colours(self, values: FloatArray) -> NDArray[np.uint8]:
        """(n, 3) red, green and blue for values (n,), 0 to 255."""
        unknown = np.rint(rgb(UNKNOWN) * 255).astype(np.uint8)
        return np.vstack([self.table[:, :3], unknown])[self.rows(values)]


def categories(
    name: str,
    title: str,
    names: tuple[str, ...],
    colours: tuple[str, ...],
    source: Values,
    *,
    live: bool = False,
) -> Layer:
    """A layer of names without an order, each in its colour."""
    limits = (-0.5, len(names) - 0.5)
    return Layer(name, title, "", limits, steps(colours), source, names, live)


def check_values(values: ArrayLike, n: int, part: str) -> FloatArray:
    """Values (n,) as float64; infinite ones become NaN, as they say nothing.

    Raises
    ------
    SkinMismatchError
        Another number of values than the skin has taxels, or words.
    """
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise SkinMismatchError(f"values of {part!r} are not numbers") from error
    if array.shape != (n,):
        raise SkinMismatchError(f"pressures of shape {array.shape} for the {n} taxels of {part!r}")
    return array if np.isfinite(array).all() else np.where(np.isfinite(array), array, np.nan)


class Layers:
    """All layers of a robot's skin, each made when first asked for.

    Parameters
    ----------
    skins : mapping of str to PreparedSkin
        The parts.
    covariances : mapping of str to (n, 3, 3) array-like, optional
        Of the calibrated positions of each part's taxels [m2].
    healths : mapping of str to (n,) array-like of str, optional
        States of each part's taxels, named as in `viewer.layers.STATES`.
    ranges : mapping of str to (float, float), optional
        Values of a layer's first and last colour, in its unit.
    loads : mapping of str to LoadCalibration, optional
        Of parts whose pressures are shown in kPa, from 0 to the end of the calibrated range.
    touched : callable
        Gives where recordings touched the skin, when the layer "touched" is asked for.
    changed : callable
        Gives the day of the first check-up and, by part, the (n,) changes of its taxels since,
        each one of `viewer.layers.CHANGES`, when the layer "changed" is asked for.

    Examples
    --------
    >>> import numpy as np
    >>> import skinmap
    >>> from skinmap.live import Moment
    >>> from skinmap.touch.prepared_skin import PreparedSkin
    >>> from viewer import Layers
    >>> skin = PreparedSkin(skinmap.load_robot("kaspar").skin("torso"))
    >>> layers = Layers({"torso": skin})
    >>> states = np.full(len(skin), "ok", "<U7")
    >>> states[7] = "stuck"
    >>> moment = Moment(0.0, {"torso": np.full(len(skin), 9.0)}, states={"torso": states})
    >>> layers.observe(moment)
    >>> layers.get("pressure").values("torso", moment)[6:9].tolist()
    [9.0, nan, 9.0]
    >>> layer = layers.get("health")
    >>> layer.categories[int(layer.values("torso", moment)[7])]
    'stuck'
    """

    def __init__(
        self,
        skins: Mapping[str, PreparedSkin],
        *,
        covariances: Mapping[str, ArrayLike] | None = None,
        healths: Mapping[str, ArrayLike] | None = None,
        ranges: Mapping[str, tuple[float, float]] | None = None,
        touched: Callable[[], Touched | None] = lambda: None,
        loads: Mapping[str, LoadCalibration] | None = None,
        changed: Callable[[], tuple[str, Mapping[str, Sequence[str]]]] = lambda: ("", {}),
    ) -> None:
        for name in ranges or {}:
            check_layer(name)
        self._ranges = dict(ranges or {})
        self.skins = dict(skins)
        self._sd = {part: self._worst_sd(part, c) for part, c in (covariances or {}).items()}
        for part in healths or {}:
            self._check(part)
        self.watch = HealthWatch({p: len(s) for p, s in self.skins.items()}, healths)
        self._made: dict[str, Layer] = {}
        self._touches, self._loads = touched, dict(loads or {})
        self._changes = changed
        self.moment: Moment | None = None
        self.pair: Pair | None = None

    def get(self, name: str) -> Layer:
        """A layer by name.

        Raises
        ------
        UnknownNameError
            No such layer (lists those that exist).
        """
        check_layer(name)
        if name not in self._made:
            layer = self.build(name)
            self._made[name] = layer if self.pair is None else self.pair.on_one_scale(layer)
        return self._made[name]

    def build(self, name: str) -> Layer:
        """A layer by name, on a scale of its own, whatever stands beside it."""
        base, _, kind = name.partition(":")
        layer: Layer = getattr(self, f"_{base}")(*[kind] * (base == "touched"))
        ranged = name in self._ranges and not layer.categories
        if not ranged:
            return layer
        (low, high), (below, above) = self._ranges[name], layer.cut
        cut = (below or low > layer.limits[0], above or high < layer.limits[1])
        return replace(layer, limits=(low, high), cut=cut)

    def stand_in(self, pair: Pair) -> None:
        """Take a place in a pair: layers are made anew, on one scale with the other's."""
        self.pair = pair
        self._made.clear()

    @property
    def counts(self) -> Layer:
        """Pressures in counts from 0 to 255, whatever range and unit the layer of them has."""
        return _counts("pressure", "pressure", self._felt, PRESSURE_STOPS)

    def felt(self, moment: Moment) -> dict[str, FloatArray]:
        """Pressures (n,) [counts] of each part in a moment; NaN where a taxel is mute."""
        return {part: self._felt(part, moment) for part in moment.pressures if part in self.skins}

    def observe(self, moment: Moment) -> None:
        """See a moment: what was touched or sits at full scale."""
        self.watch.observe(moment)
        self.moment = moment

    def pressed(self, part: str) -> FloatArray:
        """(n,) pressures [counts] of a part in the moment seen last; NaN where there are none."""
        return self._felt(part, self.moment)

    def _check(self, part: str) -> None:
        check_known("part with skin here", [part], self.skins)

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

    def _felt(self, part: str, moment: Moment | None) -> FloatArray:
        """(n,) pressures; NaN where what a taxel reads is not a pressure."""
        counts = self._sent("pressures", part, moment)
        mute = self.watch.mute(part)
        return np.where(mute, np.nan, counts) if mute.any() else counts

    def _found(self, table: Mapping[str, FloatArray]) -> Values:
        """Values that stay what they are, NaN for parts that a table lacks."""

        def values(part: str, _: Moment | None) -> FloatArray:
            self._check(part)
            return table[part] if part in table else np.full(len(self.skins[part]), np.nan)

        return values

    def _pressure(self) -> Layer:
        if not self._loads:
            return self.counts
        limits = (0.0, KILOPASCALS * max(float(one.top.max()) for one in self._loads.values()))
        return replace(
            self.counts, unit="kPa", limits=limits, missing="not calibrated", values=self._pressed
        )

    def _pressed(self, part: str, moment: Moment | None) -> FloatArray:
        """(n,) pressures [kPa] of a part that is calibrated."""
        sent = "raw" if moment is not None and part in moment.raw else "pressures"
        counts = self._sent(sent, part, moment)
        load = self._loads.get(part)
        # Pressures rest at 0: a calibration of raw counts reads nothing from them.
        if load is None or (
            sent == "pressures" and far_rest(load, 0.0 * load.rest, pressures=True)
        ):
            return np.full(len(counts), np.nan)
        found = KILOPASCALS * load.steady(counts)
        return np.where(self.watch.mute(part), np.nan, found)

    def _raw(self) -> Layer:
        return _counts("raw", "raw value", partial(self._sent, "raw"), RAW_STOPS)

    def _binary(self) -> Layer:
        def touched(part: str, moment: Moment | None) -> FloatArray:
            counts = self._felt(part, moment)
            return np.where(np.isfinite(counts), counts > ACTIVE, np.nan)

        names = ("not touched", "touched")
        return categories(
            "binary", f"above {ACTIVE:g} counts", names, (UNTOUCHED, TOUCHED), touched, live=True
        )

    def _structures(self) -> Layer:
        """The most common periodic structures of all parts together, turned ones being one."""
        parts = list(self.skins)
        places = [self.skins[part].skin.positions for part in parts]
        radius = auto_radius(places, near=usual_radius(places))
        hoods = concatenate([self.skins[part].neighbourhoods(radius=radius) for part in parts])
        found = find_structures(hoods, tolerance=usual_tolerance(hoods), rotations=TURNS)
        named = min(len(CATEGORIES), len(found.prototypes))
        rank = np.where(found.labels < 0, named + 1, np.minimum(found.labels, named))
        count = np.bincount(rank, minlength=named + 2)
        names = [f"{s}: {count[s]:,} taxels" for s in range(named)]  # as `skinmap structures`
        names += [f"rarer: {count[named]:,}", f"none: {count[named + 1]:,}"]
        ends = np.cumsum([len(self.skins[part]) for part in parts])[:-1]
        ranks = np.split(rank.astype(np.float64), ends)
        table = dict(zip(parts, ranks, strict=True))
        colours = (*CATEGORIES[:named], RARER, NONE)
        source = self._found(table)
        title = f"periodic structure within {1e3 * radius:.2f} mm"
        return categories("structures", title, tuple(names), colours, source)

    def _uncertainty(self) -> Layer:
        title, unit = "uncertainty", "mm, predicted sd in the worst direction"
        scale = (0.0, WORST_SD), ramp(UNCERTAINTY_STOPS)
        missing = "no calibration given"
        source, cut = self._found(self._sd), (False, True)
        return Layer("uncertainty", title, unit, *scale, source, missing=missing, cut=cut)

    def _distortion(self) -> Layer:
        strain = self._found({part: taxel_strain(skin) for part, skin in self.skins.items()})
        title, unit = "distortion of the flat map", "% of length, rms of a taxel's edges"
        scale = (0.0, WORST_STRAIN), ramp(DISTORTION_STOPS)
        cut = (False, True)
        return Layer("distortion", title, unit, *scale, strain, missing="no flat map", cut=cut)

    def _health(self) -> Layer:
        def state(part: str, moment: Moment | None) -> FloatArray:
            self._check(part)
            return self.watch.states(part, moment).astype(np.float64)

        colours = tuple(HEALTH[name] for name in STATES)
        return categories("health", "health", STATES, colours, state, live=True)

    def _patches(self) -> Layer:
        """Each patch of all parts in a colour; where these are too few, those of one number share.

        Patches are numbered from 0 in each part.
        """
        counts = [int(skin.patches.max(initial=-1)) + 1 for skin in self.skins.values()]
        apart = len(counts) > 1 and sum(counts) <= len(CATEGORIES)
        named = min(sum(counts) if apart else max(counts, default=1), len(CATEGORIES))
        names = [f"patch {k}" for k in range(named)]
        if apart:
            each = zip(self.skins, counts, strict=True)
            names = [f"{part.replace('_', ' ')} {k}" for part, n in each for k in range(n)]
        elif max(counts, default=0) > named:
            names[-1] = f"patch {named - 1} and more"
        table, start = {}, 0
        for (part, skin), count in zip(self.skins.items(), counts, strict=True):
            patch = np.minimum(skin.patches + start, named - 1).astype(np.float64)
            table[part] = np.where(skin.patches < 0, float(named), patch)
            start += count if apart else 0
        colours = (*CATEGORIES[:named], NONE)
        return categories("patches", "patch", (*names, "none"), colours, self._found(table))

    def _changed(self) -> Layer:
        """The change of each taxel since the first check-up."""
        first, found = self._changes()
        names = tuple(CHANGES)
        table = {part: np.array([names.index(kind) for kind in kinds], np.float64)
                 for part, kinds in found.items()}  # fmt: skip
        layer = categories("changed", f"changes since {first}" if first else "changes", names,
                           tuple(CHANGES.values()), self._found(table))  # fmt: skip
        missing = "no changes known: give a folder with two check-ups or more with --calibration"
        return replace(layer, missing=missing)

    def _difference(self) -> Layer:
        """Pressures of the source at the right, less those of the one at the left."""

        def values(part: str, _: Moment | None) -> FloatArray:
            found = None if self.pair is None else self.pair.values(part)
            return np.full(len(self.skins[part]), np.nan) if found is None else found

        layer = _counts("difference", "difference", values, DIFFERENCE_STOPS)
        missing = "nothing beside it: give --beside" if self.pair is None else "no skin in common"
        return replace(layer, unit=f"counts, {ORDER}", limits=(-DIFFERENT, DIFFERENT),
                       missing=missing)  # fmt: skip

    def _touched(self, kind: str) -> Layer:
        """How often, how long, how hard or when last each taxel was touched."""
        found = self._touches()
        title, unit = TOUCHED_KINDS[kind]
        many = 0 if found is None else len(found.recordings)
        unit = unit.format(f"all {many} recordings" if many > 1 else "the whole recording")
        table = {}
        for part, one in ({} if found is None else found.parts).items():
            values = np.asarray(getattr(one, kind or "count"), np.float64)
            # White is never: a taxel that was touched at once has another colour.
            table[part] = np.where(one.count > 0, values, np.nan if kind == "last" else 0.0)
        most = max((float(np.nanmax(one, initial=0.0)) for one in table.values()), default=0.0)
        name, top = f"touched:{kind}" if kind else "touched", max(most, 1.0)
        missing = "nothing recorded: give a recording or a folder of some with --layer touched"
        scale = (0.0, top), ramp(TOUCHED_STOPS)
        grey = "never touched" if kind == "last" else ""
        return Layer(name, title, unit, *scale, self._found(table), missing=missing, grey=grey)


def check_layer(name: str) -> str:
    """A layer that exists.

    Raises
    ------
    UnknownNameError
    """
    base, _, kind = name.partition(":")
    if base not in LAYERS or (kind and (base != "touched" or kind not in TOUCHED_KINDS)):
        kinds = [f"touched:{one}" for one in TOUCHED_KINDS if one]
        raise UnknownNameError("layer", name, [*LAYERS, *kinds])
    return name


def _counts(name: str, label: str, source: Values, stops: Sequence[tuple[float, str]]) -> Layer:
    """A layer of counts that come with each moment."""
    absent = f"no {label}s in this source"
    scale = (0.0, FULL_SCALE), ramp(stops)
    return Layer(name, label, "counts", *scale, source, live=True, missing=absent)


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


# The health of each taxel: what a response calibration says, and what the stream shows.
#
# What a dead, stuck or noisy taxel reads is not a pressure: every layer draws the sign of its
# state, and outlines, peaks and plots leave it out.

# As `calibration.response.Health` names them, and what only a stream can be: silent, or high since
# it began ("unheard"), so that nobody knows whether it is touched or hangs.
STATES: tuple[str, ...] = (
    "ok", "never touched", "dead", "stuck", "saturated", "noisy", "unheard", "stale",
)  # fmt: skip
OK, NEVER, DEAD, STUCK, SATURATED, NOISY, UNHEARD, STALE = range(len(STATES))
MUTE = (DEAD, STUCK, NOISY, UNHEARD)  # what such a taxel reads is not a pressure
MUTED = np.isin(np.arange(len(STATES)), MUTE)
TOP = 255.0  # counts: a taxel that reads so much could be pressed harder and would not tell


class HealthWatch:
    """Keeps what is known of the taxels of each part.

    Parameters
    ----------
    sizes : mapping of str to int
        Taxels of each part.
    healths : mapping of str to (n,) array-like of str, optional
        What a response calibration found; other taxels are "never touched" until they are.

    Attributes
    ----------
    version : int
        Changes with what is known of any taxel.

    Raises
    ------
    UnknownNameError, SkinMismatchError
        A state that does not exist, or another number of states than taxels.
    """

    def __init__(
        self, sizes: Mapping[str, int], healths: Mapping[str, ArrayLike] | None = None
    ) -> None:
        self._calibrated = {part: np.full(n, NEVER, np.int64) for part, n in sizes.items()}
        for part, names in (healths or {}).items():
            self._calibrated[part] = _numbers(names, sizes[part], part)
        self._states = {part: states.copy() for part, states in self._calibrated.items()}
        self._rested = {part: np.zeros(n, bool) for part, n in sizes.items()}
        self._felt = {part: np.zeros(n, bool) for part, n in sizes.items()}
        self._told: dict[str, NDArray[np.str_] | None] = {}
        self.version = 0

    def observe(self, moment: Moment) -> None:
        """Take what a moment tells of its taxels; one that was at rest and then felt is well."""
        for part, pressures in moment.pressures.items():
            states = self._states.get(part)
            if states is None or np.shape(pressures) != states.shape:
                continue
            told = moment.states.get(part)
            high = np.asarray(pressures) > ACTIVE
            found = high & self._rested[part]
            for touch in moment.touches:
                if touch.part == part:
                    found[touch.taxels] = True
            self._rested[part] |= ~high
            if told is not self._told.get(part) or (found & ~self._felt[part]).any():
                self._felt[part] |= found
                self._told[part] = told
                self._states[part] = self._judged(part, told)
                self.version += 1

    def _judged(self, part: str, told: NDArray[np.str_] | None) -> IntArray:
        """(n,) states by calibration and stream; what a calibration found stays."""
        states = self._calibrated[part].copy()
        states[(states == NEVER) & self._felt[part]] = OK
        # Before anything of a part was seen at rest, none of its taxels is different.
        if told is not None and not (told == STATES[UNHEARD]).all():
            for state in MUTE:
                states[(told == STATES[state]) & (states <= NEVER)] = state
        return states

    def join(self, other: HealthWatch) -> None:
        """Take taxels whose values mean nothing there as such here too: of a difference."""
        for part in self._states.keys() & other._states.keys():
            theirs = other._states[part]
            for own in (self._calibrated[part], self._states[part]):
                if own.shape == theirs.shape:
                    np.copyto(own, theirs, where=(theirs > NEVER) & (own <= NEVER))
        self.version += 1

    def states(self, part: str, moment: Moment | None) -> IntArray:
        """(n,) state of each taxel at a moment, as numbers of `STATES`."""
        states = self._states[part].copy()
        if moment is None or part not in moment.pressures:
            return states
        pressures = np.asarray(moment.pressures[part], np.float64)
        if pressures.shape != states.shape:
            raise SkinMismatchError(
                f"pressures of shape {pressures.shape} for the {len(states)} taxels of {part!r}"
            )
        well = states <= NEVER
        states[well & (pressures >= TOP)] = SATURATED
        states[well & ~np.isfinite(pressures)] = STALE
        if moment.stale:
            states[well] = STALE
        return states

    def known(self, part: str) -> IntArray:
        """(n,) what is known of each taxel whatever comes now, as numbers of `STATES`."""
        return self._states[part]

    def mute(self, part: str) -> BoolArray:
        """(n,) taxels of which no pressure is known, whatever they read."""
        return np.asarray(MUTED[self._states[part]])

    def unfit(self, part: str) -> BoolArray:
        """(n,) taxels whose values mean nothing, whatever they read: to be marked on any layer."""
        return np.asarray(self._states[part] > NEVER)


def _numbers(names: ArrayLike, n: int, part: str) -> IntArray:
    words = np.asarray(names, dtype=str)
    if words.shape != (n,):
        raise SkinMismatchError(f"health of {words.size} taxels for the {n} of {part!r}")
    unknown = sorted(set(words.tolist()) - set(STATES))
    if unknown:
        raise UnknownNameError("health state", unknown[0], STATES)
    return np.array([STATES.index(word) for word in words.tolist()], np.int64)


LEFT, RIGHT = "left", "right"
ORDER = f"{RIGHT} less {LEFT}"
Touches = tuple[NamedTouch | None, NamedTouch | None]


class Pair:
    """Layers of two scenes that stand side by side, for the layer "difference" of both.

    Parameters
    ----------
    left, right : Layers

    Attributes
    ----------
    parts : tuple of str
        Parts of the same skin.
    """

    def __init__(self, left: Layers, right: Layers) -> None:
        self.left, self.right = left, right
        self.parts = common_parts(left.skins, right.skins)
        left.stand_in(self)
        right.stand_in(self)

    def values(self, part: str) -> FloatArray | None:
        """(n,) pressures now at the right, less those at the left; None without a common skin."""
        if part not in self.parts:
            return None
        return self.right.pressed(part) - self.left.pressed(part)

    def on_one_scale(self, layer: Layer) -> Layer:
        """A layer of either side, with limits that hold those of both."""
        sides = () if layer.categories else (self.left, self.right)
        found = [one.build(layer.name) for one in sides]
        limits = [one.limits for one in found if one.unit == layer.unit] or [layer.limits]
        return replace(layer, limits=(min(a for a, _ in limits), max(b for _, b in limits)))

    def touches(self, now: float) -> tuple[NamedTouch, ...]:
        """Touches of the common parts, for a scene at a time `now` [s].

        They have both names and the way between both places.
        """
        sides = (touches_at(one.moment, now) for one in (self.left, self.right))
        shown = ([touch for touch in side if touch.part in self.parts] for side in sides)
        return tuple(starmap(moved_touch, paired_touches(*shown)))


def common_parts(
    left: Mapping[str, PreparedSkin], right: Mapping[str, PreparedSkin]
) -> tuple[str, ...]:
    """Parts of the same name and the same skin."""
    return tuple(
        part
        for part, skin in left.items()
        if part in right and fingerprint(skin.skin) == fingerprint(right[part].skin)
    )


def touches_at(moment: Moment | None, now: float) -> list[NamedTouch]:
    """Touches of a moment for a scene at a time `now` [s]: they last as long as at their own."""
    touches = () if moment is None else moment.touches
    late = 0.0 if moment is None else now - moment.time
    return [replace(touch, began=touch.began + late) for touch in touches]


def paired_touches(left: Sequence[NamedTouch], right: Sequence[NamedTouch]) -> list[Touches]:
    """Touches of both; of a part those with most taxels in common are mates, then the nearest."""
    ways = sorted(
        (_apart(touch, one), k, m)
        for k, touch in enumerate(left)
        for m, one in enumerate(right)
        if touch.part == one.part
    )
    mates: dict[int, int] = {}
    for _, k, m in ways:  # the best of all ways first, whatever the order of the touches
        if k not in mates and m not in mates.values():
            mates[k] = m
    rows: list[Touches] = [
        (touch, right[mates[k]] if k in mates else None) for k, touch in enumerate(left)
    ]
    return rows + [(None, one) for m, one in enumerate(right) if m not in mates.values()]


def moved_touch(left: NamedTouch | None, right: NamedTouch | None) -> NamedTouch:
    """The touch as the difference shows it: both names, and the way from its place at the left."""
    either = right or left
    assert either is not None
    name, path = either.label, None
    if left is None or right is None:
        name = f"{name}, {RIGHT if left is None else LEFT} only"
    else:
        name = name if name == left.label else f"{left.label}, {RIGHT} {name}"
        path = np.stack([left.centre, right.centre])
    return replace(
        either, label=name, confidence=np.nan, path=path, motion=None, answers=None, load=None
    )


def _apart(touch: NamedTouch, one: NamedTouch) -> tuple[int, float]:
    shared = len(np.intersect1d(one.taxels, touch.taxels))
    return -shared, float(np.linalg.norm(one.centre - touch.centre))
