"""Touches, not frames: contacts are grouped into touches, so that two at once get two names.

The rule: contacts that begin together (and, once both are over, end together) and lie within a
hand's span of each other are one grip, and so are those that last at the same time less than a
finger's breadth apart: a ridge broken by taxels of little gain. All others are separate touches.
Each contact's course is scaled to its own largest load, so a light finger begins when a firm one
does. Of contacts older than the samples that are looked at nobody knows when they began: they stay
together, or apart, as they were. A contact so faint that its times say nothing joins the nearest
one that is not, and is no touch where it was there before or after all of those.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.touch.contacts.rest import LOW, felt
from skinmap.touch.contacts.skin_geometry import (
    ACTIVE,
    SkinGeometry,
    check_pressures,
    connected,
    pieces,
)
from skinmap.touch.recording import RESERVED

if TYPE_CHECKING:
    from skinmap.touch.recording import Recording

BRIEF = 3  # a taxel that is active for fewer samples than this has felt noise or a graze
HALF = 0.5  # a contact begins and ends where it crosses this share of its largest load
FAINT = 2.0  # a contact below so many times the level of its taxels flickers there: no times
SAMPLES = 1.5  # begin and end are known to a sample each, however slow the stream
BROKEN = 20e-3  # a finger's ridge is broken by taxels of little gain into nearer pieces [m]
MAX_CONTACTS = 64  # contacts beyond this many, weakest first, join the touch nearest to them


@dataclass(frozen=True, slots=True)
class GroupingRule:
    """When contacts are one grip.

    Attributes
    ----------
    span : float
        The width of a spread hand: contacts of one grip lie at most so far apart along the skin,
        from one to the next [m]. Adults span 0.16 to 0.23 m between thumb and little finger.
    together : float
        Fingers of one hand begin, and end, within this time of each other [s].
    rate : float
        Samples a second.
    """

    span: float = 0.2
    together: float = 0.08
    rate: float = 50.0

    def __post_init__(self) -> None:
        for name in ("span", "together", "rate"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InvalidArrayError(f"{name} must be finite and above 0, got {value}")


RULE = GroupingRule()


@dataclass(frozen=True, eq=False, slots=True)
class Contact:
    """One contact of an event: its taxels, when it began and ended, load and strongest taxel."""

    taxels: IntArray
    begin: float
    end: float
    load: float
    peak: float


def group_touches(
    geometry: SkinGeometry,
    samples: NDArray[np.uint8],
    *,
    rule: GroupingRule = RULE,
    ended: bool = True,
    levels: FloatArray | None = None,
    known: IntArray | None = None,
) -> tuple[BoolArray, ...]:
    """The taxels (n,) of each touch among the samples (k, n) of one event, the heaviest first.

    Parameters
    ----------
    geometry : SkinGeometry
    samples : (k, n) array of 0 to 255
    rule : GroupingRule
    ended : bool
        Whether the event is over; while it goes on, contacts that still last have no end to
        compare.
    levels : (n,) float, optional
        What a taxel must exceed to be touched [counts]; `ACTIVE` everywhere by default.
    known : (n,) int, optional
        Touch of each taxel before the samples, which are the last ones of an event; -1 for none.

    Returns
    -------
    tuple of (n,) bool
        Empty where nothing is touched. Taxels of no touch were hardly active.

    Raises
    ------
    SkinMismatchError, InvalidArrayError
        Samples of another skin, NaN or infinity.
    """
    samples = check_pressures(samples, geometry)
    found = contacts_of_event(geometry, samples)
    if not found:
        return ()
    last = np.inf if ended else len(samples) - 1.5
    least = np.full(len(geometry), float(ACTIVE)) if levels is None else levels
    found = _without_background(found, rule, last, least)
    group = _grips(geometry, found, rule, last, least, known)
    load = np.bincount(group, [contact.load for contact in found])
    masks = np.zeros((len(load), len(geometry)), bool)
    for contact, own in zip(found, group, strict=True):
        masks[own, contact.taxels] = True
    return tuple(masks[np.argsort(-load, kind="stable")])


def contacts_of_event(geometry: SkinGeometry, samples: NDArray[np.uint8]) -> tuple[Contact, ...]:
    """Connected taxels that were active during the samples (k, n), with begin and end [samples]."""
    felt = samples > ACTIVE
    often = felt.sum(axis=0) >= max(1, min(BRIEF, len(samples)))
    often &= _accompanied(geometry, samples, often)
    index = np.flatnonzero(often)
    if len(index) == 0:
        return ()
    piece = connected(geometry.links, often, index)
    members = np.eye(int(piece.max()) + 1, dtype=np.float32)[piece]
    pressures = np.where(felt[:, index], samples[:, index], 0).astype(np.float32)
    loads = (pressures @ members).astype(np.float64)
    peak = loads.max(axis=0)
    high = loads >= HALF * peak
    begin = _crossing(loads, high.argmax(axis=0), HALF * peak, -1)
    final = len(loads) - 1 - high[::-1].argmax(axis=0)
    end = _crossing(loads, final, HALF * peak, 1)
    kept = np.argsort(-peak, kind="stable")[:MAX_CONTACTS]
    return tuple(
        Contact(
            index[piece == k],
            float(begin[k]),
            float(end[k]),
            float(peak[k]),
            float(pressures[:, piece == k].max()),
        )
        for k in kept
    )


def _accompanied(geometry: SkinGeometry, samples: NDArray[np.uint8], often: BoolArray) -> BoolArray:
    """(n,) taxels of some, beside which another one reads at least half of a touch as often."""
    found = ~often
    columns = np.flatnonzero(often)
    beside = geometry.beside[columns]
    padded = np.zeros((len(samples), len(often) + 1), bool)
    padded[:, :-1] = samples > LOW
    both = padded[:, beside] & (samples[:, columns] > ACTIVE)[:, :, None]
    enough = both.sum(axis=0) >= max(1, min(BRIEF, len(samples)))
    found[columns] = enough.any(axis=1) | (beside == len(often)).all(axis=1)
    return found


def _crossing(loads: FloatArray, at: IntArray, level: FloatArray, way: int) -> FloatArray:
    """When each load (k, c) crosses its level next to sample `at`, between samples if it can."""
    column = np.arange(loads.shape[1])
    beside = np.clip(at + way, 0, len(loads) - 1)
    inner, outer = loads[at, column], loads[beside, column]
    drop = np.where(inner > outer, inner - outer, 1.0)
    share = np.where(inner > outer, np.clip((inner - level) / drop, 0.0, 1.0), 0.0)
    return np.asarray(at + way * share)


def _grips(
    geometry: SkinGeometry,
    contacts: tuple[Contact, ...],
    rule: GroupingRule,
    last: float,
    levels: FloatArray,
    known: IntArray | None,
) -> IntArray:
    """(c,) touch of each contact: joined where the rule says so, from one to the next."""
    if len(contacts) == 1:
        return np.zeros(1, np.int64)
    begin = np.array([contact.begin for contact in contacts])
    end = np.array([contact.end for contact in contacts])
    slack = max(rule.together * rule.rate, SAMPLES)
    lasting = end >= last
    one_ended = lasting[:, None] | lasting[None, :]
    joined = np.abs(begin[:, None] - begin[None, :]) <= slack
    joined &= (np.abs(end[:, None] - end[None, :]) <= slack) | one_ended
    if known is not None:
        older = begin <= 0.0
        touch = np.array([np.bincount(known[one.taxels] + 1).argmax() - 1 for one in contacts])
        same = (touch[:, None] == touch) & (touch >= 0)
        joined = np.where(older[:, None] | older, same, joined)
    faint = _faint(contacts, levels)
    if faint.any() and not faint.all():
        joined[faint] = joined[:, faint] = False
        clear = np.flatnonzero(~faint).tolist()
        for k in np.flatnonzero(faint).tolist():
            gaps = [_gap(geometry, contacts[k], contacts[j]) for j in clear]
            nearest = clear[int(np.argmin(gaps))]
            joined[k, nearest] = joined[nearest, k] = True
    joined |= _broken(geometry, contacts, begin, end, joined)
    one, other = np.nonzero(joined)
    near = [
        a == b or _gap(geometry, contacts[a], contacts[b]) <= rule.span
        for a, b in zip(one.tolist(), other.tolist(), strict=True)
    ]
    return pieces(one[near], other[near], len(contacts))


def _faint(contacts: tuple[Contact, ...], levels: FloatArray) -> BoolArray:
    """(c,) contacts that hardly exceed what their taxels must exceed to be touched."""
    return np.array([one.peak <= FAINT * levels[one.taxels].max() for one in contacts])


def _without_background(
    contacts: tuple[Contact, ...], rule: GroupingRule, last: float, levels: FloatArray
) -> tuple[Contact, ...]:
    """The contacts without those faint ones that were there before or after all clear ones."""
    faint = _faint(contacts, levels)
    if not faint.any() or faint.all():
        return contacts
    slack = 2.0 * max(rule.together * rule.rate, SAMPLES)
    clear = [one for one, weak in zip(contacts, faint, strict=True) if not weak]
    first = min(one.begin for one in clear) - slack
    final = max(one.end for one in clear) + slack
    return tuple(
        one
        for one, weak in zip(contacts, faint, strict=True)
        if not weak or (one.begin >= first and (one.end <= final or one.end >= last))
    )


def _broken(
    geometry: SkinGeometry,
    contacts: tuple[Contact, ...],
    begin: FloatArray,
    end: FloatArray,
    joined: BoolArray,
) -> BoolArray:
    """(c, c) which contacts overlap in time and lie so near that they are one, broken by gains."""
    at_once = np.minimum(end[:, None], end) >= np.maximum(begin[:, None], begin)
    found = np.zeros_like(joined)
    for a, b in np.argwhere(np.triu(at_once & ~joined, 1)).tolist():
        found[a, b] = found[b, a] = _gap(geometry, contacts[a], contacts[b]) < BROKEN
    return found


def _gap(geometry: SkinGeometry, one: Contact, other: Contact) -> float:
    """Shortest path along the skin between two contacts [m]."""
    return float(geometry.distances(one.taxels, other.taxels).min())


def without_stuck(recording: Recording, geometry: SkinGeometry) -> tuple[Recording, IntArray]:
    """A recording without the marks under which nothing but stuck taxels was pressed.

    Parameters
    ----------
    recording : Recording
    geometry : SkinGeometry
        Of its part.

    Returns
    -------
    Recording
    (k,) int
        Which events were left out.
    """
    rest = recording.rest()
    if not rest.stuck.any():
        return recording, np.zeros(0, np.int64)
    gone = np.zeros(len(recording.labels), bool)
    for event, label, samples in recording.touches():
        hangs = bool((samples[:, rest.stuck] > ACTIVE).any()) and label not in RESERVED
        own = felt(samples, rest, geometry.beside)
        gone[event] = hangs and not contacts_of_event(geometry, own)
    kept = np.flatnonzero(~gone)
    number = np.append(np.cumsum(~gone) - 1, -1)  # the last for no event
    number[:-1][gone] = -1
    words: dict[str, Any] = {
        name: tuple(getattr(recording, name)[k] for k in kept)
        for name in ("labels", "sessions", "people", "motions")
        if getattr(recording, name)
    }
    owners = None if recording.owners is None else recording.owners[kept]
    subjects, events = recording.subjects[kept], number[recording.events]
    cleaned = replace(recording, events=events, subjects=subjects, owners=owners, **words)
    return cleaned, np.flatnonzero(gone)
