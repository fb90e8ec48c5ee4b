"""Targets that come while a program runs: streams, pages, saved views, profiles, addresses."""

from __future__ import annotations

import asyncio
import json
import logging
import math
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from skinmap import __version__
from skinmap.errors import MessageError
from skinmap.live.network.lsl_stream import read_description
from skinmap.live.network.network_messages import pack_info, parse_address, read_json, unpack_info
from skinmap.live.network.zmq_stream import Header, ZmqSource
from skinmap.live.sources.source import Source, StreamInfo
from skinmap.profile import read_profile
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.interaction.view_file import SavedView, load_settings, load_view, save_view
from viewer.layers import Layers
from viewer.playing.player import Player
from viewer.web.guard import Guard
from viewer.web.hub import Client, Hub

from .layouts import written
from .target import Target, of_bytes

INFO = StreamInfo("demo", ("arm", "hand"), (3, 2), 50.0, "raw", "icub", {"arm": "ab"}, "simulation")
DESCRIPTION = pack_info(INFO, session=3, heartbeat=0.2)
SAMPLE = b"|".join(
    [b"pressure", Header(2, 5, 7, 3, 1.5, 99.25).pack(), np.ones(5, "<f4").tobytes()]
)
VIEW = SavedView(
    "iCub", (1.0, 0.2, 0.1), (0.0, 0.0, 0.1), (0.0, 0.0, 1.0), 22.0, "still", "health", "discs",
    "torso", {"torso": (3, 4)},
)  # fmt: skip
PROFILE = f"""[profile]
format = 1
skinmap = "{__version__}"
robot = "icub"
part = "right_forearm"
machine = "two cores"
[flatten]
method = "fast"
[flatten.predicted]
seconds = 0.0062
error = 0.81
unit = "%"
[classify]
words = 8
radius_mm = 8.0
""".encode()
WISHES = [
    {"do": "drawn", "samples": math.inf}, {"do": "seek", "to": 10**400},
    {"do": "drawn", "samples": 3}, {"do": "play"}, {"do": "step", "by": -1},
    {"do": "seek", "to": 1.5}, {"do": "speed", "to": 2}, {"do": "loop", "to": True},
    {"do": "layer", "to": "health"}, {"do": "pick", "part": "left_hand", "taxel": 3},
]  # fmt: skip
REQUEST = b"/tok/live\nHost: 127.0.0.1:8080\nOrigin: http://127.0.0.1:8080\nUpgrade: websocket"


@cache
def source() -> ZmqSource:
    """One that is handed its frames: no socket is needed to take them apart."""
    made = object.__new__(ZmqSource)
    Source.__init__(made, INFO)
    made.address, made._description = parse_address("5555"), DESCRIPTION
    made._session, made._sequence, made._silent_since = None, -1, None
    return made


def take(message: bytes) -> None:
    """Frames of a sample: taken, or counted as refused."""
    before = source().counts.refused
    topic, _, rest = message.partition(b"|")
    # A header may hold the bytes that part frames: they are parted by its length.
    frames = [topic, rest[:40], rest[41:]] if topic != b"info" else [topic, rest]
    found = source().take(frames)
    if found is not None and found[1].shape != (INFO.channels,):
        raise AssertionError(f"a sample of {found[1].shape}")
    if found is None and topic != b"info" and source().counts.refused == before:
        raise AssertionError("neither taken nor counted")


class Element:
    """A description as pylsl gives it, of nested lists in JSON: [name, text or children]."""

    def __init__(self, children: Any = None, later: Any = ()) -> None:
        self.children, self.later = children, later

    def empty(self) -> bool:
        return self.children is None

    def _first(self, name: str, among: Any) -> Element:
        for place, one in enumerate(among):
            if isinstance(one, list) and len(one) == 2 and one[0] == name:
                return Element(one[1] if one[1] is not None else "", among[place + 1 :])
        return Element()

    def child(self, name: str) -> Element:
        return self._first(name, self.children if isinstance(self.children, list) else [])

    def next_sibling(self, name: str) -> Element:
        return self._first(name, self.later)

    def child_value(self, name: str) -> str:
        found = self.child(name).children
        return found if isinstance(found, str) else ""


def describe(message: bytes) -> None:
    """Channels, rate and description of a stream, as JSON."""
    found = read_json(message)
    channels, rate = found.get("channels"), found.get("rate")
    if not isinstance(channels, int) or not isinstance(rate, float):
        raise MessageError("not what a library would give")
    read_description(SimpleNamespace(
        name=lambda: "fuzzed", channel_count=lambda: channels, nominal_srate=lambda: rate,
        desc=lambda: Element(found.get("desc")),
    ))  # fmt: skip


LSL = json.dumps({"channels": 5, "rate": 50.0, "desc": [["skinmap", [
    ["version", "1"], ["kind", "raw"], ["robot", "icub"], ["parts", [
        ["part", [["name", "a"], ["channels", "3"], ["fingerprint", "ab"]]],
        ["part", [["name", "b"], ["channels", "2"], ["fingerprint", ""]]],
    ]],
]]]}).encode()  # fmt: skip


@cache
def hub() -> Hub:
    """What pages talk to, for one hand that nobody touches."""
    import skinmap

    skins = {"left_hand": PreparedSkin(skinmap.load_robot("icub").skin("left_hand"))}
    made = object.__new__(Hub)  # without the body's meshes, which pages only read
    player = Player([], paused=True)
    scene: Any = SimpleNamespace(skins=skins)
    Hub.__init__(made, scene, player, Layers(skins), {"layer": "pressure"})
    return made


async def wish(client: Client, text: str | bytes) -> None:
    """What a page asks for, in the loop that its answers may need."""
    hub()._obey(client, text)


def grant(client: Client, text: str | bytes) -> None:
    """What a page asks for, in a thread: tests with a browser leave a loop running in this one."""
    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, wish(client, text)).result()


def obey(message: bytes) -> None:
    """A wish of a page: done, or answered with a line; never the end of the connection."""
    client = Client("pressure")
    for text in (message, message.decode("utf-8", "replace")):
        grant(client, text)
    for letter in client.letters.values():
        json.loads(letter, parse_constant=lambda word: 1 / 0)  # a page's JSON has no NaN


def ask(message: bytes) -> None:
    """A request to the server: its path and headers."""
    path, *lines = message.decode("latin-1").split("\n")
    headers: dict[str, list[str]] = {"Host": [], "Origin": [], "Upgrade": []}
    for line in lines:
        name, _, value = line.partition(": ")
        if name in headers:
            headers[name].append(value)
    found = Guard("127.0.0.1", 8080, "tok").check(path, headers)
    if isinstance(found, str) and path.split("?")[0].split("/")[:2] != ["", "tok"]:
        raise AssertionError(f"let in without the token: {message!r}")


logging.getLogger("skinmap.live").setLevel(logging.WARNING)
LIVE = "skinmap.live.network"

TARGETS = [
    Target("stream-sample", "m", lambda: [SAMPLE, b"info|" + DESCRIPTION], of_bytes(take)),
    Target("stream-description", "m", lambda: [DESCRIPTION], of_bytes(unpack_info),
           (f"{LIVE}.network_messages.read_json",)),
    Target("lsl-description", "m", lambda: [LSL], of_bytes(describe),
           (f"{LIVE}.lsl_stream.read_description",)),
    Target("page-wish", "m", lambda: [json.dumps(wish).encode() for wish in WISHES],
           of_bytes(obey)),
    Target("page-request", "m", lambda: [REQUEST], of_bytes(ask)),
    Target("address", "m", lambda: [b"127.0.0.1:5555", b"[::1]:80", b"5555"],
           of_bytes(lambda data: parse_address(data.decode("utf-8", "replace")))),
    Target("profile", "p.toml", lambda: [PROFILE], read_profile, ("skinmap.profile.read_profile",)),
    Target("view", "view.json", lambda: [written(lambda p: save_view(VIEW, p))], load_view,
           ("viewer.interaction.view_file.load_view",)),
    Target("view-settings", "view.json", lambda: [written(lambda p: save_view(VIEW, p))],
           load_settings, ("viewer.interaction.view_file.load_settings",)),
]  # fmt: skip
