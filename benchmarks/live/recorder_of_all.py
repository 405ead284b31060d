"""A recorder of every wearer in one process: one session, and a folder each as `insole record --remote` writes it."""

from __future__ import annotations

import argparse
import json
import queue
import signal
import tempfile
import threading
from contextlib import ExitStack
from pathlib import Path

import zenoh

import insole_daemon
from insole_daemon.recording.daemon_insole import insole_in_use
from insole_daemon.recording.live import LiveRecorder, cycle_record
from insole_daemon.wire.client import Gaps
from insole_daemon.wire.messages import Raw
from insole_daemon.wire.session import open_session


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--endpoint", required=True, help="of the router")
    options = parser.parse_args()
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    came: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()

    def take(sample: zenoh.Sample) -> None:
        came.put((str(sample.key_expr), sample.payload.to_bytes()))

    with ExitStack() as opened:
        root = Path(opened.enter_context(tempfile.TemporaryDirectory()))
        recorders: dict[str, LiveRecorder] = {}
        with insole_daemon.connect(options.endpoint) as client:
            for rig in sorted({rig for rig, _ in client.feet()}):
                client.rig = rig
                insoles = [insole_in_use(client, foot) for foot in ("left", "right")]
                recorders[rig] = LiveRecorder(root / rig, "free", insoles, 0, None)
                opened.callback(recorders[rig].close)
        session = opened.enter_context(open_session("client", connect=[options.endpoint]))
        subscriber = session.declare_subscriber("insole/*/*/raw", take)
        print(json.dumps({"rigs": len(recorders)}), flush=True)
        gaps, cycles, lost = Gaps(), 0, 0
        while not stop.is_set():
            try:
                key, payload = came.get(timeout=0.1)
            except queue.Empty:
                continue
            raw = gaps.mark(key, Raw.decode(payload))
            recorders[key.split("/")[1]].write_cycle(raw.foot, cycle_record(raw))
            cycles, lost = cycles + 1, lost + raw.lost
        subscriber.undeclare()
        print(json.dumps({"cycles": cycles, "lost": lost, "waiting": came.qsize()}), flush=True)


if __name__ == "__main__":
    main()
