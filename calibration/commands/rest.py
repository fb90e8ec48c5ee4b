"""`skinmap calibrate rest`: the zero of a load calibration, taken anew from an untouched skin."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from skinmap.commands.options import open_stream, prints, seconds_option
from skinmap.errors import InvalidArrayError
from skinmap.report.present import present
from skinmap.summary import first_few

if TYPE_CHECKING:
    from skinmap.arrays import FloatArray
    from skinmap.touch.load_calibration import LoadCalibration, Zero

MOVED = 4.0  # counts that the median taxel may move while the skin rests
FILES = (".npz", ".csv", ".mcap")
REST = 3.0  # of a live source that sets the zero [s]


@dataclass(frozen=True, kw_only=True, slots=True)
class RestResult:
    """A load calibration with a new zero.

    Attributes
    ----------
    channels
        Total number of channels.
    samples
        Number of samples behind the zero.
    zero
        `auto`, `first`, or `none` for the zero of the evidence.
    age_seconds
        Age of the zero that was replaced [s].
    shift_counts
        Median over taxels of how far their rest moved from that of the evidence [counts].
    shared_bar
        Part of the shift that all taxels share [bar].
    far
        Channels whose rest moved by more than 12 % of their range.
    file
        The calibration that was written.
    """

    channels: int
    samples: int
    zero: str
    age_seconds: float
    shift_counts: float
    shared_bar: float
    far: list[int]
    file: str


@click.command("rest")
@click.argument("source", metavar="SOURCE|RECORDING")
@click.option("-o", "--out", "model", required=True, metavar="MODEL",
              type=click.Path(path_type=Path),
              help="Calibration of `calibrate load`: its zero is replaced.")  # fmt: skip
@click.option("--zero", type=click.Choice(["auto", "none", "first"]), default="auto",
              show_default=True, help="Rest before load and after it, rest before it, or back to "
              "the zero of the evidence.")  # fmt: skip
@click.option("--robot", metavar="ROBOT", help="Robot of a live source.")
@click.option("--part", metavar="PART", help="Only this part of the robot: that of a live source.")
@seconds_option("Stop after this time [s]: the rest of a live source, 3 s by default.")
@prints(RestResult)
def rest(as_json: bool, **given: Any) -> None:
    """Zero an existing load calibration anew, on a skin that nothing touches.

    RECORDING is .mcap, or .npz or .csv with `samples (t, n)` and `times (t,)`: its rest before the
    first load is found in it. A live source must rest for `--seconds`.

    \b
    Example:  skinmap calibrate rest today.npz -o load
    """
    present(work(**given), _lines, as_json=as_json)


def work(
    *,
    source: str,
    model: Path,
    zero: Zero,
    robot: str | None,
    part: str | None,
    seconds: float | None,
) -> RestResult:
    """Replace the zero of a calibration."""
    from dataclasses import replace

    from skinmap.io.output import staged_file
    from skinmap.live.response.loads import REST_FAR
    from skinmap.touch.load_calibration import FILE, LoadCalibration

    found = LoadCalibration.read(model)
    now = time.time()
    path = Path(source)
    if path.suffix.lower() in FILES:
        shift, count = _recorded(path, found, zero)
        now = path.stat().st_mtime
    else:
        samples = _heard(source, robot, part, REST if seconds is None else seconds, len(found))
        shift, count = found.zero_at(samples, now).shift, len(samples)
    if zero == "none":
        shift = np.zeros(len(found))
    own = found.answered
    shares = np.where(own, shift / found.span, 0.0)
    if (far := abs(float(np.median(shares[own])))) > REST_FAR:
        raise InvalidArrayError(
            f"{source}: the rest lies {100 * far:.0f} % of the calibrated range off that of the "
            f"evidence, at most {100 * REST_FAR:.0f} % are a rest: does something press?"
        )
    file = model / FILE if model.is_dir() else model
    with staged_file(file) as stage:
        stage.write_bytes(replace(found, shift=shift, zeroed=now).to_bytes())
    return RestResult(
        channels=len(found),
        samples=count,
        zero=zero,
        age_seconds=max(0.0, time.time() - found.zeroed),
        shift_counts=float(np.median(shift[own])),
        shared_bar=float(np.median((shift * found.top / found.span)[own])),
        far=np.flatnonzero(np.abs(shares) > REST_FAR).tolist(),
        file=str(file),
    )


def _recorded(path: Path, found: LoadCalibration, zero: Zero) -> tuple[FloatArray, int]:
    """Shift (n,) by the calm moments of a recording before its first load."""
    from skinmap.io.recordings.load_evidence import read_evidence

    one = read_evidence(path, needed=False)
    counts = found.checked(one.samples)
    if zero == "none":
        return np.zeros(len(found)), len(counts)
    own = found.answered
    if np.median(np.ptp(counts[:, own], axis=0)) <= MOVED:  # all of it is rest
        return found.zero_at(counts, 0.0).shift, len(counts)
    session = found.session(found.cooled(counts), one.rate, zero=zero)
    if not session.zeroed:
        raise InvalidArrayError(
            f"{path}: no rest before load: the recording begins under load or never holds still; "
            "record a second untouched, or keep the zero with --zero none"
        )
    return session.shift, len(counts)


def _heard(spec: str, robot: str | None, part: str | None, seconds: float, n: int) -> FloatArray:
    """Samples (t, n) of a live source at rest."""
    from skinmap.live.sources.source import SourceEnded

    _, source = open_stream(spec, robot, (part,) if part else ())
    heard, first, last = [], None, time.monotonic()
    try:
        while True:
            block = source.read(1.0)
            if block is not None and len(block):
                first = float(block.times[0]) if first is None else first
                heard.append(np.asarray(block.values, np.float64))
                last = time.monotonic()
                if block.times[-1] - first >= seconds:
                    break
            elif time.monotonic() - last > 10.0:
                raise InvalidArrayError(f"{spec}: no sample for 10 s")
    except SourceEnded:
        pass
    finally:
        source.close()
    if not heard:
        raise InvalidArrayError(f"{spec}: no sample")
    samples = np.vstack(heard)
    if samples.shape[1] != n:
        raise InvalidArrayError(
            f"{spec} has {samples.shape[1]} channels, calibrated are {n}: --part names the part"
        )
    moved = float(np.median(np.ptp(samples, axis=0)))
    if moved > MOVED:
        raise InvalidArrayError(
            f"{spec}: the skin did not rest: the median taxel moved by {moved:.0f} counts, "
            f"at most {MOVED:.0f} are rest"
        )
    return samples


def _lines(result: RestResult) -> Iterator[str]:
    from skinmap.live.response.loads import REST_FAR

    yield (
        f"zero of {result.channels} taxels from {result.samples} samples: rest moved by "
        f"{result.shift_counts:+.1f} counts, {result.shared_bar:+.3f} bar of it shared"
    )
    if result.far:
        words = (
            f"rest moved by more than {100 * REST_FAR:.0f} % of the range (does something press?)"
        )
        yield f"{words}: {first_few(result.far)}"
    yield f"the zero before it was {result.age_seconds / 60:.0f} minutes old"
    yield result.file
