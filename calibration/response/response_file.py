"""Files of response calibrations: a zip of plain arrays with a head in JSON."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from calibration.response.gain import Gain
from calibration.response.response import ResponseCalibration
from skinmap.archive import open_arrays
from skinmap.errors import DAMAGED_ARCHIVE, DataFormatError, MissingFileError
from skinmap.io.output import staged_file

FORMAT = "skinmap-response-1"


def save_response(response: ResponseCalibration, path: Path) -> None:
    """Write a response calibration; a failure leaves what was there.

    Parameters
    ----------
    response : ResponseCalibration
    path : Path
        A file ending in .npz.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from pathlib import Path
    >>> from calibration.response import ResponseCalibration, save_response
    >>> rest = np.random.default_rng(0).normal(40.0, 1.0, (100, 12))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_response(ResponseCalibration.fit(rest), Path(folder) / "response.npz")

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    head = {
        "format": FORMAT,
        "sign": response.sign,
        "rate": response.rate,
        "fingerprint": response.fingerprint,
        "health": response.health.tolist(),
    }
    arrays: dict[str, Any] = {
        "head": np.frombuffer(json.dumps(head).encode(), np.uint8),
        "baseline": response.baseline,
        "noise": response.noise,
        "threshold": response.threshold,
    }
    if response.gain is not None:
        arrays |= {"gain_loads": response.gain.knots, "gain_counts": response.gain.counts}
    if response.modules is not None:
        arrays["modules"] = response.modules
    if response.thermal is not None:
        arrays["thermal"] = response.thermal
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    with staged_file(path) as stage:
        stage.write_bytes(buffer.getvalue())


def load_response(path: Path, *, fingerprint: str = "") -> ResponseCalibration:
    """Read what `save_response` wrote, for the skin of a fingerprint where it is given.

    Parameters
    ----------
    path : Path
    fingerprint : str
        Of the skin that it is to be used for; empty where that is not known.

    Returns
    -------
    ResponseCalibration
        As it was saved.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from pathlib import Path
    >>> from calibration.response import ResponseCalibration, load_response, save_response
    >>> rest = np.random.default_rng(0).normal(40.0, 1.0, (100, 12))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_response(ResponseCalibration.fit(rest, rate=100.0), Path(folder) / "r.npz")
    ...     load_response(Path(folder) / "r.npz").rate
    100.0

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or not one of ours.
    SkinMismatchError
        Calibrated was another skin.
    """
    if not path.is_file():
        raise MissingFileError(path, "a response calibration")
    try:
        with open_arrays(path) as arrays:
            head = json.loads(arrays["head"].tobytes())
            if head["format"] != FORMAT:
                raise DataFormatError(f"format {head['format']!r}, expected {FORMAT!r}", path)
            gain = None
            if "gain_loads" in arrays:
                gain = Gain(arrays["gain_loads"], arrays["gain_counts"])
            response = ResponseCalibration(
                arrays["baseline"],
                arrays["noise"],
                arrays["threshold"],
                int(head["sign"]),
                np.array(head["health"], dtype="<U13"),
                gain,
                float(head["rate"]),
                str(head["fingerprint"]),
                arrays.get("modules"),
                arrays.get("thermal"),
            )
    except DAMAGED_ARCHIVE as error:
        if isinstance(error, DataFormatError):
            raise
        raise DataFormatError(f"not a response calibration: {error}", path) from error
    response.check_skin(fingerprint)
    return response
