"""What a stream of the lab streaming layer says of its skin, in its XML description."""

from __future__ import annotations

from typing import Any, cast

from skinmap.errors import MessageError
from skinmap.live.network.messages import KINDS, MAX_CHANNELS, MAX_PARTS, VERSION
from skinmap.live.sources.source import Kind, StreamInfo

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
