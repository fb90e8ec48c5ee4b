"""Which pictures may be shown as live: none whose sample is older than a tenth of a second.

A picture that took too long is held back: the newest sample is drawn instead, at once. Where that
comes too late again, drawing cannot keep up here: pictures are shown then, but say so.
"""

from __future__ import annotations

OLDEST = 0.1  # age of a sample up to which its picture counts as live [s]
MISSED = 2.5  # samples that may fail to come before an unchanged picture counts as late
PATIENCE = 2  # pictures held back one after the other before one is shown with a mark


class Punctual:
    """Judges pictures that are drawn and not shown yet, one after the other.

    Parameters
    ----------
    oldest : float
        [s].

    Attributes
    ----------
    age : float
        Of the last sample judged, when its picture was drawn [s].
    marked : bool
        Whether the next picture is to say that it is late.
    held : int
        Pictures held back so far.
    late : int
        Pictures shown so far that said that they were late.
    """

    def __init__(self, oldest: float = OLDEST) -> None:
        self.oldest = oldest
        self.marked = False
        self.age = 0.0
        self.held = self.late = 0
        self._row = 0  # pictures held back since one was shown

    def shows(self, age: float, *, rate: float = float("nan"), news: bool = True) -> bool:
        """Whether the picture may be shown.

        Parameters
        ----------
        age : float
            Of its sample, now that it is drawn [s]; NaN where nothing is live.
        rate : float
            Samples a second that come; NaN where nobody knows.
        news : bool
            Whether it is the first picture of its sample. Later ones, drawn because the camera
            turned, are as old as the source is slow: that is not drawing's fault.
        """
        self.age, limit = age, self.oldest
        if not news:
            limit = max(limit, MISSED / rate) if rate > 0.0 else float("inf")
        if not age > limit:
            self.marked, self._row = False, 0
            return True
        if self.marked:
            self.late += 1
            self._row = 0
            return True
        self.held += 1
        self._row += 1
        self.marked = self._row >= PATIENCE
        return False
