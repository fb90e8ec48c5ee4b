"""Names for contacts while they last: grouped into touches, each named from its samples so far."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.classify.classifier import Prediction, TouchClassifier
from skinmap.classify.naming import Named, name_touches
from skinmap.live.contacts.followed_contact import Track
from skinmap.live.robot_skin import JoinedSkin
from skinmap.touch.grouping import RULE, GroupingRule
from skinmap.touch.prepared_skin import PreparedSkin

RATE = 50.0  # samples a second that touches are named from at most: that classifiers learnt from
MEMORY = 200  # of these (4 s at 50 Hz); what lasts longer forgets its beginning
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
    """

    def __init__(
        self,
        skin: JoinedSkin,
        classifier: TouchClassifier,
        *,
        rate: float,
        rule: GroupingRule = RULE,
        pace: float = 100.0,
    ) -> None:
        self.skin, self.classifier = skin, classifier
        kept = min(rate, RATE) if rate > 0 else RATE
        self.rule = GroupingRule(rule.span, rule.together, kept)
        self.labels: dict[int, Prediction] = {}
        self.named = 0  # touches so far
        for one in skin.skins.values():
            classifier.prepare(one)
            self._warm_up(one)
        # Half a period early: times jitter.
        self._period, self._pause = 0.99 / kept, 0.75 / pace
        self._history = np.zeros((MEMORY, len(skin)), np.uint8)
        self._felt: FloatArray = np.full(len(skin), -np.inf)
        self._first: IntArray = np.full(len(skin.parts), -1, np.int64)
        self._done: FloatArray = np.full(len(skin.parts), -np.inf)
        self._count = 0  # samples kept so far; the newest stands at (count - 1) % MEMORY
        self._slot = -np.inf
        self._rests = -np.inf  # until when naming has had its share, by `perf_counter`

    def _warm_up(self, skin: PreparedSkin) -> None:
        """Name one touch: distances along a skin are found once, ahead of time."""
        sample = np.zeros((1, len(skin)), np.uint8)
        sample[0, skin.mesh.faces[0]] = 100
        name_touches(self.classifier, skin, sample, rule=self.rule)

    def push(self, time: float, pressures: FloatArray, tracks: Sequence[Track]) -> None:
        """Keep a sample (N,); of more than the pace the newest one."""
        if not tracks:
            self._slot = -np.inf
            self._first.fill(-1)
            return
        if not self._slot <= time < self._slot + self._period:
            self._slot = time
            self._count += 1
        np.rint(pressures, out=self._history[(self._count - 1) % MEMORY], casting="unsafe")
        touched = np.zeros(len(self._first), bool)
        for track in tracks:
            touched[track.part] = True
            self._felt[track.taxels] = time
            if self._first[track.part] < 0:
                self._first[track.part] = self._count - 1
        self._first[~touched] = -1

    def forget(self) -> None:
        """The clock began anew."""
        self._felt.fill(-np.inf)
        self._first.fill(-1)
        self._done.fill(-np.inf)
        self._slot = -np.inf
        self.labels.clear()

    def name(
        self, time: float, tracks: Sequence[Track], *, live: bool = True, speed: float = 1.0
    ) -> None:
        """Name the touches on the parts whose turn it is; `labels` and `Track.touch` change.

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
        pause = self._pause * (speed if 1.0 < speed < np.inf else 1.0)
        present = [track for track in tracks if len(track.taxels)]
        parts = sorted({track.part for track in present}, key=lambda one: float(self._done[one]))
        for part in parts:
            if time - self._done[part] < pause:
                continue
            started = clock.perf_counter()
            if live and started < self._rests:
                break
            self._done[part] = time
            self._name_part(time, part, [track for track in present if track.part == part])
            ended = clock.perf_counter()
            self._rests = ended + (ended - started) * (1.0 / SHARE - 1.0)

    def drop(self, touch: int) -> None:
        """Forget the label of a touch that is over."""
        self.labels.pop(touch, None)

    def _name_part(self, time: float, part: int, tracks: list[Track]) -> None:
        name = self.skin.parts[part]
        columns = self.skin.slices[name]
        first = max(int(self._first[part]), self._count - MEMORY)
        rows = np.arange(first, self._count) % MEMORY
        samples = self._history[rows, columns]
        over = time - self._felt[columns] >= QUIET
        samples[:, over] = 0
        found = name_touches(
            self.classifier, self.skin.skins[name], samples, rule=self.rule, ended=False
        )
        self._hand_out(found, tracks, columns.start)

    def _hand_out(self, found: Sequence[Named], tracks: list[Track], start: int) -> None:
        """Say of each contact which touch it is part of, and the label of each touch."""
        if not found:
            return
        groups: dict[int, list[Track]] = {}
        for track in tracks:
            shared = [int(one.taxels[track.taxels - start].sum()) for one in found]
            if max(shared) > 0:
                groups.setdefault(int(np.argmax(shared)), []).append(track)
        taken: set[int] = set()
        for number, members in sorted(
            groups.items(), key=lambda item: min(one.touch for one in item[1])
        ):
            known = {one.touch for one in members} | {one.identity for one in members}
            touch = min(known - taken)
            taken.add(touch)
            for one in members:
                one.touch = touch
            self.labels[touch] = found[number].prediction
            self.named += 1
