"""The server over real sockets: what it answers, and what it does not."""

from __future__ import annotations

import base64
import http.client
import json
import socket
from copy import copy
from pathlib import Path

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from skinmap.errors import InvalidArrayError, SkinWarning, UnknownNameError, UnreachableError
from skinmap.live.contacts.named_touch import Moment
from tests.viewer.unpacking import unpack
from viewer.web.files import page_files, served_files
from viewer.web.guard import LIVE
from viewer.web.server import LARGEST, bind


def next_of(connection, kind: str) -> dict:
    """The next letter of a kind; samples and other letters are passed over."""
    while True:
        message = connection.recv(timeout=20)
        if isinstance(message, str) and json.loads(message)["kind"] == kind:
            return json.loads(message)


def next_sample(connection):
    while True:
        message = connection.recv(timeout=20)
        if isinstance(message, bytes):
            return unpack(message)


def refused(live, **options) -> int:
    with pytest.raises(InvalidStatus) as error, live(**options):
        pass  # pragma: no cover - never reached
    return error.value.response.status_code


def test_every_file_is_served_with_the_token_and_refused_without(server, get):
    for name in [*served_files(), "scene.bin"]:
        status, content, headers = get(f"/{server.guard.token}/{name}")
        assert (status, len(content)) == (200, int(headers["Content-Length"]))
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        for path in (f"/{name}", f"/wrong/{name}", f"/{server.guard.token}x/{name}"):
            status, content, _ = get(path)
            assert status == 403
            assert server.guard.token.encode() not in content


def test_files_name_no_other_host():
    for name, (_, content) in page_files().items():
        text = content.decode().replace("http://www.w3.org/2000/svg", "")  # a name, never fetched
        assert "http://" not in text, name
        assert "https://" not in text, name
        assert "import(" not in text, name


@pytest.mark.parametrize(
    "path", ["../guard.py", "..%2fguard.py", "%2e%2e/guard.py", "./main.js", "x", "/etc/passwd"]
)
def test_paths_outside_the_page_are_not_found(server, get, path):
    assert get(f"/{server.guard.token}/{path}")[0] == 404


def test_other_hosts_and_origins_are_refused(server, get):
    page = f"/{server.guard.token}/"
    assert get(page, Host="evil.example")[0] == 403
    assert get(page, Host=f"evil.example:{server.port}")[0] == 403
    assert get(page, Origin="http://evil.example")[0] == 403
    assert get(page, Origin=f"http://127.0.0.1:{server.port}")[0] == 200


def test_the_websocket_is_refused_to_others(server, live):
    assert refused(live, path=f"/wrong/{LIVE}") == 403
    assert refused(live, path=f"/{LIVE}") == 403
    assert refused(live, origin="http://evil.example") == 403
    assert refused(live, origin=None) == 403
    assert refused(live, path=f"/{server.guard.token}/main.js") == 404


def test_a_page_gets_layer_state_and_sample(live):
    with live() as page:
        hello = next_of(page, "hello")
        assert (hello["layer"], hello["style"]) == ("pressure", "surface")
        assert next_of(page, "layer")["name"] == "pressure"
        assert next_of(page, "state")["paused"] is True
        header, arrays = next_sample(page)
        assert header["kind"] == "sample"
        assert arrays["values"].size > 700


def test_a_page_that_draws_nothing_is_sent_two_samples_only(start):
    from websockets.sync.client import connect

    server = start()
    address = f"ws://127.0.0.1:{server.port}/{server.guard.token}/{LIVE}"
    with connect(address, origin=f"http://127.0.0.1:{server.port}") as page:
        next_sample(page)
        page.send('{"do": "step", "by": 1}')
        next_sample(page)
        number = server.hub.player.number
        page.send('{"do": "step", "by": -1}')
        assert server.hub.player.wait(number, 20)
        page.send('{"do": "nonsense"}')
        next_of(page, "problem")
        assert server.hub.samples_sent == 2
        page.send('{"do": "drawn", "samples": 2}')
        assert next_sample(page)[0]["touches"] == []  # the newest: back at rest


def test_wishes_that_make_no_sense_are_answered_with_one_line(live):
    with live() as page:
        for text, line in (
            ("{", "unknown"),
            ("[]", "unknown"),
            ('{"do": "fly"}', "unknown"),
            ('{"do": "seek", "to": "x"}', "unknown"),
            ('{"do": "seek", "to": 1e999}', "unknown"),
            ('{"do": "pick", "part": "torso"}', "unknown"),
            ('{"do": "layer", "to": "colour"}', "no layer 'colour'"),
            ('{"do": "pick", "part": "tail", "taxel": 1}', "part shown 'tail'"),
        ):
            page.send(text)
            problem = next_of(page, "problem")["text"]
            assert line in problem
            assert "\n" not in problem
        page.send('{"do": "pick", "part": "torso", "taxel": 3}')
        assert next_of(page, "pick")["taxel"] == 3


def test_a_step_past_the_end_is_answered_with_a_notice(start, live):
    server = start()
    player = server.hub.player
    with live(port=server.port, path=f"/{server.guard.token}/{LIVE}") as page:
        next_sample(page)
        for _ in range(2):
            page.send('{"do": "step", "by": 1}')
        for _ in range(200):
            if player.ended:
                break
            player.wait(player.number, 0.1)
        assert player.ended
        page.send('{"do": "step", "by": 1}')
        assert next_of(page, "notice")["text"] == "no further sample that way"


def test_a_page_is_told_what_it_plots_and_of_nonsense_in_a_line(live, moments):
    taxel = int(moments[1].touches[0].taxels[0])
    bits = np.packbits(np.arange(430) == taxel, bitorder="little").tobytes()
    wish = {"do": "plot", "part": "torso", "seconds": 10, "plot": "taxels"}
    wish["taxels"] = base64.b64encode(bits).decode()
    with live() as page:
        page.send(json.dumps(wish))
        plot = next_of(page, "plot")
        assert plot["title"] == "torso, counts by channel"
        assert plot["times"][-1] == 0
        assert len(plot["lines"]) == len(plot["names"]) == 1
        assert len(plot["lines"][0]) == len(plot["times"])
        page.send(json.dumps({**wish, "plot": "probability"}))
        assert next_of(page, "plot")["title"] == "touches: probability, %"
        for wrong in ({"plot": "x"}, {"part": "x"}, {"taxels": "AAAA"}, {"seconds": "x"}):
            page.send(json.dumps({**wish, **wrong}))
            assert next_of(page, "problem")["text"]


def test_a_large_message_ends_the_connection_and_nothing_else(live):
    with live() as page, live() as other:
        page.send("x" * (LARGEST + 1))
        with pytest.raises(ConnectionClosed) as error:
            next_of(page, "never")
        assert error.value.rcvd.code == 1009  # message too big
        other.send('{"do": "fly"}')
        assert next_of(other, "problem")


def test_a_moment_of_another_skin_is_told_and_what_was_shown_stays(start, live, moments):
    alien = Moment(2.0, {"torso": np.zeros(7)})
    server = start(moments=[moments[0], moments[1], alien])
    with live(port=server.port, path=f"/{server.guard.token}/{LIVE}") as page:
        next_sample(page)
        page.send('{"do": "step", "by": 1}')
        next_sample(page)
        page.send('{"do": "drawn", "samples": 2}')
        page.send('{"do": "step", "by": 1}')
        assert "'torso'" in next_of(page, "problem")["text"]
        header, arrays = next_sample(page)
        assert len(header["touches"]) == 1
        assert arrays["values"].max() == 199  # 200 of 255 counts, in 255 colours


def test_more_pages_than_allowed_are_refused_until_one_goes(start, live):
    server = start(clients=1)
    own = {"port": server.port, "path": f"/{server.guard.token}/{LIVE}"}
    with live(**own) as page:
        next_sample(page)
        assert refused(live, **own) == 503
    # The close handshake is over, so the server's handler is about to end: ask until it has.
    for _ in range(100):
        try:
            with live(**own) as page:
                next_sample(page)
            return
        except InvalidStatus:
            continue
    pytest.fail("the place of a page that has gone was never given back")


def test_serve_says_in_one_line_that_the_port_is_taken(start):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UnreachableError, match=f"port {port} of 127.0.0.1 is in use") as error:
            bind("127.0.0.1", port)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("host", "port"), [("192.0.2.1", 0), ("no such host", 0), ("127.0.0.1", 70000)]
)
def test_bind_refuses_addresses_that_are_not_here(host, port):
    with pytest.raises(UnreachableError, match=f"port {port}"):
        bind(host, port)


def test_serve_warns_of_an_address_that_others_reach(start):
    with pytest.warns(SkinWarning, match=r"0\.0\.0\.0 can be reached from other machines"):
        server = start(host="0.0.0.0")
    assert server.url.endswith(f":{server.port}/{server.guard.token}/")


def test_serve_refuses_angles_out_of_range(start, icub):
    joint = next(iter(icub.body.joints))
    with pytest.raises(InvalidArrayError, match=f"joint '{joint}' cannot be at 5672.3 degrees"):
        start(angles={joint: 99.0})


def test_serve_refuses_an_unknown_layer(start):
    with pytest.raises(UnknownNameError, match="layer 'colour'"):
        start(layer="colour")


def test_stop_ends_pages_and_frees_the_port(start, live):
    server = start()
    with live(port=server.port, path=f"/{server.guard.token}/{LIVE}") as page:
        next_sample(page)
        server.stop()
        with pytest.raises(ConnectionClosed):
            next_of(page, "never")
    server.stop()
    assert server.wait(0)
    bind("127.0.0.1", server.port).close()


def test_slow_readers_of_the_scene_share_one_copy(start):
    server = start()
    # So large that the system's own buffers hold a part of it only.
    server.hub.scene = copy(server.hub.scene)
    server.hub.scene.packed = bytes(12_000_000)
    host, path = f"127.0.0.1:{server.port}", f"/{server.guard.token}/scene.bin"
    request = f"GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()

    def resident() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6  # [MB]

    before, readers = resident(), []
    try:
        for _ in range(30):
            one = socket.create_connection(("127.0.0.1", server.port), timeout=10)
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            one.sendall(request)
            readers.append(one)
        # Who comes then gets all of it, while the others have not read theirs.
        late = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
        late.request("GET", path)
        assert late.getresponse().read() == server.hub.scene.packed
        late.close()
        whole = 30 * len(server.hub.scene.packed) / 1e6
        assert resident() - before < 0.4 * whole
    finally:
        for one in readers:
            one.close()
