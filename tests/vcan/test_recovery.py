"""Interfaces that are missing, go down, or come back under another index: picked up, and no other is disturbed."""

from __future__ import annotations

import contextlib
import itertools
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import insole_daemon
from insole_daemon import config as configs
from insole_daemon.bus import link
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.bus.gate import Gate
from insole_daemon.bus.recovering import RecoveringSource
from insole_daemon.bus.sink import can_frames
from insole_daemon.config import Bus
from insole_daemon.errors import BusError
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Stand
from insole_daemon.wire.client import Subscription
from insole_daemon.wire.messages import Event, Health, Pressure, Raw
from tests.ports import free_port

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(300)]  # the kernel may be a slow one

INSOLE = Path(sys.executable).with_name("insole")
FRAME = struct.Struct("=IB3x8s")
BUS_OFF, RESTARTED = 0x2000_0040, 0x2000_0100  # error frames, as a driver sends them
BACK_S = 1.0  # from the return of an interface until it is read again


def ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


def create(name: str, index: int | None = None) -> None:
    ip("link", "add", "dev", name, *(["index", str(index)] if index else []), "type", "vcan")
    ip("link", "set", name, "up")


@pytest.fixture
def names() -> Iterator[tuple[str, str]]:
    """Two names that no interface has; what a test creates under them is removed."""
    yield "insolea", "insoleb"
    for name in ("insolea", "insoleb"):
        subprocess.run(["ip", "link", "del", name], capture_output=True, check=False)


class Sender:
    """A node on one interface; sends a number with every frame."""

    def __init__(self, name: str) -> None:
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._socket.bind((name,))

    def send(self, *numbers: int) -> None:
        for number in numbers:
            self._socket.send(FRAME.pack(0x450, 8, number.to_bytes(8, "little")))

    def send_error(self, id_and_flags: int) -> None:
        self._socket.send(FRAME.pack(id_and_flags, 8, bytes(8)))

    def close(self) -> None:
        self._socket.close()


class Listener:
    """Hears what others send on one interface to everyone, which is the discovery of boards."""

    def __init__(self, name: str) -> None:
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, struct.pack("=II", 0x70F, 0x7FF))
        self._socket.settimeout(2)  # the kernel hands frames on a moment after they were sent
        self._socket.bind((name,))

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def heard(self) -> bytes:
        """The payload of the next one."""
        _, dlc, data = FRAME.unpack(self._socket.recv(FRAME.size))
        return bytes(data[:dlc])


class Reader:
    """A recovering source, and what came out of it."""

    def __init__(self, *names: str) -> None:
        self.source = RecoveringSource([Bus("socketcan", name) for name in names])
        self.numbers: dict[int, list[int]] = {at: [] for at in range(len(names))}
        self.states: list[tuple[str, str]] = []

    def look(self) -> None:
        self.source.receive()
        batch: FrameBatch = self.source.drain()
        for interface, number, flags in zip(
            batch.interface.tolist(), batch.data.copy().view("<u8")[:, 0].tolist(), batch.flags.tolist(), strict=True
        ):
            if not flags:
                self.numbers[interface].append(number)
        self.states += [(change.interface, change.state) for change in self.source.changes()]

    def until(self, done: Callable[[], bool], within_s: float = 10.0) -> float:
        """Read until `done`; the seconds it took."""
        began = time.monotonic()
        while not done():
            assert time.monotonic() - began < within_s, f"{self.states} {self.source.counters}"
            self.source.wait(0.05)
            self.look()
        return time.monotonic() - began


@pytest.fixture
def read() -> Iterator[Callable[..., Reader]]:
    readers = []

    def start(*names: str) -> Reader:
        readers.append(Reader(*names))
        return readers[-1]

    yield start
    for reader in readers:
        reader.source.close()
        reader.source.close()  # is idempotent


def test_an_interface_that_is_missing_at_first_is_picked_up(names, read):
    name = names[0]
    reader = read(name)
    reader.look()
    assert reader.states == [(name, "missing")]
    assert "ip link set insolea up" in (reader.source.counters.interfaces[name].error or "")
    ip("link", "add", "dev", name, "type", "vcan")
    reader.until(lambda: reader.states[-1] == (name, "down"))
    ip("link", "set", name, "up")
    assert reader.until(lambda: reader.states[-1] == (name, "up")) < BACK_S
    sender = Sender(name)
    sender.send(*range(100))
    reader.until(lambda: len(reader.numbers[0]) == 100)
    sender.close()
    assert reader.source.counters.interfaces[name].reopened == 1


def test_nothing_to_read_does_not_spin(names, read):
    reader = read(names[0])
    began, cpu = time.monotonic(), time.process_time()
    for _ in range(10):
        reader.source.receive()
        reader.source.wait(0.1)
    assert time.monotonic() - began > 0.9
    assert time.process_time() - cpu < 0.5


def test_down_and_up_again_loses_nothing_from_before(names, read):
    name = names[0]
    create(name)
    reader = read(name)
    sender = Sender(name)
    sender.send(*range(500))
    ip("link", "set", name, "down")  # with all of them still in the queue
    reader.until(lambda: reader.states == [(name, "down")])
    assert reader.numbers[0] == list(range(500))
    time.sleep(0.7)
    ip("link", "set", name, "up")
    assert reader.until(lambda: reader.states[-1] == (name, "up")) < BACK_S
    sender.close()
    sender = Sender(name)
    sender.send(*range(500, 600))
    reader.until(lambda: len(reader.numbers[0]) == 600)
    sender.close()
    assert reader.numbers[0] == list(range(600))
    assert reader.source.counters.frames == 600, "counted on over the gap"


def test_deleted_and_created_again_under_another_index(names, read):
    name = names[0]
    create(name)
    before = socket.if_nametoindex(name)
    reader = read(name)
    ip("link", "del", name)
    create(name, index=before + 100)
    reader.until(lambda: reader.states[-1:] == [(name, "up")])
    sender = Sender(name)
    sender.send(7)
    reader.until(lambda: reader.numbers[0] == [7])
    sender.close()


def test_a_name_that_went_to_another_interface_is_noticed(names, read, monkeypatch):
    name = names[0]
    create(name)
    reader = read(name)
    index = socket.if_nametoindex(name)
    # Linux renames an interface that is up since 6.2 only, and then tells its sockets nothing; so the answer is ours.
    monkeypatch.setattr(link.socket, "if_nametoindex", lambda _: index + 1)
    reader.until(lambda: (name, "missing") in reader.states)
    monkeypatch.undo()
    reader.until(lambda: reader.states[-1] == (name, "up"))


def test_one_of_two_is_lost_and_the_other_loses_no_frame(names, read):
    one, two = names
    create(one)
    create(two)
    reader = read(one, two)
    stop, numbers = threading.Event(), itertools.count()
    sender = Sender(two)

    def send() -> None:
        while not stop.wait(0.002):
            sender.send(*itertools.islice(numbers, 5))

    thread = threading.Thread(target=send)
    thread.start()
    try:
        reader.until(lambda: len(reader.numbers[1]) > 100)
        ip("link", "del", one)
        reader.until(lambda: reader.states[-1:] == [(one, "missing")])
        seen = len(reader.numbers[1])
        reader.until(lambda: len(reader.numbers[1]) > seen + 300)
        create(one)
        reader.until(lambda: reader.states[-1] == (one, "up"))
    finally:
        stop.set()
        thread.join()
    sent = next(numbers)
    reader.until(lambda: len(reader.numbers[1]) == sent)
    sender.close()
    assert reader.numbers[1] == list(range(sent))
    assert {interface for interface, _ in reader.states} == {one}


def test_bus_off_and_its_end(names, read):
    name = names[0]
    create(name)
    reader = read(name)
    sender = Sender(name)
    for end in (lambda: sender.send_error(RESTARTED), lambda: sender.send(1)):
        sender.send_error(BUS_OFF)
        reader.until(lambda: reader.states[-1:] == [(name, "bus-off")])
        assert "restart-ms" in (reader.source.counters.interfaces[name].error or "")
        end()
        reader.until(lambda: reader.states[-1] == (name, "up"))
    sender.close()
    assert reader.source.counters.error_frames == {"bus_off": 2, "restarted": 1}


def test_frames_leave_through_the_socket_that_is_open_now(names, read):
    name = names[0]
    create(name)
    reader = read(name)
    gate = Gate(lambda: reader.source.sink(name, 0.005), configure=True)

    def passes() -> None:
        with Listener(name) as listener:
            gate.send(0x70F, b"\xff")
            assert listener.heard() == b"\xff"

    passes()
    reader.look()
    assert reader.source.counters.frames == 0, "its own frames do not come back"
    ip("link", "set", name, "down")
    with pytest.raises(BusError, match=f"{name}: sending failed: the interface is down"):
        gate.send(0x70F, b"\xff")  # before the reader has noticed
    reader.until(lambda: reader.states[-1:] == [(name, "down")])
    with pytest.raises(BusError, match=f"nothing is sent: .*ip link set {name} up"):
        gate.send(0x70F, b"\xff")
    ip("link", "del", name)
    create(name)
    reader.until(lambda: reader.states[-1] == (name, "up"))
    passes()


# The daemon itself.

TICKS = 50  # of a board, a second of them, before anything is said

LAYOUT = "format: insole-layout/1\nfoot: {foot}\ntaxel_area_mm2: 32.4\ntriangles:\n" + "".join(
    f"  - {{{{board: {{board}}, triangle: {t}, patch: front, x_mm: {100 + 40 * t}, y_mm: 0, rotation_deg: 0, "
    "mirrored: false}}\n"
    for t in range(3)
)
FEET = (("left", 5), ("right", 8))


@pytest.fixture
def rig(tmp_path: Path, names: tuple[str, str]) -> Iterator[Rig]:
    """`insole run` with the left foot on one interface and the right one on the other, both simulated."""
    running = Rig(tmp_path, names)
    yield running
    running.end()


class Rig:
    """A daemon on two interfaces, boards that send whenever theirs is up, and all raw cycles and healths."""

    def __init__(self, folder: Path, names: tuple[str, str]) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.folder = folder
        lines = [f"format: insole-config/1\nrig: vcan\nzenoh: {{listen: [{self.endpoint}]}}"]
        # One slow processor for boards, daemon and test: a half that comes later than 5 ms is not lost.
        lines += ["boards: {configure: true}", "publish: {slack_ms: 20}"]
        lines += [f"buses: [{', '.join(f'socketcan:{name}' for name in names)}]", "insoles:"]
        for (foot, board), name in zip(FEET, names, strict=True):
            (folder / f"{foot}.yaml").write_text(LAYOUT.format(foot=foot, board=board))
            lines.append(f"  - foot: {foot}\n    layout: {foot}.yaml")
            lines.append(f"    boards: [{{address: {board}, interface: {name}}}]")
        (folder / "config.yaml").write_text("\n".join(lines) + "\n")
        self.config = configs.load(folder / "config.yaml")
        self.raws: dict[str, list[Raw]] = {"left": [], "right": []}
        self.healths: dict[str, list[Health]] = {"left": [], "right": []}
        self.boards: dict[str, _Boards] = {}
        self._ends = contextlib.ExitStack()

    def start(self) -> None:
        log = self._ends.enter_context((self.folder / "daemon.log").open("w"))
        self.process = subprocess.Popen([INSOLE, "run", "--config", self.folder / "config.yaml"], stderr=log)
        self._ends.callback(lambda: self.process.wait(10) if not self.process.poll() else None)
        self._ends.callback(self.process.terminate)
        began = time.monotonic()
        while "insole: reading" not in self.log():
            assert self.process.poll() is None, self.log()
            assert time.monotonic() - began < 90, self.log()
            time.sleep(0.05)
        self.client = insole_daemon.connect(self.endpoint, "vcan").open()
        self._ends.callback(self.client.close)
        self.events = self.client.events()
        for foot in self.raws:
            self._thread(self._listen, self.raws[foot], self.client.raws(foot))
            self._thread(self._listen, self.healths[foot], self.client.healths(foot))
        stop = threading.Event()
        for insole in self.config.insoles:
            layout = load_layout(insole)
            send = self._ends.enter_context(_Boards(insole.boards[0].interface))
            self.boards[insole.foot] = send
            self._thread(Emulator(self.config, [layout], Stand([layout])).play, send, stop)
        self._ends.callback(time.sleep, 0.2)
        self._ends.callback(stop.set)

    def _thread(self, target: Callable[..., object], *arguments: object) -> None:
        threading.Thread(target=target, args=arguments, daemon=True).start()

    def _listen(self, into: list[Any], messages: Iterator[Any]) -> None:
        for message in messages:
            into.append(message)

    def bus_event(self) -> Event:
        """The next that tells what became of an interface."""
        return next(event for event in self.events if event.kind.startswith("bus_"))

    def bus_events(self, n_up: int = 1) -> list[Event]:
        """All of them until so many interfaces are up again."""
        events: list[Event] = []
        while sum(event.kind == "bus_up" for event in events) < n_up:
            events.append(self.bus_event())
        return events

    def log(self) -> str:
        return (self.folder / "daemon.log").read_text()

    def check_ticks(self, foot: str, from_ns: int = 0) -> None:
        """Whatever triangle 0 sent since then was published, but for as many ticks as the daemon says it left out.

        How many it leaves out is a matter of the processor, which is slow and shared with boards and test; that it
        says so is not. Waits until there are enough ticks to tell.
        """
        while len(sent := self._in_rhythm(foot, from_ns)) < TICKS:
            time.sleep(0.1)
        until_ns = int(sent[-1, 1]) + 1
        for messages in (self.raws[foot], self.healths[foot]):
            while messages[-1].t_ns < until_ns:
                time.sleep(0.05)
        skipped_at = [(health.t_ns, health.cycles["skipped"]) for health in list(self.healths[foot])]
        before = max((skipped for t_ns, skipped in skipped_at if t_ns <= sent[0, 0]), default=0)
        left_out = min(skipped for t_ns, skipped in skipped_at if t_ns >= until_ns) - before
        received = np.array([raw.triangle_t_ns[0] for raw in list(self.raws[foot])])  # by the kernel, as it was sent
        lost = [[first, last] for first, last in sent.tolist() if not ((received >= first) & (received <= last)).any()]
        assert len(lost) <= left_out, f"{foot}: {len(lost)} of {len(sent)} lost, {left_out} told: {lost}"

    def check_frames(self) -> None:
        """Every frame that was sent has been received: the boards fall silent, and what the daemon has read is counted.

        That holds however slow the processor is. A frame that nobody can receive must not have been sent.
        """
        for boards in self.boards.values():
            boards.silent = True
        since_ns = time.time_ns() + 500_000_000  # what was on its way has been sent
        healths = self.healths["left"]
        while len(healths) < 2 or healths[-2].t_ns < since_ns:  # between two of them the loop has come by
            time.sleep(0.05)
        bus = healths[-1].bus
        assert (bus["frames"], bus["overflows"]) == (sum(boards.sent for boards in self.boards.values()), 0)

    def _in_rhythm(self, foot: str, from_ns: int) -> NDArray[np.int64]:
        """(n, 2) from when to when ticks of a board were sent that keeps its rhythm, from the first cycle on that came.

        Removing an interface can stop this one-processor kernel for a second, boards and all; what they then send in
        one go is nothing that boards do.
        """
        if not (self.boards[foot].ticks_ns[:-1] and self.raws[foot] and self.healths[foot]):
            return np.empty((0, 2), np.int64)
        ticks = np.array(self.boards[foot].ticks_ns[:-1])  # the newest may be on its way yet
        between_ns, long_ns = np.diff(ticks[:, 0]), ticks[:, 1] - ticks[:, 0]
        steady = (between_ns > 10_000_000) & (between_ns < 35_000_000)
        rhythm = np.flatnonzero(steady[:-3] & steady[1:-2] & steady[2:-1] & steady[3:]) + 3
        sent = ticks[rhythm][long_ns[rhythm] < 10_000_000]
        return sent[sent[:, 0] >= max(from_ns, self.raws[foot][0].t_ns)]

    def check_numbers(self) -> None:
        """Every cycle since the first has come."""
        for raws in self.raws.values():
            numbers = [raw.seq for raw in raws]
            assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))

    def end(self) -> None:
        self._ends.close()


class _Boards:
    """Sends what it is given while the interface is up, as boards with their own supply do."""

    def __init__(self, name: str) -> None:
        self._name, self._index = name, 0
        self.silent, self.sent = False, 0  # frames
        self.ticks_ns: list[list[int]] = []  # just before the first frame of each was sent, just after the last one
        self._socket: socket.socket | None = None

    def __enter__(self) -> _Boards:
        return self

    def __exit__(self, *_: object) -> None:
        if self._socket is not None:
            self._socket.close()

    def __call__(self, batch: FrameBatch) -> None:
        if self.silent:
            return
        try:
            index = socket.if_nametoindex(self._name)
            if index != self._index:
                self.__exit__()
                self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
                self._socket.bind((self._name,))
                self._index = index
            assert self._socket is not None
            for frame in can_frames(batch):
                before_ns = time.time_ns()
                self._socket.send(frame.tobytes())
                self.sent += 1
                if frame[0] & 0xF == 0 and frame[8] == 0x40:
                    self.ticks_ns.append([before_ns, before_ns])
                if self.ticks_ns:
                    self.ticks_ns[-1][1] = time.time_ns()
        except OSError:
            pass  # nobody hears them


def test_the_daemon_starts_without_its_interfaces_and_finds_them(rig, names):
    rig.start()
    assert rig.log().count("there is no such interface") == 2
    time.sleep(0.5)
    for name in names:
        create(name)
    up_ns = {event.foot: event.t_ns for event in rig.bus_events(2) if event.kind == "bus_up"}
    for foot in rig.raws:
        rig.check_ticks(foot, up_ns[foot])


@pytest.mark.parametrize("how", ["down and up", "deleted and created"])
def test_the_daemon_is_back_at_full_rate_and_the_other_foot_continues(rig, names, how):
    for name in names:
        create(name)
    rig.start()
    for foot in rig.raws:
        rig.check_ticks(foot)
    rig.boards["left"].silent = True  # the daemon counts the frames of both interfaces together
    time.sleep(0.5)
    lost_ns = time.time_ns()
    if how == "down and up":
        ip("link", "set", names[0], "down")
        events = [rig.bus_event()]
        ip("link", "set", names[0], "up")
    else:
        index = socket.if_nametoindex(names[0])
        ip("link", "del", names[0])
        events = [rig.bus_event()]
        create(names[0], index + 100)
    events += rig.bus_events()
    assert events[0].kind in ("bus_down", "bus_missing")
    assert all(event.boards == [5] for event in events)
    rig.boards["left"].silent = False
    rig.check_ticks("left", events[-1].t_ns)
    rig.check_ticks("right", lost_ns)
    rig.check_frames()
    rig.check_numbers()
    health = rig.healths["left"][-1]
    state = health.bus["interfaces"][names[0]]
    assert state["state"] == "up"
    assert state["reopened"] == 1
    assert re.search("ip link set|plugged in", state["error"])
    assert health.bus["interfaces"][names[1]] | {"since_ns": 0} == {
        "state": "up", "since_ns": 0, "reopened": 0, "error": None
    }  # fmt: skip
    assert "is back and read again" in rig.log()


def test_a_daemon_sends_to_an_interface_that_came_back(rig, names):
    for name in names:
        create(name)
    rig.start()
    time.sleep(1)

    def discovers() -> None:
        with Listener(names[0]) as listener:
            assert rig.client.request("left", "boards", do="list")["notes"] == []
            assert listener.heard() == b"\xff"

    discovers()
    index = socket.if_nametoindex(names[0])
    ip("link", "del", names[0])
    time.sleep(0.5)
    (note,) = rig.client.request("left", "boards", do="list")["notes"]
    assert "nothing is sent" in note
    assert names[0] in note
    create(names[0], index + 100)
    rig.bus_events()
    discovers()


def test_a_reload_loses_no_cycle_and_counts_from_one_to_the_next(rig, names):
    for name in names:
        create(name)
    rig.start()
    pressures = {foot: rig.client.pressures(foot) for foot in rig.raws}
    published = {foot: [*itertools.islice(of, 100)] for foot, of in pressures.items()}
    is_reloaded = threading.Event()

    def taken(of: Subscription[Pressure]) -> list[Pressure]:
        """Return messages up to 50 after the reload, taken as they come: a subscription keeps only 10 s of them."""
        messages = []
        while not is_reloaded.is_set():
            messages.append(next(of))
        return [*messages, *itertools.islice(of, 50)]

    with ThreadPoolExecutor() as pool:
        later = {foot: pool.submit(taken, of) for foot, of in pressures.items()}
        with (rig.folder / "config.yaml").open("a") as config:
            config.write("contact: {activation_threshold_count: 250}\n")
        rig.process.send_signal(signal.SIGHUP)
        try:
            reloaded = next(event for event in rig.events if event.kind.startswith("reload"))
        finally:
            is_reloaded.set()
    assert (reloaded.kind, reloaded.text) == ("reloaded", "changed: contact.activation_threshold_count")
    assert rig.client.meta("left").activation_threshold_count == 250
    for foot in pressures:
        published[foot] += later[foot].result()
        numbers = [pressure.seq for pressure in published[foot]]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
        presses = [bool(np.nanmax(pressure.pressure_pa) > 0) for pressure in published[foot]]
        assert presses[0]
        assert not presses[-1]
        assert presses == sorted(presses, reverse=True), "at once, and never back"
        rig.check_ticks(foot, published[foot][0].t_ns)
    rig.check_numbers()


def test_a_daemon_without_any_interface_ends_on_a_signal(rig):
    rig.start()
    rig.process.terminate()
    assert rig.process.wait(90) == 0, "what waits for an interface is not waited for"
