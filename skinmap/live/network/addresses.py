"""Addresses of network streams: this machine unless another one is named, and then a warning."""

from __future__ import annotations

import ipaddress
import warnings
from dataclasses import dataclass

from skinmap.errors import InvalidArrayError, SkinWarning

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
        warnings.warn(
            f"{what} {address.host}:{address.port}: not protected by any password or encryption; "
            "use it in networks that you trust",
            SkinWarning,
            stacklevel=3,
        )
