"""Forces of touches while they come: load calibrations by part, zeroed where nothing is touched."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import SkinMismatchError
from skinmap.io.recordings.recorded_stream import Kind
from skinmap.live.contacts.contact_forces import ABOVE, ContactForce, PartForces
from skinmap.live.response.pressures import by_part
from skinmap.live.response.rest_gate import FOLLOWED
from skinmap.surface.surface_mesh import SurfaceMesh
from skinmap.touch.load_calibration import NORMAL_90, LoadCalibration
from skinmap.touch.prepared_skin import PreparedSkin

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
