"""Who may read the page: checks of Host, Origin and token before anything is answered.

Against what: another page in the same browser (it cannot read the token, its Origin differs),
a name that is pointed at this machine later (DNS rebinding: its Host differs), and other users of
the machine (they can reach the port, but do not have the token).
"""

from __future__ import annotations

import hmac
import ipaddress
import re
import secrets
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from urllib.parse import urlsplit

from skinmap.errors import InvalidArrayError

LOOPBACK = "127.0.0.1"
TOKEN_BYTES = 24  # 192 random bits: not to be guessed
TOKEN = re.compile(r"[A-Za-z0-9_-]{16,128}")
LIVE = "live"  # where the page's WebSocket connects


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a request gets no answer."""

    status: HTTPStatus
    reason: str


def new_token() -> str:
    """A random word for the address."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def check_token(token: str) -> str:
    """A word that may stand in the address and is not to be guessed.

    Raises
    ------
    InvalidArrayError
    """
    if not TOKEN.fullmatch(token):
        raise InvalidArrayError(
            f"a token has 16 to 128 letters, digits, '-' or '_', got {len(token)} characters"
        )
    return token


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True, slots=True)
class Guard:
    """Checks requests.

    Attributes
    ----------
    host : str
        Address that the server is bound to.
    port : int
    token : str
        First part of every path.
    """

    host: str
    port: int
    token: str

    def check(self, path: str, headers: Mapping[str, Sequence[str]]) -> Refusal | str:
        """Name of what is asked for (the path behind the token), or why it is refused.

        Parameters
        ----------
        path : str
            As requested, with its query.
        headers : mapping of str to sequence of str
            All values of `Host`, `Origin` and `Upgrade`.
        """
        hosts, origins = headers.get("Host", ()), headers.get("Origin", ())
        if len(hosts) != 1 or not self._is_ours(hosts[0]):
            return Refusal(HTTPStatus.FORBIDDEN, "this host name is not served here")
        live = any("websocket" in value.lower() for value in headers.get("Upgrade", ()))
        # A browser always says where a WebSocket comes from; without Origin it is no page of ours.
        if (live and not origins) or any(origin != f"http://{hosts[0]}" for origin in origins):
            return Refusal(HTTPStatus.FORBIDDEN, "requests from other pages are refused")
        before, _, rest = path.partition("?")[0].partition("/")  # every path begins with a slash
        given, _, name = rest.partition("/")
        if before or not hmac.compare_digest(given.encode(), self.token.encode()):
            return Refusal(HTTPStatus.FORBIDDEN, "token wrong or missing: open the printed address")
        if live != (name.rpartition("/")[2] == LIVE):
            return Refusal(HTTPStatus.NOT_FOUND, "nothing here")
        return name

    def _is_ours(self, header: str) -> bool:
        """Whether a Host header names this server and not a name that points at it by chance."""
        try:
            parts = urlsplit(f"//{header}")
            name, port = parts.hostname or "", 80 if parts.port is None else parts.port
        except ValueError:
            return False
        if port != self.port or parts.username is not None or parts.path:
            return False
        if name == "localhost" or name == self.host.strip("[]").lower():
            return True
        if is_loopback(self.host):
            return is_loopback(name)
        # Bound to more than this machine: a bare address cannot be pointed elsewhere, names can.
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name in {socket.gethostname().lower(), socket.getfqdn().lower()}
        return True


def page_headers(host: str, *, framed: bool = False) -> dict[str, str]:
    """Headers that keep the page to itself: nothing from, to or inside other pages.

    Two that stand side by side are `framed` in one of ours.
    """
    policy = {
        "default-src": "'none'",
        "script-src": "'self'",
        "style-src": "'self'",
        "img-src": "'self' data:",
        "connect-src": f"'self' ws://{host}",
        "base-uri": "'none'",
        "form-action": "'none'",
        "frame-src": "'self'" if framed else "'none'",
        "frame-ancestors": "'self'" if framed else "'none'",
    }
    return {
        "Content-Security-Policy": "; ".join(f"{key} {value}" for key, value in policy.items()),
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Referrer-Policy": "no-referrer",  # the address holds the token
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "no-store",
    }
