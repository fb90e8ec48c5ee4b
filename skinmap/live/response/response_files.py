"""Files of response calibrations, read through a group of entry points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.live.response.pressures import Response
from skinmap.registry import Registry
from skinmap.skin.skin import fingerprint
from skinmap.touch.prepared_skin import PreparedSkin

# `load(path) -> Response`; `file` is the one of `skinmap calibrate response`.
readers: Registry[Callable[[Path], Response]] = Registry(
    "reader of response calibrations", "skinmap.responses"
)


def load_responses(specs: Sequence[str], skins: Mapping[str, PreparedSkin]) -> dict[str, Response]:
    """Response calibrations by part.

    Parameters
    ----------
    specs : sequence of str
        "FILE", for the part whose layout was calibrated, or "PART=FILE".
    skins : mapping of str to PreparedSkin
        By part.

    Raises
    ------
    UnknownNameError
        No such part, or nobody reads such files.
    MissingFileError, DataFormatError
        No such file, or no calibration.
    InvalidArrayError
        A file that does not say which part it is of.
    """
    found: dict[str, Response] = {}
    by_fingerprint = {fingerprint(skin.skin): part for part, skin in skins.items()}
    for spec in specs:
        part, equals, name = spec.partition("=")
        if not equals:
            part, name = "", spec
        elif part not in skins:
            raise UnknownNameError("part to calibrate", part, skins)
        response = readers.get("file")(Path(name))
        own = str(getattr(response, "fingerprint", ""))
        part = part or by_fingerprint.get(own, "")
        if not part:
            raise InvalidArrayError(
                f"{name} was calibrated on none of {', '.join(skins)}, or does not name its skin; "
                "give PART=FILE"
            )
        found[part] = response
    return found
