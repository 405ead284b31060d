"""Speed of the simulator: ten minutes of one foot with every effect, and both feet live.

    python -m benchmarks.physics.simulator

The first writes a recording (walking, every law that there is, candump text) on one core; at least 30 times real time
is asked for, 20 s. The second plays both feet of the built-in rig for half a minute, 5 600 frames a second, with every
effect on too, through the sink of SocketCAN into a socket that nobody reads; at most 15 % of a core is asked for.

Takes about a minute.
"""

from __future__ import annotations

import os
import socket
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

from insole_daemon.bus.sink import SocketCanSink
from insole_daemon.config import Config
from insole_daemon.physics.effect import Effect, Where, effect
from insole_daemon.physics.effects import laws
from insole_daemon.physics.sampling import CDC_HZ
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial
from insole_daemon.skin.layout import Layout

SECONDS = 600.0
LIVE_SECONDS = 30.0
SEED = 1


def every_effect(layout: Layout) -> list[Effect]:
    """One of each law, of ordinary size; a board or two triangles where an effect is not of the whole insole."""
    front, *_, rear = layout.triangles
    board = Where("board", ((rear.board,),))
    effects = [
        effect("map_transform", x_mm=2.0, y_mm=-1.0, rotation_deg=1.0, scale=1.0),
        effect("swapped_triangles", pair=[[front.board, front.triangle], [rear.board, rear.triangle]]),
        effect("preload", p0_pa=3000.0),
        effect("crosstalk", k=0.1),
        effect("hysteresis", r_pa=[500.0, 2000.0, 8000.0], w=[0.02, 0.02, 0.03]),
        effect("snap", board, up_pa=35e3, down_pa=15e3, step_pa=2000.0),
        effect("viscoelasticity", a=0.08, tau_s=0.4),
        effect("creep", a=[0.01, 0.01, 0.02], tau_s=[2.0, 20.0, 200.0]),
        effect("power_creep", a=0.03, exponent=0.2, t0_s=60.0),
        effect("lag", tau_s=0.015),
        effect(
            "plates", board, area_mm2=19.0, gap_mm=2.0, stiffness_n_per_m=9000.0, permittivity=1.5, ff_per_count=0.96
        ),
        effect("permittivity", gas_permittivity=1.0, solid_permittivity=2.5, solid_share=0.1, rest_count=300.0),
        effect("stiffening", knee_pa=300e3, span_pa=500e3),
        effect("gain", gain=1.05),
        effect("baseline", shift_count=1.5),
        effect("temperature", count_per_k=0.3, gain_per_k=0.003, t0_c=25.0),
        effect("compensation", skin_type=0, generation=4, count_per_k=0.2, t0_c=25.0),
        effect("drift", t_s=[0.0, 300.0, 600.0], shift_count=[0.0, -1.0, -3.0]),
        effect("rezero", board, t_s=200.0, shift_count=2.0),
        effect("bit_shift", board, shift=2),
        effect("sample_and_hold", rate_hz=CDC_HZ),
        effect("delay", delay_s=0.02),
        effect("jitter", std_s=0.001),
        effect("loss", share=0.001, run=5.0),
        effect("clock", offset_s=0.3, rate=5e-5),
    ]
    assert {each.law.word for each in effects} == set(laws()), "one of each"
    return effects


def trial(config: Config) -> Trial:
    layouts = [load_layout(insole) for insole in config.insoles]
    effects = {layout.foot: every_effect(layout) for layout in layouts}
    return Trial("walk", config, layouts, effects=effects, seed=SEED)


def written() -> None:
    config = Config()
    one_foot = replace(config, insoles=config.insoles[:1])
    with tempfile.TemporaryDirectory() as folder:
        began, cpu = time.perf_counter(), time.process_time()
        log = trial(one_foot).write(Path(folder) / "walk", SECONDS) / "can.log"
        took, cpu = time.perf_counter() - began, time.process_time() - cpu
        print(
            f"{SECONDS:.0f} s of one foot, {len(laws())} effects, {log.stat().st_size / 1e6:.0f} MB of candump: "
            f"{took:.1f} s, {cpu:.1f} s of CPU (at most 20 s are asked for)"
        )


def live() -> None:
    player = trial(Config()).emulator
    unread = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    unread.bind(("127.0.0.1", 0))
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.connect(unread.getsockname())
    sink = SocketCanSink(out, "loopback")
    player.play(sink.send, threading.Event(), 1.0)  # what is done once is not the live path's
    cpu, began = time.process_time(), time.perf_counter()
    sent = player.play(sink.send, threading.Event(), LIVE_SECONDS)
    took = time.perf_counter() - began
    unread.close()
    share = (time.process_time() - cpu) / took
    print(f"live, both feet: {sent / took:.0f} frames/s, {share:.1%} of a core (at most 15 % are asked for)")


def main() -> None:
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    written()
    live()


if __name__ == "__main__":
    main()
