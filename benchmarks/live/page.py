"""Frame rate and latency of the web page in a real browser, its cost for the daemon, and a slow link.

    python -m benchmarks.live.page                    # all of it, some five minutes
    python -m benchmarks.live.page --seconds 60 page  # or one of: page, viewers, slow

Both feet walk on a bus (feeder.py) before the daemon (ours.py), `insole view` runs beside it. `page`: headless Chromium
draws with the CPU, on the same machine as everything else, which is more work than on a person's; the page itself
counts. Published to painted is from the daemon's put until the browser is done with the frame that shows it.
`viewers`: the daemon's latency with five browsers' connections, with none, and without `insole view`, in turn; the
daemon has one CPU, all else the other.
`slow`: one connection through a proxy that carries 20 kB/s, beside one without.

Takes about 5 minutes, and needs chromium.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import shutil
import socket
import statistics
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import aiohttp
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from benchmarks.lib import process
from benchmarks.lib.process import Child

INSOLE = Path(sys.executable).with_name("insole")
WARM_UP_S = 3.0
SLOW_BYTES_S = 20_000
ROUNDS, ROUND_S = 5, 10.0
_COUNTERS = """const {frames, cycles, missing, painted, ready} = window.insole.own;
return {frames, cycles, missing, painted, ready, now: performance.now()}"""


def free_port() -> int:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


@contextmanager
def serving(endpoint: str) -> Iterator[str]:
    """`insole view` of the daemon at `endpoint`; its address."""
    served = subprocess.Popen(
        [INSOLE, "view", "--port", str(free_port()), "--connect", endpoint], stderr=subprocess.PIPE, text=True
    )
    assert served.stderr is not None
    line = served.stderr.readline()
    if "the page is on" not in line:
        raise SystemExit(line + served.stderr.read())
    try:
        yield line.split("the page is on ")[1].split()[0]
    finally:
        served.terminate()
        served.wait(10)
        served.stderr.close()


@contextmanager
def daemon(seconds: float, seed: int = 0) -> Iterator[tuple[Child, str]]:
    """The daemon at full load for that long after its warm-up, and its endpoint."""
    own, other = process.cpus()
    with Child("lib.timed_daemon", bus="udp", seconds=seconds, warm_up=WARM_UP_S, cpu=own) as measured:
        ready = measured.report()
        with Child("lib.feeder", to=ready["feeds"][0], seconds=WARM_UP_S + seconds + 30, seed=seed, cpu=other):
            yield measured, ready["endpoint"]


def browser() -> webdriver.Chrome:
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for flag in (
        "--headless=new",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--window-size=1400,900",
    ):
        options.add_argument(flag)
    if os.geteuid() == 0:
        options.add_argument("--no-sandbox")
    return webdriver.Chrome(options, Service(shutil.which("chromedriver")))


def page(seconds: float) -> None:
    """One person looks."""
    with daemon(seconds + 20) as (_, endpoint), serving(endpoint) as url, ExitStack() as ending:
        driver = browser()
        ending.callback(driver.quit)
        driver.get("about:blank")
        driver.get(url)
        time.sleep(WARM_UP_S)
        before = driver.execute_script(f"window.insole.own.painted.length = 0; {_COUNTERS}")
        time.sleep(seconds)
        after = driver.execute_script(_COUNTERS)
        sizes = driver.execute_script("return performance.getEntries().map((each) => each.transferSize ?? 0)")
    elapsed_s = (after["now"] - before["now"]) / 1e3
    rate_hz, frames_hz = ((after[name] - before[name]) / elapsed_s for name in ("cycles", "frames"))
    painted = sorted(after["painted"])
    print(
        f"page, {elapsed_s:.0f} s: {rate_hz / 2:.2f} Hz on each foot, {after['missing'] - before['missing']} cycles "
        f"missing, {frames_hz:.1f} frames/s drawn; published to painted p50 {statistics.median(painted):.1f} ms, "
        f"p95 {painted[int(0.95 * len(painted))]:.1f} ms; first picture after {after['ready'] / 1e3:.2f} s, "
        f"{sum(sizes) / 1e3:.0f} kB transferred",
        flush=True,
    )


async def watch(url: str, seconds: float, port: int | None = None) -> list[tuple[float, int, int]]:
    """(age in s, seq, foot) of every cycle that comes within `seconds`; answered as the page does."""
    own = url.rstrip("/")
    reached = own if port is None else f"http://127.0.0.1:{port}"
    received: list[tuple[float, int, int]] = []
    end = time.monotonic() + seconds
    async with aiohttp.ClientSession() as session:
        async with session.ws_connect(f"{reached}/live", headers={"Origin": own, "Host": own[7:]}) as live:
            async for message in live:
                await live.send_str("got")
                if message.type is aiohttp.WSMsgType.BINARY:
                    _, foot, _, seq, _, published_ms = struct.unpack_from("<BBHI2d", message.data)
                    received.append((time.time() - published_ms / 1e3, seq, foot))
                if time.monotonic() > end:
                    break
    return received


def viewers(_: float) -> None:
    """The latency of the daemon without `insole view`, with `insole view` and no browser, and with five browsers."""
    process.settle(process.cpus()[1])  # and all that is started here, but the daemon
    reports_of: dict[str, list[dict[str, Any]]] = {"no view": [], "no browser": [], "five browsers": []}
    for seed in range(ROUNDS):
        for name, reports in reports_of.items():
            with daemon(ROUND_S, seed) as (measured, endpoint), ExitStack() as ending:
                url = "" if name == "no view" else ending.enter_context(serving(endpoint))
                if name == "five browsers":
                    asyncio.run(_five(url))
                else:
                    time.sleep(WARM_UP_S + ROUND_S + 3)
                reports.append(measured.end())
            print(f"round {seed + 1}  {name:14} p50 {reports[-1]['latency_ms_p50']:.3f} "
                  f"p99 {reports[-1]['latency_ms_p99']:.3f} ms", flush=True)  # fmt: skip
    without_browser = reports_of["no browser"]
    for name, reports in reports_of.items():
        figures = []
        for key in ("latency_ms_p50", "latency_ms_p99"):
            ratio = statistics.median(own[key] / none[key] for own, none in zip(reports, without_browser, strict=True))
            figures.append(f"{key[8:]} {statistics.median(each[key] for each in reports):.3f} ms ({ratio:.2f} ×)")
        print(f"{name:14} {', '.join(figures)}, × that of the same round without a browser")


async def _five(url: str) -> None:
    await asyncio.gather(*(watch(url, WARM_UP_S + ROUND_S + 3) for _ in range(5)))


def slow(seconds: float) -> None:
    """How old is what a slow link shows?"""
    with daemon(seconds + 10) as (_, endpoint), serving(endpoint) as url:
        fast, through = asyncio.run(_both(url, seconds))
    for name, cycles in (("fast link", fast), (f"{SLOW_BYTES_S / 1e3:.0f} kB/s", through)):
        ages_ms = [1e3 * age_s for age_s, _, _ in cycles[len(cycles) // 4 :]]
        of_feet = [[seq for _, seq, own in cycles if own == foot] for foot in (0, 1)]
        order = "in order" if all(seqs == sorted(seqs) for seqs in of_feet) else "OUT OF ORDER"
        print(
            f"{name}: {len(cycles) / seconds / 2:.1f} cycles/s of each foot, "
            f"age p50 {statistics.median(ages_ms):.0f} ms, most {max(ages_ms):.0f} ms, {order}"
        )


async def _both(url: str, seconds: float) -> tuple[list[tuple[float, int, int]], list[tuple[float, int, int]]]:
    to = int(url.rstrip("/").rpartition(":")[2])

    async def carry(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, bytes_s: float | None) -> None:
        while piece := await reader.read(512):
            if bytes_s is not None:
                await asyncio.sleep(len(piece) / bytes_s)
            writer.write(piece)
            await writer.drain()
        writer.close()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        back, forth = await asyncio.open_connection("127.0.0.1", to, limit=1024)
        await asyncio.gather(carry(reader, forth, None), carry(back, writer, SLOW_BYTES_S), return_exceptions=True)

    proxy = await asyncio.start_server(accept, "127.0.0.1", 0)
    async with proxy:
        fast, through = await asyncio.gather(
            watch(url, seconds), watch(url, seconds, proxy.sockets[0].getsockname()[1])
        )
    return fast, through


PARTS = {"page": page, "viewers": viewers, "slow": slow}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="?", choices=PARTS, help="left out: all")
    parser.add_argument("--seconds", type=float, default=60.0, help="of page and slow")
    options = parser.parse_args()
    for name, part in PARTS.items():
        if options.part in (None, name):
            part(options.seconds)


if __name__ == "__main__":
    main()
