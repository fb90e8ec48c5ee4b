"""Who is let in: checks of Host, Origin and token, one by one."""

from __future__ import annotations

import pytest

from viewer.web.guard import Guard, Refusal, is_loopback, new_token, page_headers

GUARD = Guard("127.0.0.1", 8080, "secret")
WIDE = Guard("0.0.0.0", 8080, "secret")
OURS = "127.0.0.1:8080"


def ask(path: str, guard: Guard = GUARD, **headers: str) -> Refusal | str:
    given = {"Host": OURS, **headers}
    return guard.check(path, {name: [value] for name, value in given.items() if value})


@pytest.mark.parametrize("host", [OURS, "localhost:8080", "LOCALHOST:8080", "[::1]:8080"])
def test_check_lets_this_machine_in(host):
    assert ask("/secret/main.js", Host=host) == "main.js"
    assert ask("/secret/", Host=host, Origin=f"http://{host}") == ""


def test_check_ignores_the_query():
    assert ask("/secret/main.js?token=x/../y") == "main.js"
    assert ask("/secret?live") == "", "the address without its last slash, as fuzzing asked for it"
    assert isinstance(ask("/?/secret/"), Refusal)
    assert isinstance(ask("/x/secret/"), Refusal)


@pytest.mark.parametrize(
    "host",
    [
        "", "evil.example", "evil.example:8080", "127.0.0.1", "127.0.0.1:81", "127.0.0.1.evil:8080",
        "user@127.0.0.1:8080", "127.0.0.1:8080/x", "127.0.0.1:notaport", "192.168.0.7:8080", "[::1",
    ],
)  # fmt: skip
def test_check_refuses_other_hosts(host):
    refused = ask("/secret/", Host=host)
    assert isinstance(refused, Refusal)
    assert refused.status == 403
    assert "host name" in refused.reason


def test_check_refuses_two_hosts():
    refused = GUARD.check("/secret/", {"Host": [OURS, "evil.example"]})
    assert isinstance(refused, Refusal)


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", f"https://{OURS}", "http://127.0.0.1:81", "http://127.0.0.1"],
)
def test_check_refuses_other_origins(origin):
    for headers in ({}, {"Upgrade": "websocket"}):
        refused = ask("/secret/live", Origin=origin, **headers)
        assert isinstance(refused, Refusal)
        assert refused.status == 403
        assert "other pages" in refused.reason


def test_check_refuses_a_websocket_without_origin():
    assert isinstance(ask("/secret/live", Upgrade="websocket"), Refusal)
    assert ask("/secret/live", Upgrade="websocket", Origin=f"http://{OURS}") == "live"


@pytest.mark.parametrize(
    "path",
    [
        "/", "", "/secre/", "/secrets/", "/Secret/", "/live", "//secret/", "/%73ecret/", "*",
        "secret/", "secret/live", "secret", "http://127.0.0.1:8080/secret/",
    ],
)  # fmt: skip
def test_check_refuses_a_wrong_token(path):
    for upgrade in ({}, {"Upgrade": "websocket", "Origin": f"http://{OURS}"}):
        refused = ask(path, **upgrade)
        assert isinstance(refused, Refusal)
        assert refused.status == 403
        assert "token" in refused.reason


def test_check_keeps_files_and_the_socket_apart():
    for path, headers in (
        ("/secret/live", {}),
        ("/secret/main.js", {"Upgrade": "websocket", "Origin": f"http://{OURS}"}),
    ):
        refused = ask(path, **headers)
        assert isinstance(refused, Refusal)
        assert refused.status == 404


def test_check_of_a_wide_address_takes_addresses_but_no_strange_names():
    assert ask("/secret/", WIDE, Host="192.168.0.7:8080") == ""
    assert isinstance(ask("/secret/", WIDE, Host="evil.example:8080"), Refusal)
    assert isinstance(ask("/secre/", WIDE, Host="192.168.0.7:8080"), Refusal)


def test_is_loopback_knows_this_machine():
    assert all(map(is_loopback, ("127.0.0.1", "127.8.8.8", "::1", "[::1]", "localhost")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "192.168.0.7", "evil.example", "")))


def test_new_token_differs_and_is_long():
    tokens = {new_token() for _ in range(100)}
    assert len(tokens) == 100
    assert min(map(len, tokens)) >= 32  # 24 bytes, six bits a letter


def test_page_headers_allow_nothing_from_elsewhere():
    policy = page_headers(OURS)["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert f"connect-src 'self' ws://{OURS}" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
