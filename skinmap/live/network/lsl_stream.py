"""Follow a stream of the lab streaming layer, with its clock brought to ours, and publish one.

Nothing leaves this machine unless it is asked to. liblsl looks for streams by multicast on all
networks and serves them to whoever asks. Its settings are read once in a process, before its first
use, so they are made here. They keep its questions on the loopback address; its servers listen on
all addresses whatever they say, so these sockets are tied to the loopback device.
"""

from __future__ import annotations

import hashlib
import os
import socket
import stat
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import (
    InvalidArrayError,
    MessageError,
    MissingLibraryError,
    OutputError,
    UnknownNameError,
    UnreachableError,
    warn,
)
from skinmap.live.network.network_messages import (
    HERE,
    KINDS,
    MAX_CHANNELS,
    MAX_PARTS,
    VERSION,
    Address,
    warn_if_open,
)
from skinmap.live.publishing.publish import OurTimes, Publisher, Topic, played
from skinmap.live.sources.source import (
    MAX_BLOCK,
    SILENT,
    Block,
    Kind,
    Source,
    StreamInfo,
    check_same_skin,
    check_skin,
    follow,
    of_robot,
)
from skinmap.skin.robot import Robot

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
            warn(f"LSL follows {own} (LSLAPICFG), which may open it to the network", above=1)
        elif foreign:
            warn("LSL was loaded before Skinmap could keep it on this machine", above=1)
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
    told = list(_parts(skin, name))
    kind, widths = skin.child_value("kind"), tuple(width for _, width, _ in told)
    if kind not in KINDS or sum(widths) != channels:
        raise MessageError(
            f"stream {name!r} describes {sum(widths)} {kind} channels and has {channels}"
        )
    names, prints = tuple(part for part, _, _ in told), {part: p for part, _, p in told if p}
    robot = skin.child_value("robot")
    try:
        return StreamInfo(name, names, widths, rate, cast("Kind", kind), robot, prints, "local")
    except ValueError as error:
        raise MessageError(str(error)) from error


def _parts(skin: Any, name: str) -> Iterator[tuple[str, int, str]]:
    """Name, channels and fingerprint of each part."""
    one, number = skin.child("parts").child("part"), 0
    while not one.empty():
        count, number = one.child_value("channels"), number + 1
        if not (count.isascii() and count.isdigit()) or len(count) > 9 or number > MAX_PARTS:
            raise MessageError(f"stream {name!r} describes a part with {count[:20]!r} channels")
        yield one.child_value("name"), int(count), one.child_value("fingerprint")
        one = one.next_sibling("part")


WAIT = 2.0  # for a stream of that name [s]
ANSWER = 4.0  # for a stream that was found to answer, on a busy machine too [s]
TWINS = 0.4  # and then for another one of the same name [s]
OTHERS = 0.5  # for all streams, to say which there are [s]
AGAIN = 0.3  # for one look for a stream that was lost [s]
BUFFERED = 5  # kept by LSL itself, at each end, for who reads too slowly [s]
CORRECT = 2.0  # between two looks at the other machine's clock [s]
MAX_VALUES = 1 << 22  # in one block
# Channel formats by LSL's numbers; it reads the last one where a C long has 64 bits.
FORMATS = ("undefined", "float32", "double64", "string", "int32", "int16", "int8", "int64")
NUMBERS = [one for one in (1, 2, 4, 5, 6, 7) if one < 7 or np.dtype("l").itemsize == 8]


class LslSource(Source):
    """Samples of one stream; times are those of this machine's monotonic clock.

    Parameters
    ----------
    address : str
        "NAME" or "NAME#UID" (the beginning of its identifier is enough where a name is not
        unique), behind "//any/" or "//HOST/" for other machines' streams.
    robot : Robot, optional
        Whose skin it must be, by the description.
    parts : sequence of str, optional
        One of them is that of a stream that names none.

    Raises
    ------
    UnknownNameError
        No such stream (lists those that exist), or several of that name.
    UnreachableError
        It is there but does not answer.
    MessageError
        A stream of text, or one that contradicts itself.

    Notes
    -----
    To be read from one thread: `open_lsl` puts a `Receiver` around it.
    """

    def __init__(self, address: str, *, robot: Robot | None, parts: Sequence[str] | None) -> None:
        scope, name = split_scope(address)
        self._lsl = load_lsl(scope)
        self._name, _, self._uid = name.partition("#")
        self._robot, self._parts = robot, parts
        self._inlet, info = self._open(self._find())
        super().__init__(info)
        self._last_seen = time.perf_counter()
        self._uid = ""  # whoever comes back under the name will do
        rows = max(1, min(MAX_BLOCK, MAX_VALUES // self._info.channels))
        self._buffer = np.empty((rows, self._info.channels), self._inlet.np_dtype)
        self._asked = time.perf_counter()

    @property
    def alive(self) -> bool:
        """Whether it is connected and, where it has a rate, a sample came within a second."""
        if self._inlet is None:
            return False
        return self._info.rate == 0 or time.perf_counter() - self.last_seen < SILENT

    def read(self, timeout: float) -> Block | None:
        """Samples that came; None where none does within `timeout` [s].

        Raises
        ------
        SkinMismatchError
            The stream came back with another skin.
        """
        if self._inlet is None and not self._reconnect():
            return None
        try:
            _, stamps = self._inlet.pull_chunk(
                timeout, len(self._buffer), dest_obj=self._buffer, min_samples=1, as_numpy=True
            )
        except self._lsl.util.LostError:
            self._inlet = None
            return None
        if len(stamps) == 0:
            return None
        now = time.perf_counter()
        self._last_seen = now
        self._correct(now)
        values = self._buffer[: len(stamps)]
        if values.dtype != np.float32:
            values = values.astype(np.float32)
        return Block(stamps + self._offset, values, now)

    def close(self) -> None:
        """Give the connection back; may be called twice."""
        self._inlet = None

    def _find(self) -> Any:
        """The stream of the name, if there is exactly one."""
        lsl = self._lsl
        found = lsl.resolve_byprop("name", self._name, 1, WAIT)
        if found:
            found = lsl.resolve_byprop("name", self._name, 2, TWINS) or found
        chosen = [one for one in found if one.uid().startswith(self._uid)]
        if not chosen:
            names = sorted({one.name() for one in lsl.resolve_streams(OTHERS)})
            wanted = self._name + (f"#{self._uid}" if self._uid else "")
            raise UnknownNameError("LSL stream", wanted, names)
        if len(chosen) > 1:
            ways = [f"lsl:{self._name}#{one.uid()[:8]} on {one.hostname()}" for one in chosen]
            raise UnknownNameError(
                "single LSL stream", f"{self._name} ({len(chosen)} have the name)", ways
            )
        return chosen[0]

    def _open(self, found: Any) -> tuple[Any, StreamInfo]:
        lsl = self._lsl
        if found.channel_format() not in NUMBERS:
            form = dict(enumerate(FORMATS)).get(found.channel_format(), "something else")
            raise MessageError(
                f"LSL stream {self._name!r} sends no numbers that Skinmap reads: {form}; "
                f"it reads {', '.join(FORMATS[one] for one in NUMBERS)}"
            )
        # No recovery by LSL itself: it would hide that a stream died, and for how long.
        inlet = lsl.StreamInlet(found, max_buflen=BUFFERED, recover=False)
        try:
            info = read_description(inlet.info(ANSWER))
            if self._robot is not None:
                if info.parts == (ALL,) and ALL not in self._robot.parts:
                    info = of_robot(info, self._robot, self._parts)
                check_skin(info, self._robot)
            inlet.open_stream(ANSWER)
        except (lsl.util.TimeoutError, lsl.util.LostError) as error:
            raise UnreachableError(
                f"LSL stream {self._name!r} on {found.hostname()} does not answer"
            ) from error
        self._offset = 0.0
        if found.hostname() != socket.gethostname():
            with suppress(RuntimeError):  # no answer in time: it is asked again
                self._offset = inlet.time_correction(CORRECT)
        return inlet, info

    def _reconnect(self) -> bool:
        """Look once for a stream of the same name and skin."""
        found = self._lsl.resolve_byprop("name", self._name, 1, AGAIN)
        if not found:
            return False
        try:
            inlet, info = self._open(found[0])
        except (UnreachableError, MessageError):
            return False
        check_same_skin(self._info, info, f"LSL stream {self._name!r} came back with another skin")
        self._inlet, self._last_seen = inlet, time.perf_counter()
        self._counts.reconnects += 1
        return True

    def _correct(self, now: float) -> None:
        """Ask from time to time how far the other clock is from ours.

        The first answer takes LSL half a second, in a thread of its own; later ones are at hand.
        """
        if now - self._asked >= CORRECT:
            self._asked = now
            threading.Thread(target=self._ask, args=(self._inlet,), daemon=True).start()

    def _ask(self, inlet: Any) -> None:
        with suppress(RuntimeError):  # lost, or no answer in time: the last offset holds
            self._offset = inlet.time_correction(CORRECT)


def open_lsl(
    address: str, *, robot: Robot | None, parts: Sequence[str] | None, **_: object
) -> Source:
    """Follow a stream in a thread; see `skinmap.live.open_source`."""
    return follow(LslSource(address, robot=robot, parts=parts), parts)


TAKEN = 0.3  # so long a stream of the same name is looked for [s]
DRIFT = 0.1  # of the source's clock [s]


class LslPublisher(Publisher):
    """Outlets "NAME" (samples), "NAME-raw", "NAME-contacts" and "NAME-labels" (JSON).

    Parameters
    ----------
    address : str
        "NAME", or "//any/NAME" for the whole network.
    info : StreamInfo
    topics : sequence of str
    robot : Robot, optional
        Not needed.
    speed : float
        Of the source: samples are stamped as far apart as they come.

    Raises
    ------
    OutputError
        Another stream has that name.
    """

    def __init__(
        self,
        address: str,
        info: StreamInfo,
        topics: Sequence[Topic],
        robot: Robot | None = None,
        speed: float = 1.0,
    ) -> None:
        super().__init__(played(info, speed), topics)
        self._scope, self.name = split_scope(address)
        self._lsl = load_lsl(self._scope)
        self._times = OurTimes(self._lsl.local_clock, speed, DRIFT)
        for found in self._lsl.resolve_byprop("name", self.name, 1, TAKEN):
            raise OutputError(
                f"an LSL stream named {self.name!r} is there already: "
                f"{found.uid()} on {found.hostname()}; choose another name"
            )
        self._outlets: dict[Topic, Any] = {topic: self._open(topic) for topic in self.topics}

    def wait_for_followers(self, timeout: float) -> bool:
        """Whether a listener connects within a time [s]."""
        return bool(self._outlets[self.info.kind].wait_for_consumers(timeout))

    def _open(self, topic: Topic) -> Any:
        lsl, text = self._lsl, topic in ("contacts", "labels")
        name = self.name if topic == self.info.kind else f"{self.name}-{topic}"
        print_ = repr((name, self.info.robot, self.info.parts, self.info.widths, topic))
        found = lsl.StreamInfo(
            name,
            TEXT_TYPE if text else TYPE,
            1 if text else self.info.channels,
            0.0 if text else self.info.rate,
            "string" if text else "float32",
            # The same after a restart, so that followers find it again.
            hashlib.sha256(print_.encode()).hexdigest()[:16],
        )
        describe(found.desc(), self.info)
        outlet = lsl.StreamOutlet(found, max_buffered=BUFFERED)
        if not self._scope:
            ports = _ports(outlet.get_info().as_xml())
            if not keep_on_loopback(ports):
                warn(
                    f"LSL listens on ports {sorted(ports)} of all addresses of this machine",
                    above=3,
                )
        return outlet

    def _send_samples(self, topic: Topic, times: FloatArray, values: NDArray[Any]) -> None:
        if topic not in self._outlets:
            self._outlets[topic] = self._open(topic)
        stamps = self._times.stamps(topic, times)
        rows = np.ascontiguousarray(values, np.float32)
        self._outlets[topic].push_chunk(rows, stamps.tolist())

    def _send_text(self, topic: Topic, time: float, text: str) -> None:
        stamp = float(self._times.stamps(topic, np.array([time]))[0])
        self._outlets[topic].push_sample([text], stamp)

    def close(self) -> None:
        """Take the streams away; may be called twice."""
        self._outlets.clear()


def _ports(xml: str) -> set[int]:
    """Ports that a stream is served on."""
    from lxml import etree

    root = etree.fromstring(xml.encode())
    return {int(root.findtext(f"v4{one}_port") or 0) for one in ("data", "service")} - {0}
