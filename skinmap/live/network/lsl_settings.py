"""Settings of the lab streaming layer: nothing leaves this machine unless it is asked to.

liblsl looks for streams by multicast on all networks and serves them to whoever asks. Its
settings are read once in a process, before its first use, so they are made here. They keep its
questions on the loopback address; its servers listen on all addresses whatever they say, so these
sockets are tied to the loopback device.
"""

from __future__ import annotations

import os
import socket
import stat
import sys
import threading
import warnings
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

from skinmap.errors import InvalidArrayError, MessageError, MissingLibraryError, SkinWarning
from skinmap.live.network.network_messages import (
    HERE,
    KINDS,
    MAX_CHANNELS,
    MAX_PARTS,
    VERSION,
    Address,
    warn_if_open,
)
from skinmap.live.sources.source import Kind, StreamInfo

ANY = "any"
SCOPES = "NAME, //any/NAME for the whole network, //HOST/NAME for one other machine"

# Streams on one machine share the port for questions, and a question to its loopback address
# reaches one of them only. So they are asked one by one, on the ports that they serve.
_HERE = """[ports]
IPv6 = disable
PortRange = 64
[multicast]
ResolveScope = machine
ListenAddress = 127.0.0.1
AddressesOverride = {127.0.0.1}
[lab]
KnownPeers = {%s}
"""
_TUNING = """[tuning]
MulticastMinRTT = %s
UnicastMinRTT = 0.1
[log]
level = -3
"""
_lock = threading.Lock()
_scope: list[str] = []  # of this process, once LSL is in use: "" for this machine only


def split_scope(address: str) -> tuple[str, str]:
    """Scope ("" for this machine, "any", a host) and name of a stream.

    Raises
    ------
    InvalidArrayError
        No name, or one that LSL cannot look for.
    """
    scope, name = "", address
    if address.startswith("//"):
        scope, _, name = address.removeprefix("//").partition("/")
    bad = not name or not name.isprintable() or any(mark in name for mark in "'\"<>&")
    if bad or (address.startswith("//") and not scope):
        raise InvalidArrayError(f"{address!r} is not an LSL stream; expected {SCOPES}")
    if not all(letter.isalnum() or letter in ".-_:" for letter in scope):
        raise InvalidArrayError(f"{scope!r} is not a host; expected {SCOPES}")
    return scope, name


def settings(scope: str) -> str:
    """What liblsl is told: its own defaults for the whole network, else only what is named."""
    if scope == ANY:
        return _TUNING % 0.5
    return _HERE % ", ".join(filter(None, (HERE, scope))) + _TUNING % 0.01


def load_lsl(scope: str) -> Any:
    """The module `pylsl`, with settings for a scope.

    A file named by the variable LSLAPICFG is the user's own choice and wins.

    Raises
    ------
    InvalidArrayError
        This process uses LSL with another scope already: its settings are read once.
    MissingLibraryError
        pylsl or its library cannot be loaded, or is too old to be told.
    """
    with _lock:
        if _scope and _scope[0] != scope:
            now, then = (f"lsl://{one}/NAME" if one else "lsl:NAME" for one in (_scope[0], scope))
            raise InvalidArrayError(
                f"this process uses streams of the kind {now} already, and LSL reads its settings "
                f"once; use {then} in another process"
            )
        foreign = _is_loaded()
        try:
            import pylsl
        except (ImportError, RuntimeError, OSError) as error:
            raise MissingLibraryError(f"the lab streaming layer does not load: {error}") from error
        if _scope:
            return pylsl
        own = os.environ.get("LSLAPICFG", "")
        if own and Path(own).is_file():
            _warn(f"LSL follows {own} (LSLAPICFG), which may open it to the network")
        elif foreign:
            _warn("LSL was loaded before Skinmap could keep it on this machine")
        else:
            try:
                pylsl.set_config_content(settings(scope))
            except (AttributeError, NotImplementedError) as error:
                raise MissingLibraryError(
                    f"pylsl {pylsl.__version__} cannot be kept on this machine: {error}"
                ) from error
        if scope:
            warn_if_open(Address("*" if scope == ANY else scope, 16571), "LSL is open to")
        _scope.append(scope)
        return pylsl


def _is_loaded() -> bool:
    return "pylsl" in sys.modules


def keep_on_loopback(ports: Iterable[int]) -> bool:
    """Tie this process's sockets on some ports to the loopback device.

    Returns
    -------
    bool
        Whether all of them are; other systems than Linux cannot.
    """
    wanted, device = set(ports), getattr(socket, "SO_BINDTODEVICE", None)
    if device is None:
        return False
    tied = set()
    for number in [int(path.name) for path in Path("/proc/self/fd").iterdir()]:
        with suppress(OSError):  # closed meanwhile by another thread
            if not stat.S_ISSOCK(os.fstat(number).st_mode):
                continue
            with socket.socket(fileno=os.dup(number)) as one:
                if one.family != socket.AF_INET:
                    continue
                host, port = one.getsockname()
                if port in wanted:
                    if not host.startswith("127."):
                        one.setsockopt(socket.SOL_SOCKET, device, b"lo\0")
                    tied.add(port)
    return tied == wanted


def _warn(text: str) -> None:
    warnings.warn(text, SkinWarning, stacklevel=4)


TYPE = "Tactile"
TEXT_TYPE = "Markers"
ALL = "all"  # the part of a stream that says nothing of parts


def describe(element: Any, info: StreamInfo) -> None:
    """Write what a stream says of its skin under its `desc`."""
    skin = element.append_child("skinmap")
    skin.append_child_value("version", str(VERSION))
    skin.append_child_value("kind", info.kind)
    skin.append_child_value("robot", info.robot)
    parts = skin.append_child("parts")
    for part, width in zip(info.parts, info.widths, strict=True):
        one = parts.append_child("part")
        one.append_child_value("name", part)
        one.append_child_value("channels", str(width))
        one.append_child_value("fingerprint", info.fingerprints.get(part, ""))


def read_description(found: Any) -> StreamInfo:
    """What a stream is, from its full description.

    A stream that is not ours is taken as pressures of one part, called "all".

    Raises
    ------
    MessageError
        A description that contradicts itself, or more channels than anybody has.
    """
    name, channels = found.name(), found.channel_count()
    rate = max(float(found.nominal_srate()), 0.0)
    if not 1 <= channels <= MAX_CHANNELS:
        raise MessageError(f"stream {name!r} has {channels} channels, at most {MAX_CHANNELS}")
    skin = found.desc().child("skinmap")
    if skin.empty():
        return StreamInfo(name, (ALL,), (channels,), rate, clock="local")
    if skin.child_value("version") != str(VERSION):
        raise MessageError(
            f"stream {name!r} has a description of version {skin.child_value('version')!r}, "
            f"this Skinmap reads {VERSION}"
        )
    parts, widths, prints = _parts(skin, name)
    kind = skin.child_value("kind")
    if kind not in KINDS or sum(widths) != channels:
        raise MessageError(
            f"stream {name!r} describes {sum(widths)} {kind} channels and has {channels}"
        )
    try:
        return StreamInfo(
            name,
            tuple(parts),
            tuple(widths),
            rate,
            cast("Kind", kind),
            skin.child_value("robot"),
            {part: print_ for part, print_ in zip(parts, prints, strict=True) if print_},
            "local",
        )
    except ValueError as error:
        raise MessageError(str(error)) from error


def _parts(skin: Any, name: str) -> tuple[list[str], list[int], list[str]]:
    parts: list[str] = []
    widths: list[int] = []
    prints: list[str] = []
    one = skin.child("parts").child("part")
    while not one.empty():
        count = one.child_value("channels")
        if not (count.isascii() and count.isdigit()) or len(count) > 9 or len(parts) >= MAX_PARTS:
            raise MessageError(f"stream {name!r} describes a part with {count[:20]!r} channels")
        parts.append(one.child_value("name"))
        widths.append(int(count))
        prints.append(one.child_value("fingerprint"))
        one = one.next_sibling("part")
    return parts, widths, prints
