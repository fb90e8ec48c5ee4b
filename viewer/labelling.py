"""`skinmap label --web`: a page that steps through the touches of a recording and changes them."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import click
import numpy as np

from skinmap.errors import SkinError
from skinmap.io.recordings.marks import MarkEditor, Marks
from skinmap.io.recordings.recorded_stream import MarkedTouch, RecordedStream
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.web.files import page_files
from viewer.web.guard import LOOPBACK, Guard, Refusal, new_token, page_headers

LARGEST = 4096  # bytes of a request: a key and a word
POINTS = 600  # of the course of the load
PAGE = "labelling_page"


def label_in_page(marks: Marks, track: RecordedStream, robot: Robot, name: str) -> Marks:
    """Serve the page until `write` is pressed there; its address is told on stderr.

    Raises
    ------
    UsageError
        Ctrl-C, or the page's `end`: nothing is written.
    """
    with LabelServer(marks, track, robot, name) as server:
        click.echo(server.url, err=True)
        try:
            server.done.wait()
        except KeyboardInterrupt:
            raise click.UsageError("ended by Ctrl-C: nothing was written") from None
        if not server.written:
            raise click.UsageError("ended in the page: nothing was written")
        return server.editor.marks


class LabelServer:
    """The page on a port of this machine, with a token in its address.

    Attributes
    ----------
    url : str
    editor : MarkEditor
    done : threading.Event
        Set by `write` and `end`.
    written : bool
        Whether it was `write`.
    """

    def __init__(self, marks: Marks, track: RecordedStream, robot: Robot, name: str) -> None:
        self.editor, self._track, self._name = MarkEditor(marks, track), track, name
        self._skins = {part: PreparedSkin(robot.skin(part)) for part in track.parts}
        self.done, self.written = threading.Event(), False
        self._lock = threading.Lock()
        self._http = ThreadingHTTPServer((LOOPBACK, 0), _handler(self))
        self.guard = Guard(LOOPBACK, self._http.server_port, new_token())
        self.url = f"http://{LOOPBACK}:{self._http.server_port}/{self.guard.token}/"
        self._thread = threading.Thread(target=self._http.serve_forever, daemon=True)

    def __enter__(self) -> LabelServer:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._http.shutdown()
        self._http.server_close()
        self._thread.join()

    def press(self, key: str, rest: str) -> dict[str, Any]:
        """Do what the page asks for; the state after it, with what could not be done."""
        with self._lock:
            error = ""
            if key in ("w", "q"):
                self.written = key == "w"
                self.done.set()
            elif key != "look":
                try:
                    self.editor.press(key, rest)
                except (SkinError, ValueError) as fault:
                    error = str(fault)
            return self._state() | {"error": error}

    def _state(self) -> dict[str, Any]:
        times, marks = self._track.times, self.editor.marks
        step = max(1, len(times) // POINTS)
        return {
            "name": self._name,
            "place": self.editor.place,
            "shown": self.editor.shown(),
            "span_s": [float(times[0]), float(times[-1])] if len(times) else [0.0, 1.0],
            "loads": [float(x) for x in self.editor.loads[::step]],
            "touches": [
                [one.part, float(times[one.first]), float(times[one.last]), one.label]
                for one in marks.touches
            ],
            "picture": self._picture(marks.touches[self.editor.place]) if len(marks) else None,
        }

    def _picture(self, touch: MarkedTouch) -> dict[str, Any]:
        """Taxels on the flat map, and by how much each left its rest at most."""
        skin = self._skins[touch.part]
        values = self._values(touch.part, slice(touch.first, touch.last + 1))
        rest = np.median(self._values(touch.part, slice(POINTS)), axis=0)
        peak = np.abs(values - rest).max(axis=0)
        return {
            "uv": np.round(1e3 * skin.flat.uv, 2).tolist(),
            "peak": np.round(peak / max(float(peak.max()), 1.0), 3).tolist(),
        }

    def _values(self, part: str, rows: slice) -> np.ndarray:
        """Samples (k, n) of a part, for each of its taxels."""
        values = np.asarray(self._track.values[rows][:, self._track.columns(part)], np.float64)
        skin = self._skins[part]
        return values if values.shape[1] == len(skin) else values[:, skin.skin.channels]


def _handler(server: LabelServer) -> Callable[..., BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self._reply(None)

        def do_POST(self) -> None:
            length = self.headers.get("Content-Length", "")
            # Read whoever sends it: a browser that is cut off while it sends sees no answer.
            known = length.isdecimal() and len(length) < 10
            self._reply(self.rfile.read(min(int(length), LARGEST) if known else 0))

        def _reply(self, body: bytes | None) -> None:
            """Answer what was asked for: a file of the page, or with a body the press of a key."""
            names = ("Host", "Origin", "Upgrade")
            headers = {name: self.headers.get_all(name, []) for name in names}
            asked = server.guard.check(self.path, headers)
            if isinstance(asked, Refusal):
                self._answer(asked.status, "text/plain", f"{asked.reason}\n".encode())
            elif body is None and asked in page_files(PAGE):
                self._answer(HTTPStatus.OK, *page_files(PAGE)[asked])
            elif body is not None and asked == "press":
                self._press(body)
            else:
                self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"nothing here\n")

        def _press(self, body: bytes) -> None:
            try:
                request = json.loads(body)
                key, rest = str(request["key"]), str(request.get("rest", ""))
            except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
                self._answer(HTTPStatus.BAD_REQUEST, "text/plain", b"not a key and a word\n")
                return
            state = json.dumps(server.press(key, rest)).encode()
            self._answer(HTTPStatus.OK, "application/json", state)

        def _answer(self, status: HTTPStatus, kind: str, content: bytes) -> None:
            self.send_response(status)
            for key, value in page_headers(self.headers.get("Host", "")).items():
                self.send_header(key, value)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: object) -> None:
            """Nothing: the address holds the token."""

    return Handler
