"""What waits for a page: never more than one message of each kind."""

from __future__ import annotations

import json

from viewer.web.guard import LIVE
from viewer.web.hub import Client


def test_tell_keeps_the_newest_of_each_kind_in_the_order_of_telling():
    client = Client("pressure")
    for number in range(1000):
        client.tell({"kind": "problem", "text": str(number)})
        client.tell({"kind": "state", "position": number})
    client.tell({"kind": "problem", "text": "last"})
    assert [json.loads(text) for text in client.letters.values()] == [
        {"kind": "state", "position": 999},
        {"kind": "problem", "text": "last"},
    ]


def test_a_page_that_asks_and_does_not_read_is_answered_when_it_does(start, live):
    server = start()
    with live(port=server.port, path=f"/{server.guard.token}/{LIVE}") as page:
        for _ in range(2000):
            page.send('{"do": "fly"}')
        page.send('{"do": "pick", "part": "torso", "taxel": 3}')
        (client,) = server.hub.clients
        while True:
            assert len(client.letters) <= 5  # hello, layer, state, problem, pick
            message = page.recv(timeout=20)
            if isinstance(message, str) and json.loads(message)["kind"] == "pick":
                return
