"""Many wearers' daemons as their network side alone: every rig a session, its messages encoded beforehand.

Only the number of a cycle and its times are written into the bytes before they are sent.
"""

from __future__ import annotations

import argparse
import json
import signal
import struct
import threading
import time
from contextlib import ExitStack

from benchmarks.lib import process, traffic
from insole_daemon.skin.reader import SkinReader
from insole_daemon.wire.messages import Message
from insole_daemon.wire.publisher import FootPublisher
from insole_daemon.wire.session import open_session

PERIOD_S = 0.02
_CYCLES = 50  # of a walk, again and again
_SEQ, _T, _PUBLISHED = 0x7A5A_5A5A, 0x7A5A_5A5A_5A5A_5A51, 0x7A5A_5A5A_5A5A_5A52  # where the bytes are to be found


class Encoded:
    """One message but for its number and times."""

    def __init__(self, message: Message) -> None:
        payload = message.encode()
        self._bytes = bytearray(payload)
        self._at = [payload.index(struct.pack(">I", _SEQ))]
        self._at += [payload.index(struct.pack(">Q", value)) for value in (_T, _PUBLISHED)]
        self.kind, self.size = type(message), len(payload)

    def now(self, seq: int) -> bytes:
        now_ns = time.time_ns()
        struct.pack_into(">I", self._bytes, self._at[0], 1 << 30 | seq)  # always so long
        struct.pack_into(">Q", self._bytes, self._at[1], now_ns)
        struct.pack_into(">Q", self._bytes, self._at[2], now_ns)
        return bytes(self._bytes)


def walk() -> list[list[tuple[Encoded, ...]]]:
    """By foot, the messages of every cycle."""
    feet = traffic.feet()
    skin = SkinReader([foot.layout for foot in feet], 20_000_000, 5_000_000)
    of_feet: list[list[tuple[Encoded, ...]]] = []
    for foot, closed in zip(feet, skin.feed(traffic.frames((_CYCLES + 10) * PERIOD_S)), strict=True):
        messages = [foot.messages(cycles, at).published() for cycles in closed for at in range(len(cycles))][-_CYCLES:]
        for cycle in messages:
            for message in cycle:
                for name, value in (("seq", _SEQ), ("t_ns", _T), ("t_published_ns", _PUBLISHED)):
                    object.__setattr__(message, name, value)
        of_feet.append([tuple(map(Encoded, cycle)) for cycle in messages])
    return of_feet


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--endpoint", required=True, help="of the router")
    parser.add_argument("--rigs", type=int, default=20)
    options = parser.parse_args()
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    process.settle(None, punctual=True)
    encoded = walk()
    with ExitStack() as opened:
        due: list[tuple[float, FootPublisher, list[tuple[Encoded, ...]]]] = []
        for number in range(options.rigs):
            session = opened.enter_context(open_session("client", connect=[options.endpoint]))
            for at, (foot, cycles) in enumerate(zip(traffic.feet(), encoded, strict=True)):
                publisher = opened.enter_context(FootPublisher(session, f"rig-{number + 1:02}", foot.name))
                publisher.publish_latched("meta", foot.meta())
                publisher.publish_latched("calibration", foot.calibration_in_use())
                publisher.announce()
                due.append((PERIOD_S * (number + at / 2) / options.rigs, publisher, cycles))
        due.sort(key=lambda each: each[0])
        print(json.dumps({message.kind.__name__: message.size for message in encoded[0][0]}), flush=True)
        seq, begin, late_s = 0, time.monotonic(), 0.0
        while not ended.is_set():
            for phase_s, publisher, cycles in due:
                pause_s = begin + seq * PERIOD_S + phase_s - time.monotonic()
                if pause_s > 0:
                    time.sleep(pause_s)
                late_s = max(late_s, -pause_s)
                for message in cycles[seq % _CYCLES]:
                    publisher._publishers[message.kind].put(message.now(seq))
            seq += 1
    print(json.dumps({"cycles": seq, "late_ms_max": 1e3 * late_s}), flush=True)


if __name__ == "__main__":
    main()
