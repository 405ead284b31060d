"""The faults, each as what is done to a Rig; in the order of the table.

A row is a generator: what it yields are the arguments of the Rig it wants, and it is sent the rig, started.
It returns a sentence for the table, or nothing.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.faults.matrix.rig import FAR, INTERFACES, NEAR, PORT, SETTLE_S, Rig, ip
from benchmarks.faults.restart import restart_sec

NETWORK_S, PROCESS_S = 1.0, 3.0
T, FOR_S = SETTLE_S + 0.5, 2.0  # of a fault that boards have by themselves: when, and for how long
Run = Generator[dict[str, Any], Rig, str | None]


@dataclass(frozen=True)
class Row:
    """One fault."""

    group: str
    name: str
    run: Callable[[Path], Run]
    bar_s: float = NETWORK_S
    heals: bool = True  # what it says is believed again when the fault is over


ROWS: list[Row] = []


def row(group: str, name: str, **further: Any) -> Callable[[Callable[[Path], Run]], Callable[[Path], Run]]:
    def add(run: Callable[[Path], Run]) -> Callable[[Path], Run]:
        ROWS.append(Row(group, name, run, **further))
        return run

    return add


def of_boards(name: str, group: str = "board", **fault: Any) -> None:
    """A fault that emulated boards have by themselves, on the left foot."""
    until_s = fault.pop("until_s", T + FOR_S)

    def run(folder: Path) -> Run:
        rig = yield {"faults": [{"t_s": T, "until_s": until_s, **fault}]}
        rig.scheduled(T, until_s)
        return None

    ROWS.append(Row(group, name, run))


def of_frames(name: str, how: str, *feet: str, group: str = "frames") -> None:
    """A fault of the bus, for two seconds."""

    def run(folder: Path) -> Run:
        rig = yield {}
        with rig.fault():
            rig.mangle(how, *feet)
            time.sleep(FOR_S)
            rig.mangle("none", *feet)
        return None

    ROWS.append(Row(group, name, run))


of_boards("silent for 2 s (its cable out)", kind="silent", board=6)


@row("board", "reset: loses power, comes back silent and without settings")
def _(folder: Path) -> Run:
    up_s = T + 4.5
    rig = yield {
        "faults": [{"kind": "reset", "board": 6, "t_s": T + 4, "until_s": up_s}],
        "further": "boards: {configure: true}",
        "obey": True,
        "pressure_pa": 0.0,
    }
    rig.request("left", "boards", do="configure")
    rig.scheduled(T + 4, up_s)
    return "configured again by the daemon, which had configured it; the foot bears no load"


of_frames("babbling: a board sends everything 8 times", "babbling", group="board")
of_frames("another node babbles: 1 000 frames/s of an unknown board", "flooded", "left", group="board")


@row("board", "re-zeroed under load; zeroed again without load after 3 s")
def _(folder: Path) -> Run:
    rig = yield {
        "faults": [
            {"kind": "rezero", "board": 6, "t_s": T, "until_s": None},
            {"kind": "rezero", "board": 6, "t_s": T + 3, "until_s": None},
        ],
        "lift_s": T + 2,
    }
    rig.scheduled(T, T + 3)
    return None


of_boards("two boards bear one address", kind="address_clash", board=5, other=6)
of_boards("a triangle is loose", group="triangle", kind="loose", board=6, triangle=1)


@row("triangle", "a triangle is shorted for 2 s (reads 0); its board zeroes itself, and is zeroed again without load")
def _(folder: Path) -> Run:
    rig = yield {
        "faults": [
            {"kind": "dead_chip", "board": 6, "triangle": 1, "t_s": T, "until_s": T + 2},
            {"kind": "rezero", "board": 6, "t_s": T + 3, "until_s": None},
        ],
        "lift_s": T + 2,
    }
    rig.scheduled(T, T + 3)
    return None


for _name, _how in (
    ("1 in 20 lost", "lost"),
    ("1 in 20 comes twice", "duplicated"),
    ("in any order", "reordered"),
    ("a bit flipped in 1 in 20", "corrupted"),
    ("1 in 20 of another length", "of wrong length"),
):
    of_frames(_name, _how)


@row("bus", "down for 2 s")
def _(folder: Path) -> Run:
    rig = yield {"feet": ("left", "right")}
    with rig.fault():
        ip("link", "set", INTERFACES["left"], "down")
        time.sleep(FOR_S)
        ip("link", "set", INTERFACES["left"], "up")
    return None


@row("bus", "bus-off for 1 s (the controller's own error frames)")
def _(folder: Path) -> Run:
    rig = yield {"feet": ("left", "right")}
    with rig.fault():
        rig.mangle("bus-off", "left")
        time.sleep(1)
        rig.mangle("restarted", "left")
    return None


@row("bus", "adapter unplugged for 2 s, back under another index")
def _(folder: Path) -> Run:
    rig = yield {"feet": ("left", "right")}
    name = INTERFACES["left"]
    with rig.fault():
        ip("link", "del", name)
        time.sleep(FOR_S)
        ip("link", "add", "dev", name, "index", "140", "type", "vcan")
        ip("link", "set", name, "up")
    return None


@row("bus", "receive queue overrun: the daemon is stopped under a flood", bar_s=NETWORK_S)
def _(folder: Path) -> Run:
    rig = yield {}
    with rig.fault():
        rig.daemon.send_signal(signal.SIGSTOP)
        _flood(INTERFACES["left"])
        rig.daemon.send_signal(signal.SIGCONT)
    return None


def _flood(name: str) -> None:
    import socket

    from benchmarks.faults.matrix.boards import FRAME

    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as sock:
        sock.bind((name,))
        for _ in range(40_000):  # 8 MiB of receive buffer hold fewer
            sock.send(FRAME.pack(0x4E1, 8, bytes(8)))


@row("subscriber", "one that never reads, for 3 s")
def _(folder: Path) -> Run:
    rig = yield {}
    other = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.faults.matrix.subscriber", rig.endpoint, str(folder / "other")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert other.stdout is not None
    other.stdout.readline()
    time.sleep(1)
    with rig.fault():
        other.send_signal(signal.SIGSTOP)
        time.sleep(3)
        other.send_signal(signal.SIGCONT)
    other.kill()
    other.wait()
    return None


def _two_hosts() -> dict[str, Any]:
    """The subscriber in a network of its own, a cable between."""
    for command in (
        "netns add far",
        "link add near type veth peer name away",
        "link set away netns far",
        f"addr add {NEAR}/24 dev near",
        "link set near up",
        f"-n far addr add {FAR}/24 dev away",
        "-n far link set away up",
    ):
        ip(*command.split())
    endpoint = f"tcp/{NEAR}:{PORT}"
    return {
        "zenoh": f"{{listen: [{endpoint}]}}",
        "subscribe_to": endpoint,
        "subscribe_in": ["ip", "netns", "exec", "far"],
    }


@row("network", "cable out for 3 s")
def _(folder: Path) -> Run:
    rig = yield _two_hosts()
    with rig.fault():
        ip("link", "set", "near", "down")
        time.sleep(3)
        ip("link", "set", "near", "up")
    rig.finish()
    ip("netns", "del", "far")
    return None


@row("network", "swallows everything for 3 s")
def _(folder: Path) -> Run:
    rig = yield _two_hosts()
    loss = "dev near root netem loss 100%"
    with rig.fault():
        subprocess.run(["tc", "qdisc", "add", *loss.split()], check=True)
        time.sleep(3)
        subprocess.run(["tc", "qdisc", "del", "dev", "near", "root"], check=True)
    rig.finish()
    ip("netns", "del", "far")
    return None


ROUTER = """
import sys
from insole_daemon.wire.session import open_session
with open_session("router", [sys.argv[1]]):
    print("ready", flush=True)
    sys.stdin.read()
"""


def _router(endpoint: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", ROUTER, endpoint], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


@row("network", "router between daemon and subscriber killed, back after 2 s")
def _(folder: Path) -> Run:
    endpoint = "tcp/127.0.0.1:7450"
    router = _router(endpoint)
    rig = yield {
        "zenoh": f"{{mode: client, listen: [], connect: [{endpoint}]}}",
        "subscribe_to": endpoint,
    }
    with rig.fault():
        router.kill()
        router.wait()
        time.sleep(2)
        router = _router(endpoint)
    rig.finish()
    router.kill()
    return None


@row("process", "a second daemon on the same rig")
def _(folder: Path) -> Run:
    rig = yield {}
    with rig.fault():
        second = subprocess.run(
            ["nice", "-n", "19", *rig.daemon.args], capture_output=True, text=True, timeout=60, check=False
        )
    return f"the second ends with status {second.returncode}: “{second.stderr.strip().splitlines()[-1][:120]} …”"


@row("process", "stopped for 2 s (SIGSTOP, SIGCONT)", bar_s=NETWORK_S)
def _(folder: Path) -> Run:
    rig = yield {}
    with rig.fault():
        rig.daemon.send_signal(signal.SIGSTOP)
        time.sleep(FOR_S)
        rig.daemon.send_signal(signal.SIGCONT)
    return None


@row("process", "killed (SIGKILL), started again after RestartSec", bar_s=PROCESS_S)
def _(folder: Path) -> Run:
    rig = yield {}
    with rig.fault():
        rig.daemon.kill()
        rig.daemon.wait()
    time.sleep(restart_sec())
    rig.start_daemon()
    ready_s = (time.monotonic_ns() - rig.ended_ns) * 1e-9
    rig.finish(ready_s + 4)
    return f"ready to read {ready_s:.2f} s after its end, most of which Python takes to start on this kernel"


@row("host", "disk full: state folder and log")
def _(folder: Path) -> Run:
    disk = _small_disk(folder)
    rig = yield {"environment": {"STATE_DIRECTORY": str(disk)}, "pressure_pa": 0.0}
    with rig.fault():
        filler = (disk / "filler").open("wb", buffering=0)
        try:
            while True:
                filler.write(bytes(4096))
        except OSError:
            pass
        why = _zero(rig)
        filler.close()
        (disk / "filler").unlink()
    again = _zero(rig)
    rig.finish()
    subprocess.run(["umount", "-l", str(disk)], check=True)
    return f"`zero` meanwhile: {why}. Afterwards: {again}"


@row("host", "state folder read-only")
def _(folder: Path) -> Run:
    disk = _small_disk(folder)
    rig = yield {"environment": {"STATE_DIRECTORY": str(disk)}, "pressure_pa": 0.0}
    with rig.fault():
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        why = _zero(rig)
        subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)
    again = _zero(rig)
    rig.finish()
    subprocess.run(["umount", "-l", str(disk)], check=True)
    return f"`zero` meanwhile: {why}. Afterwards: {again}"


@row("host", "memory: another process holds all but 128 MB for 3 s")
def _(folder: Path) -> Run:
    rig = yield {}
    hog = (
        "import re, time\n"
        "free_kb = int(re.search(r'MemAvailable: +(\\d+)', open('/proc/meminfo').read()).group(1))\n"
        "held = b'x' * (free_kb - 128 * 1024 << 10)\n"
        "time.sleep(3)"
    )
    with rig.fault():
        status = subprocess.run(["nice", "-n", "19", sys.executable, "-c", hog], check=False).returncode
    return "" if status == 0 else f"the other process ended with {status}"


def _small_disk(folder: Path) -> Path:
    disk = folder / "state"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "small", str(disk)], check=True)
    return disk


def _zero(rig: Rig) -> str:
    from insole_daemon.errors import InsoleError

    try:
        reply = rig.request("left", "zero", seconds=0.5)
    except InsoleError as error:
        return f"refused, “{str(error).replace(str(rig.folder), '…')}”"
    return "done" if reply["ok"] else f"refused, “{'; '.join(reply['refusals'])}”".replace(str(rig.folder), "…")


def _clock(name: str, *commands: str) -> None:
    """The wall clock of this kernel, set by `date`; back again at the end."""

    def run(folder: Path) -> Run:
        rig = yield {}
        with rig.fault():
            for command in commands:
                subprocess.run(["date", "-s", command], check=True, capture_output=True)
                time.sleep(FOR_S)
        return None

    ROWS.append(Row("clock", name, run))


_clock("stepped by +1 h, and back after 2 s", "+1 hour", "-1 hour")
_clock("stepped by −1 h, and back after 2 s", "-1 hour", "+1 hour")


@row("clock", "slewed by 500 ppm for 4 s")
def _(folder: Path) -> Run:
    rig = yield {}
    with rig.fault():
        _slew(500)
        time.sleep(4)
        _slew(0)
    return None


def _slew(ppm: int) -> None:
    """adjtimex(2) with ADJ_FREQUENCY, which NTP does as well."""
    import ctypes

    timex = (ctypes.c_long * 26)()
    timex[0], timex[2] = 2, ppm << 16  # modes, freq; struct timex of 64 bit
    if ctypes.CDLL(None, use_errno=True).adjtimex(timex) < 0:
        raise OSError(ctypes.get_errno(), "adjtimex")


@row("files", "calibration replaced again and again while it is read (60 reloads)")
def _(folder: Path) -> Run:
    text = _calibration(folder, "left", 8000.0)
    rig = yield {}
    with rig.fault():
        for _ in range(60):
            (folder / "left.json").write_text(text[: len(text) // 2])  # as an editor that does not rename
            rig.daemon.send_signal(signal.SIGHUP)
            time.sleep(0.01)
            (folder / "left.json").write_text(text)
            rig.daemon.send_signal(signal.SIGHUP)
            time.sleep(0.03)
    return None


def _calibration(folder: Path, foot: str, pa: float) -> str:
    import json

    from benchmarks.faults.matrix.rig import FEET, TRIANGLES

    taxels = [
        {"board": b, "triangle": t, "taxel": k, "baseline_count": 240.0, "coefficients_pa": [0.0, pa]}
        for b in FEET[foot] for t in range(TRIANGLES[foot]) for k in range(12) if k not in (6, 10)
    ]  # fmt: skip
    text = json.dumps(
        {"format": "insole-calibration/1", "foot": foot, "taxels": taxels, "effects": [], "provenance": {}}
    )
    (folder / f"{foot}.json").write_text(text)
    return text


@row("files", "reload of a configuration with errors")
def _(folder: Path) -> Run:
    rig = yield {}
    good = (folder / "config.yaml").read_text()
    with rig.fault():
        for bad in ("rig: [", good + "nonsense: 1\n", good.replace("left.yaml", "not-there.yaml"), ""):
            (folder / "config.yaml").write_text(bad)
            rig.daemon.send_signal(signal.SIGHUP)
            time.sleep(0.7)
        (folder / "config.yaml").write_text(good)
        rig.daemon.send_signal(signal.SIGHUP)
        time.sleep(0.7)
    return None
