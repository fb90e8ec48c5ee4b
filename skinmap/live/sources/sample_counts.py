"""What has happened to the samples of a stream, on the way and here: one set of names."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(slots=True)
class Counts:
    """Counts of a stream's samples; each station keeps its own.

    Attributes
    ----------
    received : int
        Number of samples that arrived.
    given : int
        Number of samples that a receiver passed on.
    used : int
        Number of samples used for contacts.
    lost : int
        Number of samples missing by the transport's numbers or by the times.
    dropped : int
        Left out because they were not used in time.
    refused : int
        Messages that do not follow their layout.
    delayed : int
        Blocks that came more than two periods after the one before.
    late, repeated : int
        Older than one that came before; of the same time: left out.
    short, long : int
        With too few or too many values: left out.
    nan, out_of_range : int
        With such values: those of the last sample stand in, or the end of the range.
    restarts : int
        Times that the clock began anew.
    stale, reconnects : int
        Times that nothing came for a while, and that a lost source was had again.
    failed : int
        Calls of subscribers that failed.
    """

    received: int = 0
    given: int = 0
    used: int = 0
    lost: int = 0
    dropped: int = 0
    refused: int = 0
    delayed: int = 0
    late: int = 0
    repeated: int = 0
    short: int = 0
    long: int = 0
    nan: int = 0
    out_of_range: int = 0
    restarts: int = 0
    stale: int = 0
    reconnects: int = 0
    failed: int = 0

    def as_dict(self) -> dict[str, int]:
        """By name."""
        return asdict(self)

    def joined(self, theirs: Counts) -> Counts:
        """These and what a source counted on the way."""
        both = {name: getattr(self, name) + getattr(theirs, name) for name in self.__slots__}
        # Both see these: the larger one knows more.
        for name in ("received", "lost"):
            both[name] = max(getattr(self, name), getattr(theirs, name))
        return Counts(**both)
