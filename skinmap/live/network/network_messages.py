"""Addresses of streams, and what a stream says of itself as JSON (docs/live.md)."""

from __future__ import annotations

import ipaddress
import json
from dataclasses import dataclass
from typing import Annotated, Any

import msgspec

from skinmap.errors import InvalidArrayError, MessageError, warn
from skinmap.live.sources.source import SIMULATION, Kind, StreamInfo
from skinmap.validation import checked

HERE = "127.0.0.1"


@dataclass(frozen=True, slots=True)
class Address:
    """A host and a port.

    Attributes
    ----------
    host : str
        A name or a number; "*" for all of this machine's addresses.
    port : int
    """

    host: str
    port: int

    @property
    def is_here(self) -> bool:
        """Whether the address is of this machine alone."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def endpoint(self) -> str:
        """As ZeroMQ writes it."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"tcp://{host}:{self.port}"


DIGITS = 5  # of the highest port; Python refuses to read thousands of them


def parse_address(text: str) -> Address:
    """Read "PORT" or "HOST:PORT"; an IPv6 host stands in brackets.

    Raises
    ------
    InvalidArrayError
        Anything else (says what was expected).
    """
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]") if host.startswith("[") else host
    digits = port.isascii() and port.isdigit() and len(port) <= DIGITS
    known = all(letter.isalnum() or letter in ".-_*:%" for letter in host)
    if not digits or not 1 <= int(port) <= 65535 or not known or host.startswith("-"):
        raise InvalidArrayError(
            f"{text!r} is not an address; expected PORT or HOST:PORT, such as 5555"
        )
    return Address(host or HERE, int(port))


def warn_if_open(address: Address, what: str) -> None:
    """Say that others can reach what is opened there, or that it comes from elsewhere."""
    if not address.is_here:
        warn(
            f"{what} {address.host}:{address.port}: not protected by any password or encryption; "
            "use it in networks that you trust",
            above=1,
        )


VERSION = 1
KINDS: tuple[Kind, ...] = ("raw", "pressure")
MAX_CHANNELS = 1_000_000
LARGEST_TEXT = 1 << 20  # of JSON [bytes]
MAX_PARTS = 1000


class _PartSaid(msgspec.Struct):
    """A part of a stream; keys that we do not know are left alone."""

    part: str
    channels: Annotated[int, msgspec.Meta(ge=1)]
    fingerprint: str = ""


class _Description(msgspec.Struct):
    """What a publisher says of its stream."""

    name: str
    kind: Kind
    rate_hz: Annotated[float, msgspec.Meta(ge=0)]
    parts: Annotated[list[_PartSaid], msgspec.Meta(min_length=1, max_length=MAX_PARTS)]
    robot: str = ""
    clock: str = "publisher"


def pack_info(info: StreamInfo, *, session: int, heartbeat: float) -> bytes:
    """JSON of a stream's description."""
    return json.dumps(
        {
            "skinmap": VERSION,
            "name": info.name,
            "kind": info.kind,
            "robot": info.robot,
            "rate_hz": info.rate,
            "clock": info.clock,
            "parts": [
                {"part": part, "channels": width, "fingerprint": info.fingerprints.get(part, "")}
                for part, width in zip(info.parts, info.widths, strict=True)
            ],
            "session": session,
            "heartbeat_s": heartbeat,
        }
    ).encode()


def unpack_info(frame: bytes) -> StreamInfo:
    """Read a stream's description; keys that we do not know are left alone.

    Raises
    ------
    MessageError
        Not such a description.
    """
    found = read_json(frame)
    if found.get("skinmap") != VERSION:
        raise MessageError(
            f"a description of version {found.get('skinmap')!r}, this Skinmap reads {VERSION}"
        )
    told = checked(found, _Description, what="a stream's description", fail=MessageError)
    widths = tuple(part.channels for part in told.parts)
    if sum(widths) > MAX_CHANNELS:
        raise MessageError(f"{sum(widths)} channels, at most {MAX_CHANNELS} are read")
    prints = {part.part: part.fingerprint for part in told.parts if part.fingerprint}
    names = tuple(part.part for part in told.parts)
    # What comes over a network is live, whatever made it: its reader waits and finds it stale.
    clock = "publisher" if told.clock == SIMULATION else told.clock
    try:
        return StreamInfo(
            told.name, names, widths, told.rate_hz, told.kind, told.robot, prints, clock
        )
    except InvalidArrayError as error:
        raise MessageError(f"a stream's description that makes no sense: {error}") from error


def read_json(frame: bytes) -> dict[str, Any]:
    """A JSON object.

    Raises
    ------
    MessageError
        Anything else.
    """
    if len(frame) > LARGEST_TEXT:
        raise MessageError(f"JSON of {len(frame)} bytes, at most {LARGEST_TEXT} are read")
    try:
        found = json.loads(frame)
    except (ValueError, RecursionError) as error:
        raise MessageError(f"no JSON: {error}") from error
    if not isinstance(found, dict):
        raise MessageError(f"JSON of a {type(found).__name__}, expected an object")
    return found
