"""What pages are told and what they may ask for: each gets the newest sample when it is ready."""

from __future__ import annotations

import asyncio
import base64
import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skinmap.errors import SkinError, check_known
from skinmap.live.contacts.named_touch import Moment
from viewer.drawing.touches.traces import PLOT_KINDS
from viewer.drawing.touches.traces import SPANS as PLOTTED
from viewer.interaction.pointing import describe
from viewer.layers import Layer, Layers, check_layer, check_values
from viewer.playing.player import Player
from viewer.results import LAYERS
from viewer.scene import make_plot
from viewer.web.sample import SampleWriter, layer_message
from viewer.web.scene_data import WebScene, finite

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection

AHEAD = 2  # samples on their way to a page that it has not drawn yet
UNFIT = ("short", "long", "refused")  # counts of samples that do not fit the skin
SPANS = 0.5  # between two letters with the touches on the time line, at least [s]
SPANS_A_SECOND = 4000.0  # that are told of at most
PLOTS, POINTS = 0.1, 250  # between two letters with a plot [s], and its times at most
WAIT = 0.1  # how long the player is waited for before it is asked for its state [s]


class PlotWish(NamedTuple):
    """What a page plots: taxels of a part, or a course of the touches, over so many seconds."""

    plot: str
    part: str
    taxels: tuple[int, ...]
    seconds: float


@dataclass(eq=False, slots=True)
class Client:
    """One page.

    Attributes
    ----------
    layer : str
        What it shows.
    wanted : str
        What it asked for last; a layer that is still being made comes later.
    asked : dict of str to (str, int)
        Part and taxel that it asked about last, by the kind of its question.
    sent, drawn : int
        Samples sent to it, and drawn by it.
    told : int
        Number of the newest sample it was sent.
    wake : asyncio.Event
        There is something to send.
    making : asyncio.Task or None
        Makes the layer that is wanted: one at a time, however often a page asks.
    letters : dict of str to str
        Messages that wait, the newest of each kind: a page that asks and never reads fills nothing.
    plot, plotted : PlotWish, and with the number of its sample
        What it plots, and what it was told of that last.
    """

    layer: str
    wanted: str = ""
    asked: dict[str, tuple[str, int]] = field(default_factory=dict)
    sent: int = 0
    drawn: int = 0
    told: int = -1
    wake: asyncio.Event = field(default_factory=asyncio.Event)
    letters: dict[str, str] = field(default_factory=dict)
    plot: PlotWish | None = None
    plotted: tuple[PlotWish, int] | None = None
    making: asyncio.Task[None] | None = None

    def tell(self, message: dict[str, Any]) -> None:
        """Send a message that is no sample soon; it takes the place of one of its kind."""
        self.letters.pop(message["kind"], None)  # the newest goes last
        self.letters[message["kind"]] = json.dumps(message, separators=(",", ":"))
        self.wake.set()


class Hub:
    """Between a player and the pages.

    Parameters
    ----------
    scene : WebScene
    player : Player
    layers : Layers
    first : mapping
        Layer, style and saved view that a page shows first, and its heading where it has another.
    waits : bool
        The player is paused until the first page comes.

    Attributes
    ----------
    error : Exception or None
        Why nothing new is shown any more, where that is not the source's fault.
    mate : Hub or None
        Of the pages beside these: what differs from them changes with theirs.
    """

    def __init__(
        self,
        scene: WebScene,
        player: Player,
        layers: Layers,
        first: Mapping[str, Any],
        *,
        waits: bool = False,
    ) -> None:
        self.scene, self.player, self.layers = scene, player, layers
        self.first = first
        self.clients: set[Client] = set()
        self.error: Exception | None = None
        self.mate: Hub | None = None
        self.samples_sent = 0
        self.samples_written = 0  # one is written for all pages that show the same layer
        self.seconds = 0.0  # CPU time spent writing them
        self._writer = SampleWriter(scene, layers)
        self._moment: Moment | None = None
        self._number = 0
        self._state: dict[str, Any] = {}
        self._waits = self._halts = waits
        self._told_spans, self._next_spans, self._next_plots = -1, 0.0, 0.0
        self._structures: asyncio.Task[Layer] | None = None  # that finds them
        self._written: dict[str, bytes] = {}  # samples of now, by layer
        self._wishes: dict[str, Callable[[Client, dict[str, Any]], None]] = {
            "drawn": self._drawn,
            "layer": self._ask_layer,
            "pick": self._pick,
            "point": self._pick,
            "play": lambda _, wish: self.player.play(),
            "pause": lambda _, wish: self.player.pause(),
            "step": self._step,
            "seek": self._seek,
            "speed": lambda _, wish: setattr(self.player, "speed", _number(wish["to"])),
            "plot": self._plot,
            "loop": lambda _, wish: setattr(self.player, "loop", bool(wish.get("to"))),
            "zero": lambda _, wish: self.player.zero(),
        }

    async def watch(self) -> None:
        """Take each new moment from the player and wake the pages, until cancelled or failed."""
        try:
            await self._watch()
        except Exception as error:  # noqa: BLE001 - a plug-in's, or of an odd moment: pages tell it
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        """Tell all pages that nothing new will be shown, and why."""
        self.error = self.error or error
        self._tell_state()

    async def _watch(self) -> None:
        number = -1
        while self.error is None:
            changed = await asyncio.to_thread(self.player.wait, number, WAIT)
            number = self.player.number
            moment = self.player.take()
            if moment is not None:
                self._see(moment)
            if changed or moment is not None:
                self._number += 1
                self._written.clear()
            self._tell_state()
            self._tell_spans()
            self._tell_plots()
            if changed:
                for client in self.clients:
                    client.wake.set()
                if self.mate is not None:
                    self.mate.renew()

    def renew(self) -> None:
        """Send the difference anew to pages that show it: the other side changed."""
        self._written.pop("difference", None)
        for client in self.clients:
            if client.layer == "difference":
                client.told = -1
                client.wake.set()

    def _see(self, moment: Moment) -> None:
        """Take a moment; one of another skin is told of, and what was shown before stays."""
        try:
            for part, skin in self.scene.skins.items():
                if part in moment.pressures:
                    check_values(moment.pressures[part], len(skin), part)
            self.layers.observe(moment)
        except SkinError as error:
            self._tell({"kind": "problem", "text": str(error)})
        else:
            self._moment = moment

    def _tell(self, message: dict[str, Any]) -> None:
        """Send a letter to every page."""
        for client in self.clients:
            client.tell(message)

    async def talk(self, connection: ServerConnection) -> None:
        """Serve one page until it goes."""
        client = Client(self.first["layer"])
        about = {"layers": list(LAYERS), "scene": self.scene.name, **self.first}
        client.tell({"kind": "hello", **about})
        client.tell(layer_message(self.layers.get(client.layer)))
        client.tell({"kind": "state", **self.state()})
        client.tell(self._spans())
        self.clients.add(client)
        if self._waits:  # a recording begins when there is somebody to see it
            self._waits = False
            self.player.play()
        tasks = [
            asyncio.create_task(self._send(connection, client)),
            asyncio.create_task(self._listen(connection, client)),
        ]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            self.clients.discard(client)
            if self._halts and not self.clients and not self.player.paused:
                self._waits = True  # nobody looks: what can wait does
                self.player.pause()
            if client.making is not None:
                tasks.append(client.making)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _listen(self, connection: ServerConnection, client: Client) -> None:
        async for text in connection:
            self._obey(client, text)

    async def _send(self, connection: ServerConnection, client: Client) -> None:
        while True:
            await client.wake.wait()
            client.wake.clear()
            while client.letters:
                await connection.send(client.letters.pop(next(iter(client.letters))))
            # A slow page gets fewer samples, never old ones: what waits is written when it is sent.
            if client.told != self._number and client.sent - client.drawn < AHEAD:
                client.told = self._number
                try:
                    message = self._sample(client.layer)
                except Exception as error:  # noqa: BLE001 - pages tell it
                    self._fail(error)
                    continue
                client.sent += 1
                self.samples_sent += 1
                await connection.send(message)

    def _sample(self, layer: str) -> bytes:
        if layer not in self._written:
            started = time.thread_time()
            about = {"number": self._number, **self.state()}
            shown = self.layers.get(layer)
            made = self._writer.write(self._moment, shown, about)
            self._written[layer] = made
            self.samples_written += 1
            self.seconds += time.thread_time() - started
        return self._written[layer]

    def state(self) -> dict[str, Any]:
        """Where the player stands."""
        player, counts = self.player, self.player.totals()
        return {
            "paused": player.paused,
            "seekable": player.seekable,
            "position": finite(player.position),
            "span": [finite(time) for time in player.span],
            "duration": finite(player.duration),
            "speed": player.speed,
            "loop": bool(player.loop),
            "zero_minutes": None if player.zero_age is None else int(player.zero_age // 60),
            "ended": player.ended,
            "error": self.failure(),
            "unfit": sum(counts.get(name, 0) for name in UNFIT),
        }

    def failure(self) -> str | None:
        """The source or the viewer, whichever ended before its time, and why."""
        for name, error in (("source", self.player.error), ("viewer", self.error)):
            if error is not None:
                why = " ".join(str(error).split()) or type(error).__name__
                return f"the {name} failed: {why}"
        return None

    def _tell_state(self) -> None:
        """Tell all pages when the player stands differently than they know, not at each sample."""
        state = self.state()
        still: dict[str, Any] = {"position": None, "span": None}
        if {**state, **still} != {**self._state, **still}:
            self._state = state
            self._tell({"kind": "state", **state})

    def _tell_spans(self) -> None:
        """Tell all pages of the touches on the time line, where there are others, not too often."""
        version, now = self.player.timeline.version, time.monotonic()
        if version != self._told_spans and self.clients and now >= self._next_spans:
            message = self._spans()
            # Many touches are many bytes: they come more rarely.
            self._told_spans = version
            self._next_spans = now + SPANS + len(message["spans"]) / SPANS_A_SECOND
            self._tell(message)

    def _spans(self) -> dict[str, Any]:
        """All touches on the time line, and the parts that have a lane."""
        moment = self.player.moment
        there = () if moment is None else moment.pressures
        parts = [part for part in self.scene.skins if part in there]
        return {"kind": "spans", "spans": self.player.spans(), "parts": parts}

    def _tell_plots(self) -> None:
        """Tell each page what it plots, up to what is shown, not too often."""
        wishes = [client.plot for client in self.clients if client.plot is not None]
        self.player.remember(max((one.seconds for one in wishes), default=0.0))
        if self._moment is None or not wishes or time.monotonic() < self._next_plots:
            return
        self._next_plots = time.monotonic() + PLOTS
        for client in self.clients:
            wish = client.plot
            if wish is None or client.plotted == (wish, self._number):
                continue
            client.plotted = (wish, self._number)
            chosen = {wish.part: np.array(wish.taxels)} if wish.taxels else {}
            made = make_plot(
                self.player, self._moment.time, wish.seconds, wish.plot, chosen, wish.part,
                self.layers,
            )  # fmt: skip
            client.tell({"kind": "plot", **made.to_json(POINTS)})

    def _plot(self, client: Client, wish: dict[str, Any]) -> None:
        """Plot something else from now on, or nothing."""
        if wish["plot"] is None:
            client.plot = None
            return
        plot, part = str(wish["plot"]), str(wish["part"])
        bits = np.frombuffer(base64.b64decode(str(wish["taxels"]), validate=True), np.uint8)
        taxels = tuple(np.flatnonzero(np.unpackbits(bits, bitorder="little")).tolist())
        check_known("plot", [plot], PLOT_KINDS)
        if plot == "taxels" or taxels:
            skin = self.scene.skins[part]
            if not taxels or taxels[-1] >= len(skin):
                raise ValueError("taxels that are not there")
        seconds = min(max(_number(wish["seconds"]), PLOTTED[0]), PLOTTED[-1])
        client.plot = PlotWish(plot, part, taxels, seconds)
        self._next_plots = 0.0

    def _obey(self, client: Client, text: str | bytes) -> None:
        """Do what a page asks for; what makes no sense is answered with a line and forgotten."""
        try:
            wish = json.loads(text)
            self._wishes[wish["do"]](client, wish)
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
            client.tell({"kind": "problem", "text": "the page asked for something unknown"})
        except SkinError as error:
            client.tell({"kind": "problem", "text": str(error)})

    def _pick(self, client: Client, wish: dict[str, Any]) -> None:
        self._describe(client, wish["do"], str(wish["part"]), int(wish["taxel"]))

    def _ask_layer(self, client: Client, wish: dict[str, Any]) -> None:
        """Show another layer as soon as it is made: structures take a second, samples go on."""
        client.wanted = check_layer(str(wish["to"]))
        if client.making is None or client.making.done():
            client.making = asyncio.create_task(self._turn(client))

    async def _turn(self, client: Client) -> None:
        """Make what a page wants, until nothing else was asked for meanwhile."""
        made: Layer | None = None
        while made is None or made.name != client.wanted:
            try:
                made = await asyncio.to_thread(self.layers.get, client.wanted)
            except Exception as error:  # noqa: BLE001 - the layer shown before stays
                client.tell({"kind": "problem", "text": f"no layer {client.wanted}: {error}"})
                return
        client.layer = made.name
        client.tell(layer_message(made))
        client.told = -1

    def _drawn(self, client: Client, wish: dict[str, Any]) -> None:
        client.drawn = min(client.sent, max(client.drawn, int(wish["samples"])))
        client.wake.set()

    def _describe(self, client: Client, kind: str, part: str, taxel: int) -> None:
        """Tell of a taxel that was picked or is pointed at."""
        if self._structures is None:
            # In a thread, as they take a second: samples go on, and who asked is answered again.
            self._structures = asyncio.create_task(asyncio.to_thread(self.layers.get, "structures"))
            self._structures.add_done_callback(lambda _: self._answer_again())
        about = describe(
            self.layers, part, taxel, self._moment,
            shown=client.layer, structure=self._structures.done(),
        )  # fmt: skip
        client.asked[kind] = (part, taxel)
        client.tell({"kind": kind, **about})

    def _answer_again(self) -> None:
        """Structures are known now."""
        for client in self.clients:
            for kind, (part, taxel) in client.asked.items():
                self._describe(client, kind, part, taxel)

    def _step(self, client: Client, wish: dict[str, Any]) -> None:
        if not self.player.step(max(-100, min(100, int(wish["by"])))):
            client.tell({"kind": "notice", "text": "no further sample that way"})

    def _seek(self, client: Client, wish: dict[str, Any]) -> None:
        if not self.player.seek(_number(wish["to"])):
            client.tell({"kind": "notice", "text": "nothing is remembered yet"})


def _number(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError("not a number")
    return number
