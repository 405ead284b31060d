"""Plays the bus: sends every frame when it would be complete on a real one, and says how well it kept the times.

    python -m benchmarks.lib.feeder --to udp:PORT|vcan0 [--seconds 20]

Frames are made beforehand and sent one by one, as a bus delivers them. UDP over loopback runs the receiving half of
the kernel in the sender, as an interrupt would: none of that is charged to the process that is measured.
"""

from __future__ import annotations

import argparse
import json
import socket
import time

import numpy as np

from benchmarks.lib import process, traffic


def connect(to: str) -> socket.socket:
    """A socket that sends `struct can_frame` to `to`: udp:PORT on loopback, or a CAN interface."""
    kind, _, port = to.partition(":")
    if kind == "udp":
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.connect(("127.0.0.1", int(port)))
    else:
        sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        sock.bind((to,))
    return sock


def play(socks: list[socket.socket], which: list[int], loop: traffic.Loop, seconds: float) -> dict[str, float]:
    """Send frame i of the loop to socks[which[i]] at its time, for `seconds`; what was sent, and how punctually."""
    frames = [row.tobytes() for row in loop.rows]
    sends = [socks[index].send for index in which]
    loops = int(seconds * 1e9 / loop.length_ns) + 1
    lateness_ns = np.zeros(loops * len(frames), np.int32)
    due_ns = loop.t_ns.tolist()
    monotonic_ns, sleep = time.monotonic_ns, time.sleep
    start_ns = monotonic_ns() + 10_000_000
    end_ns = start_ns + round(seconds * 1e9)
    sent = refused = 0
    for turn in range(loops):
        base_ns = start_ns + turn * loop.length_ns
        for frame, send, after_ns in zip(frames, sends, due_ns, strict=True):
            due = base_ns + after_ns
            if due >= end_ns:
                break
            early_ns = due - monotonic_ns()
            if early_ns > 0:
                sleep(early_ns * 1e-9)
            try:
                send(frame)
            except ConnectionRefusedError:  # nobody has opened the port yet
                refused += 1
            lateness_ns[sent] = min(monotonic_ns() - due, 2**31 - 1)
            sent += 1
    late_ms = lateness_ns[:sent] * 1e-6
    p50, p99, worst = np.percentile(late_ms, [50, 99, 100]).tolist()
    return {
        "sent": sent - refused,
        "frames_per_s": sent / seconds,
        "late_ms_p50": p50,
        "late_ms_p99": p99,
        "late_ms_max": worst,
        "late_over_1ms": int((late_ms > 1).sum()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Play both feet on a bus.")
    parser.add_argument("--to", required=True, help="udp:PORT, or a CAN interface such as vcan0")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0, help="of the boards' clocks and phases")
    parser.add_argument("--cpu", type=int, help="the only CPU to run on")
    options = parser.parse_args()
    process.settle(options.cpu, punctual=True)
    loop = traffic.loop(options.seed)
    print(json.dumps(play([connect(options.to)], [0] * len(loop.rows), loop, options.seconds)))


if __name__ == "__main__":
    main()
