"""Losses, latency and CPU of 20 rigs through one router to one recorder and one viewer of all.

    python -m benchmarks.live.many_wearers [--rigs 20] [--seconds 20]

Each rig has a session of its own and publishes both feet at 50 Hz, three messages a cycle. The router is
docs/examples/router.py, the recorder writes everybody's counts to disk, the viewer takes everybody's wrench. Age is
from the rig's `put` until the viewer has the message decoded. All run on one host, before whatever else runs there.

Takes about a minute.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

import insole_daemon
from benchmarks.lib import measured
from benchmarks.lib.process import Child
from benchmarks.lib.quota import Group
from benchmarks.live.overload import cpu_s

_ROUTER = Path(__file__).parents[2] / "docs" / "examples" / "router.py"
_SETTLE_S = 5.0
_CYCLES_PER_S = 100  # of both feet


def rss_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


class Viewer:
    """Takes the wrench of every foot there is."""

    def __init__(self, insole: insole_daemon.Client) -> None:
        self.ages_ms: list[float] = []
        self.lost = 0
        self._wrenches = insole.wrenches()
        threading.Thread(target=self._take, daemon=True).start()

    def _take(self) -> None:
        for wrench in self._wrenches:
            self.ages_ms.append((time.time_ns() - wrench.t_published_ns) * 1e-6)
            self.lost += wrench.lost


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=20.0)
    options = parser.parse_args()
    endpoint = measured.free_endpoint()
    router = subprocess.Popen([sys.executable, str(_ROUTER), endpoint], stdout=subprocess.PIPE, text=True)
    assert router.stdout is not None
    assert router.stdout.readline()
    try:
        with Child("live.rigs", endpoint=endpoint, rigs=options.rigs) as rigs:
            sizes = rigs.report()
            with (
                Child("live.recorder_of_all", endpoint=endpoint) as recorder,
                insole_daemon.connect(endpoint) as insole,
                ExitStack() as groups,
            ):
                assert recorder.report()["rigs"] == options.rigs
                viewer = Viewer(insole)
                for pid in (router.pid, recorder.pid, os.getpid()):
                    groups.enter_context(Group(pid))
                time.sleep(_SETTLE_S)
                viewer.ages_ms, viewer.lost = [], 0
                pids = {"rigs": rigs.pid, "router": router.pid, "recorder": recorder.pid, "viewer": os.getpid()}
                before, began = {name: cpu_s(pid) for name, pid in pids.items()}, time.monotonic()
                time.sleep(options.seconds)
                elapsed_s = time.monotonic() - began
                used = {name: 100 * (cpu_s(pid) - before[name]) / elapsed_s for name, pid in pids.items()}
                memory = {name: rss_mb(pid) for name, pid in pids.items()}
                ages_ms, lost = viewer.ages_ms[:], viewer.lost
                recorded = recorder.end()
            published = rigs.end()
    finally:
        router.terminate()
        router.wait()
        router.stdout.close()
    p50, p99, most = np.percentile(ages_ms, [50, 99, 100])
    taken = sizes["Raw"] + sizes["Wrench"]  # what nobody subscribes to does not leave a rig
    print(f"{options.rigs} rigs, {2 * options.rigs} feet, {options.seconds:g} s, load {os.getloadavg()[0]:.1f}")
    print(f"a cycle of a foot: {json.dumps(sizes)} bytes")
    print(f"through the router: {options.rigs * _CYCLES_PER_S * 2} messages/s and "
          f"{options.rigs * _CYCLES_PER_S * taken * 8e-6:.1f} Mbit/s of payload each way")  # fmt: skip
    print(f"viewer:   {len(ages_ms) / elapsed_s / 2 / options.rigs:.2f} Hz a foot, {lost} lost, age p50 {p50:.2f}, "
          f"p99 {p99:.2f}, longest {most:.1f} ms")  # fmt: skip
    print(f"recorder: {recorded['cycles']} cycles on disk, {recorded['lost']} lost, {recorded['waiting']} waiting")
    print(f"rigs:     {published['cycles']} cycles of each foot sent, at most {published['late_ms_max']:.1f} ms late")
    for name, percent in used.items():
        print(
            f"CPU of {name:8} {percent:6.1f} % of a core, {percent / options.rigs:.2f} % a rig; {memory[name]:.0f} MB"
        )


if __name__ == "__main__":
    main()
