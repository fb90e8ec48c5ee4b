"""Names for contacts while they last: grouped into touches, each named from its samples so far."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import BrokenPluginError, SkinError, warn
from skinmap.live.contacts.sample_contacts import Track
from skinmap.live.robot_skin import JoinedSkin
from skinmap.recognition.classifier import Prediction, TouchClassifier
from skinmap.recognition.naming import Named, name_touches
from skinmap.touch.contacts.grouping import RULE, GroupingRule
from skinmap.touch.prepared_skin import PreparedSkin

Bytes = NDArray[np.uint8]
RATE = 50.0  # samples a second that touches are named from at most: that classifiers learnt from
MEMORY = 200  # of these (4 s at 50 Hz); what lasts longer forgets its beginning
# A touch that is named by how it goes on is named again when it is longer by this share, and after
# so long at most [s]: all its samples are looked at anew, and one more of many says little.
LONGER, LATEST = 0.1, 0.25
QUIET = 0.1  # a place without an active taxel for so long starts anew [s]
SHARE = 0.4  # of the time that naming may take: samples must not wait for names


class Namer:
    """Keeps the last samples and names the touches in them.

    Parameters
    ----------
    skin : JoinedSkin
    classifier : TouchClassifier
        Trained.
    rate : float
        Samples a second of the stream, 0 where unknown.
    rule : GroupingRule
        When contacts are one grip; its rate is that of the samples kept.
    pace : float
        Namings of a part a second at most.
    live : bool
        Samples will not wait: what is found out once about each skin is found ahead of time.
    """

    def __init__(
        self,
        skin: JoinedSkin,
        classifier: TouchClassifier,
        *,
        rate: float,
        rule: GroupingRule = RULE,
        pace: float = 100.0,
        live: bool = True,
    ) -> None:
        self.skin, self.classifier = skin, classifier
        kept = min(rate, RATE) if rate > 0 else RATE
        self.rule = GroupingRule(rule.span, rule.together, kept)
        self.named = 0  # touches so far
        self.failed = 0  # times that the classifier gave no answer
        for number, one in enumerate(skin.skins.values()):
            classifier.prepare(one)
            if live or number == 0:  # one in any case: a plug-in that fails is named at once
                self._warm_up(one)
        # Half a period early: times jitter.
        self._period, self._pause = 0.99 / kept, 0.75 / pace
        self._history = np.zeros((MEMORY, len(skin)), np.uint8)
        self._lasting: Mapping[int, int] = {}
        self.forget()
        self._rests = -np.inf  # until when naming has had its share, by `perf_counter`

    def _warm_up(self, skin: PreparedSkin) -> None:
        """Name one touch: distances along a skin are found once, ahead of time."""
        sample = np.zeros((1, len(skin)), np.uint8)
        sample[0, skin.mesh.faces[0] if len(skin.mesh.faces) else 0] = 100
        try:
            name_touches(self.classifier, skin, sample, rule=self.rule)
        except SkinError:
            raise
        except Exception as error:  # a plug-in may raise anything
            raise BrokenPluginError(
                f"the classifier {self.classifier.name!r} fails on a touch: {error!r}"
            ) from error

    def _found(
        self, skin: PreparedSkin, samples: Bytes, *, ended: bool, known: IntArray | None
    ) -> Sequence[Named]:
        """Touches with their names; none, with one warning, where the classifier fails on them.

        A robot that is followed for weeks is not left alone for one sample that a plug-in cannot
        name.
        """
        try:
            return name_touches(
                self.classifier, skin, samples, rule=self.rule, ended=ended, known=known
            )
        except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
            if not self.failed:
                warn(
                    f"the classifier {self.classifier.name!r} failed ({error!r}): touches go on "
                    "without new names until it answers again"
                )
            self.failed += 1
            return ()

    @property
    def in_time(self) -> bool:
        """Whether the classifier looks at how touches go on, and not only at where they are."""
        moving = bool(getattr(self.classifier.descriptor, "moving", False))
        return moving or getattr(self.classifier, "answers", None) is not None

    def push(
        self,
        time: float,
        pressures: FloatArray,
        tracks: Sequence[Track],
        lasting: Mapping[int, int] | None = None,
    ) -> None:
        """Keep a sample (N,); of more than the pace the newest one.

        `lasting` are the parts of the touches that are not over: where they have been counts for
        as long, if the classifier looks at how touches go on.
        """
        self._lasting = lasting if lasting and self.in_time else {}
        if not tracks and not self._lasting:
            self._slot = -np.inf
            self._first.fill(-1)
            return
        if not self._slot <= time < self._slot + self._period:
            self._slot = time
            self._count += 1
        newest = (self._count - 1) % MEMORY
        np.rint(pressures, out=self._history[newest], casting="unsafe")
        self._stamps[newest] = time
        touched = np.zeros(len(self._first), bool)
        touched[list(self._lasting.values())] = True
        for track in tracks:
            touched[track.part] = True
            self._felt[track.taxels] = time
            self._touch_of[track.taxels] = track.touch
            if self._first[track.part] < 0:
                self._first[track.part] = self._count - 1
        self._first[~touched] = -1

    def forget(self) -> None:
        """The clock began anew."""
        taxels, parts = len(self.skin), len(self.skin.parts)
        self._felt: FloatArray = np.full(taxels, -np.inf)
        self._first: IntArray = np.full(parts, -1, np.int64)
        self._done: FloatArray = np.full(parts, -np.inf)
        self._stamps: FloatArray = np.full(MEMORY, -np.inf)
        self._touch_of: IntArray = np.full(taxels, -1, np.int64)
        self._count = 0  # samples kept so far; the newest stands at (count - 1) % MEMORY
        self._slot = -np.inf

    def name(
        self, time: float, tracks: Sequence[Track], *, live: bool = True, speed: float = 1.0
    ) -> dict[int, Prediction]:
        """Name the touches on the parts whose turn it is, by their numbers; `Track.touch` changes.

        Parameters
        ----------
        time : float
            Of the newest sample, in the source's clock [s].
        tracks : sequence of Track
        live : bool
            Samples do not wait: naming takes no more than its share of this machine's time, one
            part after the other. Else the source's clock alone says when a part is named.
        speed : float
            How many times quicker than recorded samples come: of quick ones fewer are named, the
            same ones in each run.
        """
        quicker = speed if 1.0 < speed < np.inf else 1.0
        pause = quicker * self._pause
        labels: dict[int, Prediction] = {}
        present = [track for track in tracks if len(track.taxels)]
        parts = sorted({track.part for track in present}, key=lambda one: float(self._done[one]))
        for part in parts:
            own = [track for track in present if track.part == part]
            if time - self._done[part] < max(pause, quicker * self._calm(part, own)):
                continue
            started = clock.perf_counter()
            if live and started < self._rests:
                break
            self._done[part] = time
            labels |= self._name_part(time, part, own)
            ended = clock.perf_counter()
            self._rests = ended + (ended - started) * (1.0 / SHARE - 1.0)
        return labels

    def _calm(self, part: int, tracks: Sequence[Track]) -> float:
        """How long the names on a part stand until they are looked at again [s]."""
        if not self.in_time:
            return 0.0
        age = float(self._done[part]) - max(track.began for track in tracks)
        return min(LONGER * age, LATEST)  # negative where one has begun since

    def rename(self, touch: int, new: int) -> None:
        """What was felt of a touch was felt of another one."""
        self._touch_of[self._touch_of == touch] = new

    def revise(self, touch: int, part: int, began: float, ended: float) -> Prediction | None:
        """Name a touch that is over from all of it; None where too little of it is kept."""
        if not self.in_time:
            return None
        name = self.skin.parts[part]
        columns = self.skin.slices[name]
        rows = np.arange(max(0, self._count - MEMORY), self._count) % MEMORY
        stamps = self._stamps[rows]
        rows = rows[(stamps >= began) & (stamps <= ended)]
        own = self._touch_of[columns] == touch
        if len(rows) < 2 or not own.any():
            return None
        samples = np.where(own, self._history[rows, columns], 0).astype(np.uint8)
        cut = self._stamps[rows[0]] > began + 1.5 * self._period
        known = np.where(own, touch, -1) if cut else None
        found = self._found(self.skin.skins[name], samples, ended=True, known=known)
        if not found:
            return None
        self.named += 1
        return max(found, key=lambda one: int(one.taxels.sum())).prediction

    def _name_part(self, time: float, part: int, tracks: list[Track]) -> dict[int, Prediction]:
        name = self.skin.parts[part]
        columns = self.skin.slices[name]
        first = max(int(self._first[part]), self._count - MEMORY)
        cut = first > self._first[part]
        rows = np.arange(first, self._count) % MEMORY
        samples = self._history[rows, columns]
        over = time - self._felt[columns] >= QUIET
        if self._lasting:
            over &= ~np.isin(self._touch_of[columns], list(self._lasting))
        samples[:, over] = 0
        known = self._touch_of[columns] if cut else None
        found = self._found(self.skin.skins[name], samples, ended=False, known=known)
        return self._hand_out(found, tracks, columns.start)

    def _hand_out(
        self, found: Sequence[Named], tracks: list[Track], start: int
    ) -> dict[int, Prediction]:
        """Say of each contact which touch it is part of, and the label of each touch."""
        groups: dict[int, list[Track]] = {}
        for track in tracks:
            shared = [int(one.taxels[track.taxels - start].sum()) for one in found]
            if max(shared, default=0) > 0:
                groups.setdefault(int(np.argmax(shared)), []).append(track)
        labels: dict[int, Prediction] = {}
        identities = {track.identity for track in tracks}
        for number, members in sorted(
            groups.items(), key=lambda item: min(one.touch for one in item[1])
        ):
            own = {one.identity for one in members}
            # A number of their own is always left: those of other contacts are not given away.
            touch = min((own | {one.touch for one in members}) - labels.keys() - (identities - own))
            for one in members:
                one.touch = touch
            labels[touch] = found[number].prediction
            self.named += 1
        return labels
