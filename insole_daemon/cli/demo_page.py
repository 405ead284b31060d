"""The additions of `insole demo --view`: the page in its own process, and the true load beside the readings."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import zenoh

    from ..simulation.emulator import Emulator
    from ..simulation.foot import Person
    from ..skin.layout import Layout

_EVERY_S = 0.02
_END_S = 5.0
_SIMULATION = "simulation"  # the rig that `insole view` draws in addition


@contextlib.contextmanager
def open_page(endpoint: str, rig: str, port: int) -> Iterator[str]:
    """Run `insole view --open` until the block ends; yield its first message. InsoleError if it does not start."""
    from ..errors import InsoleError

    command = [sys.executable, "-m", "insole_daemon", "view", "--open", "--connect", endpoint]
    process = subprocess.Popen(
        [*command, "--rig", rig, "--port", str(port)], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    try:
        line = process.stderr.readline()
        if "the page is on" not in line:
            raise InsoleError((line + process.stderr.read()).strip().removeprefix("insole: "))
        yield line.partition(";")[0].removeprefix("insole: ").strip()
    finally:
        process.terminate()
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stderr.close()


def tell_truth(
    session: zenoh.Session, emulator: Emulator, person: Person, layouts: list[Layout], stop: threading.Event
) -> None:
    """Publish the true load on the feet until `stop`, as a simulation's pressure and a force shoe's wrench."""
    from ..wire.keys import key
    from ..wire.messages import Pressure

    encoding = f"application/msgpack;{Pressure.SCHEMA}"
    seq = 0
    while not stop.wait(_EVERY_S):
        t_ns = time.time_ns()
        if emulator.playing_since_ns is None:
            continue
        t_s = np.array([(t_ns - emulator.playing_since_ns) * 1e-9])
        for layout in layouts:
            n = len(layout)
            pressure = Pressure(
                layout.foot, seq, emulator.playing_since_ns, t_ns, t_ns, n,
                person.pressure_pa(layout.foot, t_s)[0].astype(np.float32), np.ones((n, 12), np.uint8),
                np.zeros(n, np.float32), np.zeros(n, np.uint8), False, "static", np.zeros((n, 12), np.uint8),
            )  # fmt: skip
            session.put(key(_SIMULATION, layout.foot, "pressure"), pressure.encode(), encoding=encoding)
            shoe = {name: float(values[0]) for name, values in person.reference(layout.foot, t_s).items()}
            session.put(f"reference/{layout.foot}", json.dumps(shoe))
        seq += 1
