"""What waits for a page: never more than one message of each kind."""

from __future__ import annotations

import json

import pytest

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


def states(page):
    """What a page is told of the player, from now on."""
    while True:
        message = page.recv(timeout=20)
        if isinstance(message, str) and (told := json.loads(message))["kind"] == "state":
            yield told


def broken(*_, **__):
    raise TypeError("an odd\nmoment")


@pytest.mark.parametrize("where", ["layers.observe", "_writer.write"])
def test_page_is_told_why_nothing_new_comes(start, live, monkeypatch, where):
    """A plug-in's error or an odd moment: the page stands still, and does so in words."""
    server = start()
    with live(port=server.port, path=f"/{server.guard.token}/{LIVE}") as page:
        owner, _, name = where.partition(".")
        monkeypatch.setattr(getattr(server.hub, owner), name, broken)
        server.hub.player.step(1)
        told = next(state for state in states(page) if state["error"] is not None)
        assert told["error"] == "the viewer failed: an odd moment"
    with live(port=server.port, path=f"/{server.guard.token}/{LIVE}") as later:
        assert next(states(later))["error"] == told["error"]
    assert isinstance(server.hub.error, TypeError)


def test_layer_that_cannot_be_made_is_told_and_the_one_before_stays(start, live, monkeypatch):
    server = start()
    with live(port=server.port, path=f"/{server.guard.token}/{LIVE}") as page:
        monkeypatch.setattr(server.hub.layers, "_structures", broken)
        page.send('{"do": "layer", "to": "structures"}')
        while True:
            message = page.recv(timeout=20)
            if isinstance(message, str) and (told := json.loads(message))["kind"] == "problem":
                break
        assert told["text"].startswith("no layer structures: an odd")
        assert [client.layer for client in server.hub.clients] == ["pressure"]
