"""A recorder of every wearer in one process: for each what `insole record --remote --rig` does."""

from __future__ import annotations

import argparse
import json
import signal
import tempfile
import threading
from contextlib import ExitStack
from pathlib import Path

import insole_daemon
from insole_daemon.recording.live import LiveRecorder
from insole_daemon.recording.of_daemon import insole_of
from insole_daemon.recording.recorder import Session


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--endpoint", required=True, help="of the router")
    options = parser.parse_args()
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    with ExitStack() as opened:
        root = Path(opened.enter_context(tempfile.TemporaryDirectory()))
        anyone = opened.enter_context(insole_daemon.connect(options.endpoint))
        progress, threads = [], []
        for rig in sorted({rig for rig, _ in anyone.feet()}):
            client = opened.enter_context(insole_daemon.connect(options.endpoint, rig))
            insoles = [insole_of(client, foot) for foot in ("left", "right")]
            recorder = LiveRecorder(root / rig, "free", insoles, 0, None)
            session = Session(recorder, stop)

            def record(session: Session = session, client: insole_daemon.Client = client) -> None:
                progress.append(session.from_daemon(client.raws()))
                session.recorder.close()

            threads.append(threading.Thread(target=record))
            threads[-1].start()
        print(json.dumps({"rigs": len(threads)}), flush=True)
        stop.wait()
        for thread in threads:
            thread.join()
        print(
            json.dumps({"cycles": sum(each.cycles for each in progress), "lost": sum(each.lost for each in progress)}),
            flush=True,
        )


if __name__ == "__main__":
    main()
