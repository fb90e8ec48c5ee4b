"""Forces of touches while they come: load calibrations by part, zeroed where nothing is touched.

Force, moment, area and pressures of a contact out of the pressures of its taxels.

A taxel feels the skin around it through the foam. Weights (one a taxel) are chosen so that a
newton anywhere on the surface mesh adds up to a newton: least squares over the cells of the mesh,
held to the plain areas of the taxels. Gaps between modules and taxels without an answer are bridged
by their neighbours in this way, and on a curved skin each cell has its own normal.

Few taxels feel a fingertip, and weights miss up to half of it where it stands between them. A touch
presses and never pulls, so neighbours that feel little tell where it stands: a load on the cells
that only presses explains the pressures, and weights add up what it leaves.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import spsolve

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import SkinMismatchError
from skinmap.geometry.triangles import unit
from skinmap.io.recordings.recorded_stream import Kind
from skinmap.live.response.pressures import FOLLOWED, by_part
from skinmap.physics.pressing import SpringBed
from skinmap.surface.surface_mesh import SurfaceMesh
from skinmap.touch.contacts.skin_geometry import HARD
from skinmap.touch.load_calibration import NORMAL_90, ROUND, Covering, LoadCalibration
from skinmap.touch.prepared_skin import PreparedSkin

SPREAD = 2.1e-3  # of a pressure through foam, standard deviation [m]: mean of the tuned variants
HELD = 0.3  # how strongly weights are held to plain areas
STEPS = 12  # towards a load that explains the pressures: more of them follow the noise
BROAD = 50  # taxels: so many and more need no such load, and it would take milliseconds
# What lies between taxels: over 90 % of the forces lie within this share of theirs, the pressures
# exact. Of touches by the tuned variants of MuJoCo; `evaluate --protocol force` judges by another.
BETWEEN = 0.22
REACH = 4  # rings beyond the contact that may feel it, to no other contact's far side
LOST = 0.5  # of a force, in what its outermost ring bears: more may lie beyond than is felt
TOO_WIDE = "too light for a force where it ends"
TOO_LIGHT, ABOVE = "too light for a force", "above the calibrated range"
# Taxels above `HARD` and above `FELT` of the peak bound the covered skin. Of touches by the tuned
# variants of MuJoCo on two parts 98 % cover more than `LESS` of the first and 94 % less than `MORE`
# of the second; `evaluate --protocol force` judges by another variant on other parts.
FELT, LESS, MORE = 0.05, 0.75, 1.2
# Fewer taxels above `HARD` do not show how small a touch is: foam spreads a point over so many.
# Not 0, as pressures are forces by areas: a twentieth of a taxel is the tip of a pencil.
CARRY, SMALL = 3, 0.05


class Interval(NamedTuple):
    """A value and the ends of its interval of 90 %."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False, slots=True)
class ContactForce:
    """What presses on one contact, in the frame of its link.

    Attributes
    ----------
    force : Interval
        Sum of the pressure over the skin [N]: all of it, also where a closed part is held around.
    vector, moment : (3,) float
        Force on the skin [N], and its moment about `centre` [N m].
    normal : (3,) float
        Outward direction against the force, unit length.
    centre : (3,) float
        Centre of the contact [m].
    area : Interval
        [m2].
    mean, peak : Interval
        Pressure [Pa].
    refused : str
        Why there is no answer; empty where there is one. All numbers are NaN then.
    """

    force: Interval
    vector: FloatArray
    moment: FloatArray
    normal: FloatArray
    centre: FloatArray
    area: Interval
    mean: Interval
    peak: Interval
    refused: str = ""

    @classmethod
    def none(cls, refused: str) -> ContactForce:
        """Without an answer."""
        lost, nowhere = Interval(*[float("nan")] * 3), np.full(3, np.nan)
        return cls(lost, nowhere, nowhere, nowhere, nowhere, lost, lost, lost, refused)

    def in_words(self) -> str:
        """`12.4 N (10.9 to 14.1)`, or why not."""
        return self.refused or "{:.3g} N ({:.3g} to {:.3g})".format(*self.force)

    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """Force on the skin and its moment about the link's origin (6,) [N, N m], and (6, 6).

        The covariance is that of the size, as wide as the interval; it holds no doubt of the
        direction.
        """
        wrench = np.concatenate([self.vector, self.moment + np.cross(self.centre, self.vector)])
        # The lower end stops at 0 N, the upper one does not.
        away = (self.force.high - self.force.value) / (NORMAL_90 * self.force.value)
        return wrench, away**2 * np.outer(wrench, wrench)

    def plain(self) -> dict[str, Any]:
        """For JSON: numbers in the units of their names, null where there is no answer."""

        def told(name: str, of: Interval, scale: float = 1.0) -> dict[str, Any]:
            return {name: scale * of.value, f"{name}_90": [scale * of.low, scale * of.high]}

        found = {
            **told("force_n", self.force),
            "vector_n": self.vector.tolist(),
            "moment_nm": self.moment.tolist(),
            "normal": self.normal.tolist(),
            "centre_m": self.centre.tolist(),
            **told("area_mm2", self.area, 1e6),
            **told("mean_kpa", self.mean, 1e-3),
            **told("peak_kpa", self.peak, 1e-3),
        }
        known = dict.fromkeys(found) if self.refused else found
        return {**known, "refused": self.refused}


def covered(pressed: FloatArray, areas: FloatArray) -> float:
    """Area [m2] of a contact by pressures (k,) of taxels with areas (k,) [m2]."""
    return ROUND * float((pressed @ areas) ** 2 / (pressed**2 @ areas))


class PartForces:
    """Adds up pressures on one part with n taxels.

    Parameters
    ----------
    skin : PreparedSkin
    answered : (n,) bool, optional
        Taxels whose pressure is known; all by default. Neighbours stand for the others.
    covering : Covering, optional
        Areas as prints teach them.
    areas : FloatArray
        Plain areas of the taxels [m2].
    weights : (n,) float
        Force for a pressure [m2], where nothing is known of where the touch stands.
    vectors, moments : (n, 3) float
        Force on the skin [m2], and its moment about the origin of the link [m3], for a pressure.
    """

    def __init__(
        self,
        skin: PreparedSkin,
        answered: BoolArray | None = None,
        covering: Covering | None = None,
    ) -> None:
        n = len(skin)
        self.covering = covering
        self.answered = np.ones(n, bool) if answered is None else np.asarray(answered, bool)
        if self.answered.shape != (n,):
            raise SkinMismatchError(f"{len(self.answered)} taxels are calibrated, the part has {n}")
        self.skin, self.areas = skin, skin.geometry.areas
        feels, self._cells = csr_array((n, 0)), np.zeros((1, 7))
        own, found = np.flatnonzero(self.answered), np.zeros((n, 7))
        normals, places = skin.skin.normals[own], skin.skin.positions[own]
        plain = self.areas[own, None] * np.column_stack(
            [np.ones(len(own)), -normals, -np.cross(places, normals)]
        )
        found[own] = plain
        if len(skin.mesh.faces):  # taxels in a row have no surface between them
            bed = SpringBed(skin.skin, skin.mesh)
            wide = SPREAD if covering is None else max(SPREAD, covering.spread)
            feels, moments = csr_array(bed.spread(wide)), np.cross(bed.places, bed.normals)
            wanted = np.column_stack([np.ones(len(bed.places)), -bed.normals, -moments])
            self._cells = np.vstack([wanted, self._cells])
            square = feels[own] @ feels[own].T
            # A taxel that feels no cell keeps its plain area.
            held = diags_array(HELD * np.maximum(square.diagonal(), 1e-6))
            found[own] = spsolve((square + held).tocsc(), feels[own] @ wanted + held @ plain)
        # The cells that each taxel feels, in rows of one length: the last cell stands for none.
        felt = np.arange(np.diff(feels.indptr).max())[None] < np.diff(feels.indptr)[:, None]
        self._near, self._feel = np.full(felt.shape, feels.shape[1]), np.zeros(felt.shape)
        self._near[felt], self._feel[felt] = feels.indices, feels.data
        self._reach = np.append(feels[own].sum(axis=0), 0.0) + 1e-9
        self._found = found
        self.weights, self.vectors, self.moments = found[:, 0], found[:, 1:4], found[:, 4:]

    def contact(
        self,
        taxels: IntArray,
        values: FloatArray,
        low: FloatArray,
        high: FloatArray,
        *,
        shared: float | FloatArray = 1.0,
    ) -> ContactForce:
        """Force of the contact that covers some taxels (k,).

        Parameters
        ----------
        values, low, high : (n,) float
            Pressures of the part and ends of their intervals of 90 % [Pa]; NaN above the range of
            the calibration and where a taxel is not answered.
        shared : float or (n,) float
            Share of the variance that all taxels have in common: it does not average out.
        """
        rows, outermost = self._felt(taxels, values, low)
        if not self.answered[taxels].any():
            return ContactForce.none("none of its taxels is calibrated")
        pressure = values[rows]
        if not np.isfinite(pressure).all():
            return ContactForce.none(ABOVE)
        weight = np.maximum(self.weights[rows], 0.0)
        total, *sums = self._sums(rows, pressure).tolist()
        if total <= 0.0 or pressure.max() <= 0.0:
            return ContactForce.none(TOO_LIGHT)
        pressed = np.maximum(pressure, 0.0)
        share = float(pressed[outermost] @ weight[outermost]) / total
        if share > LOST:
            return ContactForce.none(TOO_WIDE)
        beyond = share**2 * total  # what lies further out falls off as the ring does
        half = np.stack([pressure - low[rows], high[rows] - pressure])
        common = np.sqrt(shared[rows] if isinstance(shared, np.ndarray) else shared)
        alone = np.sqrt(1.0 - common**2)
        away = np.hypot((half * common) @ weight, np.linalg.norm(half * alone * weight, axis=1))
        below, above = np.hypot(away, BETWEEN * total).tolist()
        force = Interval(total, max(0.0, total - below), total + above + beyond)
        places = self.skin.skin.positions[rows]
        centre = pressed * weight @ places / (pressed @ weight)
        vector, (x, y, z), (u, v, w) = np.array(sums[:3]), centre.tolist(), sums[:3]
        # np.cross takes ten times as long
        moment = np.array(sums[3:]) - [y * w - z * v, z * u - x * w, x * v - y * u]
        area = self._area(rows, pressed)
        top = int(pressure.argmax())
        return ContactForce(
            force,
            vector,
            moment,
            -unit(vector),
            centre,
            area,
            Interval(total / area.value, force.low / area.high, force.high / area.low),
            # What stands between taxels may be pressed harder than any of them.
            Interval(
                float(pressure[top]),
                float(low[rows[top]]),
                float(high[rows[top]]) + BETWEEN * float(pressure[top]),
            ),
        )

    def _sums(self, rows: IntArray, pressure: FloatArray) -> FloatArray:
        """(7,) force, vector, and moment about the origin, by pressures of taxels (k,).

        Weights alone where many taxels feel the touch. Else the load begins evenly; each step is
        one of Richardson and Lucy. A cell that others feel, too, counts as far as it is felt by
        these.
        """
        if len(rows) > BROAD:
            return np.asarray(pressure @ self._found[rows])
        near, pressed = self._near[rows], np.maximum(pressure, 0.0)
        used = np.zeros(len(self._cells), bool)  # np.unique takes four times as long
        used[near] = True
        cells, at = np.flatnonzero(used), np.cumsum(used) - 1
        feel = np.zeros((len(rows), len(cells)))
        feel[np.arange(len(rows))[:, None], at[near]] = self._feel[rows]
        whole = feel.sum(axis=0) + 1e-9
        load = np.full(len(cells), pressed.sum() / max(whole.sum(), 1e-9))
        for _ in range(STEPS):
            load *= (pressed / np.maximum(feel @ load, 1e-9)) @ feel / whole
        left = pressure - feel @ load
        load *= whole / self._reach[cells]
        return np.asarray(load @ self._cells[cells] + left @ self._found[rows])

    def _felt(
        self, taxels: IntArray, values: FloatArray, low: FloatArray
    ) -> tuple[IntArray, BoolArray]:
        """Answered taxels (k,) that feel a contact, and which of them are its outermost ring (k,).

        From the contact downhill as far as pressures exceed their doubt, and a ring.
        """
        beside = self.skin.geometry.beside
        height, core = np.append(values, -np.inf), np.zeros(len(values) + 1, bool)
        core[taxels] = True
        near = np.flatnonzero((low > 0.0) & self.answered & ~core[:-1])
        around = beside[near]
        for _ in range(REACH):
            higher = np.where(core[around], height[around], -np.inf).max(axis=1, initial=-np.inf)
            core[near[height[near] <= higher]] = True
        found = np.zeros(len(core), bool)
        found[beside[core[:-1]]] = True
        found[:-1] &= np.isfinite(values)  # further out, one without an answer is not of the touch
        found[beside[taxels]] = True
        rows = np.flatnonzero((found | core)[:-1] & self.answered)
        return rows, ~core[rows]

    def _area(self, rows: IntArray, pressed: FloatArray) -> Interval:
        """Between what is pressed half as hard as the peak and all that feels it."""
        areas = self.areas[rows]
        guess = covered(pressed, areas)
        if self.covering is not None:
            area, away = float(self.covering.area(guess)), NORMAL_90 * self.covering.doubt
            return Interval(area, area * np.exp(-away), area * np.exp(away))
        peak = pressed.max()
        hard = areas[pressed >= HARD * peak]
        low = (LESS if len(hard) >= CARRY else SMALL) * float(hard.sum())
        high = MORE * float(areas[pressed >= FELT * peak].sum())
        return Interval(float(np.clip(guess, low, high)), low, high)


PASCALS = 1e5  # a bar
REST_SECONDS = 0.8  # untouched, so long, before a zero is taken
REST_FAR = 0.12  # of the calibrated range: no rest lies further from that of the calibration
LYING = 0.06  # of the range: a taxel so far beside the others' rest is pressed
DRIFT = 7.5e-5  # of the range a second that rest drifts by: .015 of 200 counts, some `FOLLOWED`
STEADY = 60.0  # after so long it grows as its root: warmth comes to an end [s]
# The heaviest moment of a touch: the median of those so far from its heaviest sample [s], and no
# lighter than so much of it, lest a quick poke loses its peak.
AROUND, NEAR = 0.1, 0.9
PRESSURES = "calibrated for raw counts, not for pressures"
ZERO_LASTS = 8 * 3600.0  # older zeros are refused [s]: another day


class PartLoads:
    """Forces on one part out of what its n taxels send.

    Parameters
    ----------
    skin : PreparedSkin
    calibration : LoadCalibration
    rate : float
        Samples a second, 0 where unknown.
    kind : {"raw", "pressure"}
        Of the samples.

    Raises
    ------
    SkinMismatchError
        Another number of taxels was calibrated.
    """

    def __init__(
        self, skin: PreparedSkin, calibration: LoadCalibration, rate: float, kind: Kind = "raw"
    ) -> None:
        self.forces = PartForces(skin, calibration.answered, calibration.covering)
        self._calibration = calibration
        self._rate = rate or calibration.rate
        self._needed = max(2, round(REST_SECONDS * self._rate))
        self._stream = calibration.stream(rate or None)
        self._doubt = self._stream.session.shared
        self._home = np.zeros(len(skin))  # rest at the zero, less the shift taken there
        self._drift = DRIFT * float(np.median(calibration.span))
        self._since, self._left = 0, 0.0  # samples after rest was seen, counts it was not followed
        self._pressures = kind == "pressure"
        # Why rest is none of this calibration; pressures are taken to rest at 0 until it is heard.
        self._far = far_rest(calibration, self._home, pressures=True) if self._pressures else ""
        self._found = np.full((3, len(skin)), np.nan)
        self._forget()
        self._when = calibration.zeroed

    @property
    def age(self) -> float:
        """Age of the zero [s]."""
        return time.time() - self._when

    def zero(self) -> None:
        """Take the zero anew as soon as nothing touches."""
        self._stream.session = replace(self._stream.session, zeroed=False)
        self._forget()

    def take(self, samples: NDArray[Any], touched: bool) -> None:
        """Take samples (t, n) [counts]; `touched` where something is on the part."""
        counts = self._calibration.cooled(np.asarray(samples, np.float64))
        self._since += len(counts)
        if touched:
            self._forget()
        else:
            self._listen(counts)
        since = self._since / self._rate
        drift = self._left + self._drift * min(since, np.sqrt(STEADY * since))
        shared = float(np.hypot(self._doubt, drift * self._calibration.count_bar))
        self._stream.session = replace(self._stream.session, shared=shared)
        self._found = PASCALS * self._stream.rows(counts)[:, -1]

    def _forget(self) -> None:
        self._heard, self._sum = 0, np.zeros(len(self._found[0]))
        self._rest: list[FloatArray] = []

    def _listen(self, counts: FloatArray) -> None:
        """Take the zero by the first calm stretch of rest, and follow it by those after it."""
        zeroed = self._stream.session.zeroed
        self._heard, self._sum = self._heard + len(counts), self._sum + counts.sum(axis=0)
        self._rest += [] if zeroed else [counts]
        if self._heard < self._needed:
            return
        rest = self._sum / self._heard
        self._far = far_rest(self._calibration, rest, pressures=self._pressures)
        if not self._far:
            if not zeroed:
                self._stream.zero(np.concatenate(self._rest))
                self._doubt = self._stream.session.shared
                self._home = rest - self._stream.session.shift
            session, own = self._stream.session, self.forces.answered
            away, most = rest - self._home - session.shift, FOLLOWED * self._heard / self._rate
            common = float(np.median(away[own])) if own.any() else 0.0
            # A thing that lies still on some taxels is not their rest: they follow the others.
            lone = np.abs(away - common) > LYING * self._calibration.span
            step = np.clip(np.where(lone, common, away), -most, most)
            self._stream.session = replace(session, shift=session.shift + step)
            self._left = abs(common - float(np.clip(common, -most, most)))
            self._since, self._when = 0, time.time()
        self._forget()

    def force(self, taxels: IntArray) -> ContactForce:
        """Of the touch on some taxels (k,), by the newest sample."""
        if self._far:
            return ContactForce.none(self._far)
        if not self._stream.session.zeroed and self.age > ZERO_LASTS:
            return ContactForce.none(
                f"its zero is {self.age / 3600.0:.0f} h old, and no rest came before the touch"
            )
        return force_of(self.forces, taxels, self._found, self._stream.session.shared)


def far_rest(calibration: LoadCalibration, counts: FloatArray, *, pressures: bool = False) -> str:
    """Why cooled counts (n,), maybe `pressures`, cannot be a calibration's rest; else empty."""
    own = calibration.answered
    if not own.any():
        return ""
    off, height = (
        abs(float(np.median(((counts - level) / calibration.span)[own])))
        for level in (calibration.rest, 0.0)
    )
    if off <= REST_FAR:
        return ""
    if pressures and height <= REST_FAR:  # pressures rest at 0
        return PRESSURES
    return f"rest lies {100 * off:.0f} % of the range off: fit the calibration anew"


def force_of(
    forces: PartForces, taxels: IntArray, found: FloatArray, shared_bar: float
) -> ContactForce:
    """Force of a contact by values, low and high (3, n) [Pa] that have a doubt [bar] in common."""
    half = np.fmax(found[2] - found[0], 1e-9)  # unknown: all of it shared
    share = np.minimum((NORMAL_90 * shared_bar * PASCALS / half) ** 2, 1.0)
    return forces.contact(taxels, *found, shared=share)


def steady(totals: FloatArray) -> int:
    """Which of the totals (k,) about a heaviest one stands for it: noise made the largest."""
    near = np.flatnonzero(totals >= NEAR * totals.max())
    return int(near[np.argsort(totals[near])[len(near) // 2]])


def heaviest_load(
    forces: PartForces,
    calibration: LoadCalibration,
    found: tuple[FloatArray, FloatArray, FloatArray],
    rows: IntArray,
    taxels: BoolArray,
    rate: float = 0.0,
) -> ContactForce:
    """Force of a recorded touch at its heaviest moment.

    Refused where any sample lies above the range: no other one stands for the heaviest.

    Parameters
    ----------
    found : three (t, n) arrays
        Values, low and high of the whole recording [bar].
    rows : (k,) int
        Samples of the touch.
    taxels : (n,) bool
        Of the touch.
    rate : float
        Samples a second; without it the heaviest sample itself is taken.
    """
    own = found[0][rows][:, taxels & forces.answered]
    if np.isnan(own).any():
        return ContactForce.none(ABOVE)
    total = own.sum(axis=1)
    top, around = int(total.argmax()), round(AROUND * rate)
    first = max(0, top - around)
    row = rows[first + steady(total[first : top + around + 1])]
    moment = PASCALS * np.stack([one[row] for one in found]).astype(np.float64)
    return force_of(forces, np.flatnonzero(taxels), moment, calibration.doubt)


def contact_loads(
    mesh: SurfaceMesh, calibration: LoadCalibration, counts: FloatArray
) -> Callable[[IntArray], ContactForce]:
    """What finds the force of a contact on some taxels (k,) in one sample (n,) of raw counts."""
    stream = calibration.stream()
    found = PASCALS * np.stack(stream.update(calibration.checked(counts[None])[0]))
    forces, shared = _part_forces(mesh, calibration), stream.session.shared
    return lambda taxels: force_of(forces, taxels, found, shared)


@lru_cache(maxsize=16)  # samples of the same skin follow each other
def _part_forces(mesh: SurfaceMesh, calibration: LoadCalibration) -> PartForces:
    return PartForces(PreparedSkin.of(mesh), calibration.answered, calibration.covering)


def load_calibrations(
    specs: Sequence[str], skins: Mapping[str, PreparedSkin]
) -> dict[str, LoadCalibration]:
    """Load calibrations by part.

    Parameters
    ----------
    specs : sequence of str
        What `skinmap calibrate load` wrote, for the part whose layout was calibrated, or
        "PART=FOLDER". One without a part belongs to the only part there is.
    skins : mapping of str to PreparedSkin
        By part.

    Raises
    ------
    UnknownNameError
        No such part.
    MissingFileError, DataFormatError, SkinMismatchError
        No such file, no calibration, or one of another skin.
    InvalidArrayError
        One that does not name its part.
    """
    found = {}
    for part, name, one in by_part(specs, skins, LoadCalibration.read, "FOLDER"):
        if len(one.rest) != len(skins[part]):
            raise SkinMismatchError(
                f"{name}: {len(one.rest)} taxels are calibrated, {part} has {len(skins[part])}"
            )
        found[part] = one
    return found
