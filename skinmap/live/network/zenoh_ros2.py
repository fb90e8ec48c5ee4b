"""Zenoh as ROS 2's rmw_zenoh speaks it: sessions, keys, and what travels beside a message.

A topic is the key DOMAIN/TOPIC/TYPE/HASH, a message plain CDR with an attachment of 33 bytes, and
each publisher shows itself to ROS 2's graph by a liveliness token (the design page of rmw_zenoh).
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from typing import Any

from skinmap.errors import InvalidArrayError, OutputError, UnreachableError
from skinmap.imports import import_optional
from skinmap.io.ros2.message_types import dds_name, type_hash
from skinmap.live.network.addresses import HERE, Address, parse_address

PORT = 7447  # of the router that ROS 2 expects on each machine
DOMAIN = "ROS_DOMAIN_ID"  # the environment variable by which ROS 2 divides a network
MAX_DOMAIN = 232  # of ROS 2
ATTACHMENT = struct.Struct("<qqB16s")  # number, time [ns], length and number of the sender
SENDER_BYTES = 16
QOS, LATCHED_QOS = (
    "::,10:,:,:,,",
    ":1:,1:,:,:,,",
)  # rmw_zenoh's short form: what differs from ROS 2's defaults
SKIN = "/skin"


@dataclass(frozen=True, slots=True)
class ZenohAddress:
    """Where a stream is to be had.

    Attributes
    ----------
    address : Address
    topic : str
        Of ROS 2; "/skin" is the beginning of our own.
    field : str
        Of a cloud.
    """

    address: Address
    topic: str
    field: str


def parse_zenoh(text: str) -> ZenohAddress:
    """Read "[PORT|HOST:PORT][/TOPIC][#FIELD]".

    Raises
    ------
    InvalidArrayError
        Anything else.
    """
    where, slash, rest = text.partition("/")
    topic, _, field = rest.partition("#")
    address = parse_address(where) if where else Address(HERE, PORT)
    words = topic.split("/") if slash else [SKIN[1:]]
    if not all(word.replace("_", "a").isalnum() and word.isascii() for word in words):
        raise InvalidArrayError(
            f"{text!r}: no topic of ROS 2; expected [PORT|HOST:PORT][/TOPIC][#FIELD], such as "
            f"{PORT}/tactile/points#pressure"
        )
    return ZenohAddress(address, "/" + "/".join(words), field)


def domain() -> int:
    """ROS 2's domain, by its environment variable; 0 where it is not set."""
    said = os.environ.get(DOMAIN, "0") or "0"
    if not said.isascii() or not said.isdigit() or len(said) > 3 or int(said) > MAX_DOMAIN:
        raise InvalidArrayError(f"{DOMAIN} is {said!r}; expected 0 to {MAX_DOMAIN}")
    return int(said)


def key_of(topic: str, kind: str) -> str:
    """The key of a topic of one of the types that we write."""
    return f"{domain()}{topic}/{dds_name(kind)}/{type_hash(kind)}"


def token_of(session: str, number: int, topic: str, kind: str, *, latched: bool) -> str:
    """The key by which a publisher shows itself in ROS 2's graph."""
    return (
        f"@ros2_lv/{domain()}/{session}/0/{number}/MP/%/%/skinmap/{topic.replace('/', '%')}/"
        f"{dds_name(kind)}/{type_hash(kind)}/{LATCHED_QOS if latched else QOS}"
    )


def node_token(session: str) -> str:
    """The key by which a node called skinmap shows itself."""
    return f"@ros2_lv/{domain()}/{session}/0/0/NN/%/%/skinmap"


def import_zenoh() -> Any:
    """The package, or one line on how to get it."""
    return import_optional(
        "zenoh", "Zenoh needs the package eclipse-zenoh: pip install 'skinmap[zenoh]'"
    )


def open_session(address: Address, *, listen: bool) -> Any:
    """A session that listens at an address, or goes there.

    Nothing is searched for by multicast, as in rmw_zenoh. Where a router already listens at the
    address, a session that should listen goes there instead.

    Raises
    ------
    OutputError
        The address is not of this machine.
    UnreachableError
        Zenoh refuses the address.
    """
    zenoh = import_zenoh()
    host = f"[{address.host}]" if ":" in address.host else address.host
    place = f'["tcp/{"0.0.0.0" if host == "*" else host}:{address.port}"]'
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", place if listen else "[]")
    config.insert_json5("connect/endpoints", "[]" if listen else place)
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        if not listen:
            raise UnreachableError(f"cannot reach {place[2:-2]}: {_short(error)}") from error
        if "in use" not in str(error) or not address.is_here:
            raise OutputError(f"cannot publish at {place[2:-2]}: {_short(error)}") from error
    return open_session(address, listen=False)


def _short(error: Exception) -> str:
    """What Zenoh says, without where in its own source."""
    return str(error).split(" at /")[0][:200]
