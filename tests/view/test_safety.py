"""Who reaches the server, who does not, and what it lets a page do."""

from __future__ import annotations

import asyncio
import re
import socket
import subprocess
import sys
from pathlib import Path

import aiohttp
import pytest

from tests.conftest import PATIENCE_S

INSOLE = Path(sys.executable).with_name("insole")
PAGE = Path(__file__).parents[2] / "insole_daemon" / "view" / "page"


def fetch(url, **options):
    """(status, headers, body) of one answer, redirects not followed."""

    async def ask():
        async with aiohttp.ClientSession() as session, session.get(url, allow_redirects=False, **options) as answer:
            return answer.status, answer.headers, await answer.text()

    return asyncio.run(ask())


def first_word(url, origin, **options):
    """The first message of the WebSocket, or the status it was refused with."""

    async def ask():
        headers = {} if origin is None else {"Origin": origin}
        async with aiohttp.ClientSession(**options) as session:
            try:
                async with session.ws_connect(f"{url}live", headers=headers) as live:
                    return await live.receive_json(timeout=PATIENCE_S)
            except aiohttp.WSServerHandshakeError as error:
                return error.status

    return asyncio.run(ask())


def test_on_loopback_only_the_servers_own_page_connects(page):
    own = page.rstrip("/")
    assert first_word(page, own)["kind"] == "hello"
    for origin in (None, "null", "http://evil.example", own.replace("http", "https"), f"{own}.evil.example"):
        assert first_word(page, origin) == 403, origin
    port = page.rpartition(":")[2].strip("/")
    assert fetch(page, headers={"Host": f"evil.example:{port}"})[0] == 403, "a name that was pointed at 127.0.0.1"
    assert fetch(page, headers={"Host": f"localhost:{port}"})[0] == 200


def test_it_is_bound_to_loopback(page):
    port = int(page.rpartition(":")[2].strip("/"))
    with socket.socket() as sock:
        sock.bind(("0.0.0.0", 0))
        sock.settimeout(2)
        with pytest.raises(OSError, match=r"refused|unreachable|timed out"):
            sock.connect(("127.0.0.2", port))  # another address of this computer


def test_every_answer_forbids_what_the_page_does_not_need(page):
    for path in ("", "main.js", "nowhere", "live"):
        _, headers, _ = fetch(page + path)
        policy = headers["Content-Security-Policy"]
        assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self';")
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Referrer-Policy"] == "no-referrer"


def test_nothing_inline_and_nothing_from_elsewhere():
    text = (PAGE / "index.html").read_text()
    assert not re.search(r"<style|\son\w+=|\sstyle=|javascript:", text)
    assert re.findall(r"<script[^>]*>([^<]*)", text) == [""]
    for file in PAGE.iterdir():
        text = file.read_text().replace("http://www.w3.org/2000/svg", "")
        assert not re.search(r"https?://|//cdn|innerHTML|eval\(", text), file.name


def test_files_beside_the_page_are_not_served(page):
    for path in ("../server.py", "%2e%2e/server.py", "..%2fserver.py", "/etc/passwd"):
        assert fetch(page + path)[0] in (403, 404), path


def test_beyond_loopback_every_access_needs_the_token(live_daemon, serve):
    url = serve(live_daemon.endpoint, "--listen", "0.0.0.0")
    base, token = re.fullmatch(r"(http://0\.0\.0\.0:\d+/)\?token=([\w-]{32})", url).groups()
    base = base.replace("0.0.0.0", "127.0.0.1")
    own = base.rstrip("/")
    wrong = token[:-1] + ("x" if token[-1] != "x" else "y")
    for path in ("", "main.js", f"?token={wrong}", "?token="):
        status, _, body = fetch(base + path)
        assert status == 403
        assert "token" in body
    assert first_word(base, own) == 403
    status, headers, _ = fetch(f"{base}?token={token}")
    assert (status, headers["Location"]) == (302, "/"), "the token does not stay in the address"
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    name, _, value = cookie.partition(";")[0].partition("=")
    assert fetch(base, cookies={name: value})[0] == 200
    assert first_word(base, own, cookies={name: value})["kind"] == "hello"
    assert first_word(base, "http://evil.example", cookies={name: value}) == 403, "another page, with our cookie"
    assert first_word(base, own, cookies={name: "x"}) == 403


async def _closed_after(url, message):
    async with aiohttp.ClientSession() as session:
        async with session.ws_connect(f"{url}live", headers={"Origin": url.rstrip("/")}) as live:
            await live.send_str(message)
            async for _ in live:  # without an answer the server soon sends nothing more
                pass
            return live.close_code


@pytest.mark.parametrize(
    "message",
    [
        "nonsense",
        "[]",
        '{"number": 1}',
        '{"number": 1, "do": "stop the boards"}',
        '{"number": 1, "do": "zero", "foot": "../left"}',
        '{"number": "1", "do": "mark"}',
        '{"number": 1, "do": "mark", "text": 7}',
        "x" * 5000,
    ],
)
def test_an_unexpected_message_from_a_browser_ends_the_connection(page, message):
    assert asyncio.run(asyncio.wait_for(_closed_after(page, message), 10)) in (1008, 1009)


def test_a_port_in_use_and_a_missing_daemon_are_reported(page, live_daemon):
    port = page.rpartition(":")[2].strip("/")
    for options, words in [
        (["--port", port, "--connect", live_daemon.endpoint], "take another port, such as --port"),
        (["--connect", live_daemon.endpoint, "--rig", "nobody"], "no insole daemon of rig nobody is behind it"),
        (["--connect", live_daemon.endpoint, "--reference", "middle=x"], "expected left=KEY or right=KEY"),
    ]:
        done = subprocess.run([INSOLE, "view", *options], capture_output=True, text=True)
        assert done.returncode in (2, 3)
        assert words in " ".join(done.stderr.split())
        assert "Traceback" not in done.stderr
