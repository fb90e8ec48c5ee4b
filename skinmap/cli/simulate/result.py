"""What `skinmap simulate` made: the types of its results."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True, slots=True)
class SimulatedPart:
    """The touches of one part.

    Attributes
    ----------
    part
        Its name.
    samples
        Of its recording.
    touches
        How many by label.
    subjects
        People who touched it.
    """

    part: str
    samples: int
    touches: dict[str, int]
    subjects: int


@dataclass(frozen=True, kw_only=True, slots=True)
class SimulateResult:
    """A recording that was simulated.

    Attributes
    ----------
    robot, seed
        What it was made of.
    variety
        How far touches and sensors were drawn at random, 0 to 1.
    parts
        In the order of the recording.
    files
        The recording.
    """

    robot: str
    seed: int
    variety: float
    parts: list[SimulatedPart]
    files: list[str]


@dataclass(frozen=True, kw_only=True, slots=True)
class StreamResult:
    """A stream that was simulated, with `--publish`.

    Attributes
    ----------
    robot, seed
        What it was made of.
    publish
        Where to.
    kind
        What its values are.
    rate_hz
        Samples a second, as it was asked for.
    parts, channels
        Whose values it has, and how many.
    samples, seconds
        That went out, and how long that took.
    behind_s
        How late the last samples went out.
    touches
        How many by label.
    interrupted
        Whether Ctrl-C ended it.
    """

    robot: str
    seed: int
    publish: str
    kind: Literal["raw", "pressure"]
    rate_hz: float
    parts: list[str]
    channels: int
    samples: int
    seconds: float
    behind_s: float
    touches: dict[str, int]
    interrupted: bool
