"""Whether a result may be used: its status, why, and the exit code that says so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

OK = "ok"
REFUSED_CODE = 3  # 0 done, 1 internal error, 2 bad input


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a result was judged.

    Attributes
    ----------
    status : str
        `ok`, or in a word why not.
    reasons : sequence of str
        Whole sentences, the most telling first.
    accepted : bool
        Use it whatever the status.
    """

    status: str = OK
    reasons: Sequence[str] = ()
    accepted: bool = False

    @property
    def refused(self) -> bool:
        """Whether results are not to be used."""
        return self.status != OK and not self.accepted
