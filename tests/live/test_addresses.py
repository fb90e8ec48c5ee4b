from __future__ import annotations

import warnings

import pytest

from skinmap.errors import InvalidArrayError, SkinWarning
from skinmap.live.network.network_messages import Address, parse_address, warn_if_open


@pytest.mark.parametrize(
    ("text", "address", "endpoint", "here"),
    [
        ("5555", Address("127.0.0.1", 5555), "tcp://127.0.0.1:5555", True),
        ("localhost:1", Address("localhost", 1), "tcp://localhost:1", True),
        ("[::1]:65535", Address("::1", 65535), "tcp://[::1]:65535", True),
        ("127.9.0.3:80", Address("127.9.0.3", 80), "tcp://127.9.0.3:80", True),
        ("*:5555", Address("*", 5555), "tcp://*:5555", False),
        ("robot.local:5555", Address("robot.local", 5555), "tcp://robot.local:5555", False),
        ("10.0.0.7:5555", Address("10.0.0.7", 5555), "tcp://10.0.0.7:5555", False),
        ("0.0.0.0:5555", Address("0.0.0.0", 5555), "tcp://0.0.0.0:5555", False),
    ],
)
def test_addresses_stay_here_unless_another_is_named(text, address, endpoint, here):
    found = parse_address(text)
    assert (found, found.endpoint, found.is_here) == (address, endpoint, here)


@pytest.mark.parametrize(
    "text", ["", "abc", "0", "65536", "-1", "1.5", "a:b", "host:", "²", "a/b:5", "a b:5", "x;y:5"]
)
def test_what_is_no_address_is_refused(text):
    with pytest.raises(InvalidArrayError, match="is not an address; expected PORT or HOST:PORT"):
        parse_address(text)


def test_an_address_elsewhere_is_warned_of():
    with pytest.warns(SkinWarning, match=r"reading from 10\.0\.0\.7:5555: not protected"):
        warn_if_open(Address("10.0.0.7", 5555), "reading from")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_if_open(Address("127.0.0.1", 5555), "reading from")
