"""CPU time, stability and accuracy of live compensation with the dynamic model.

    python -m benchmarks.physics.compensation              # cost of a cycle, walks
    python -m benchmarks.physics.compensation --day        # a simulated day, too

The cost is that of a foot's messages by the daemon's own code, without effects, with four of them and with the
compensator of effects.py (8 low-passes, 3 plays, 6 relays), in turn; CPU time of this process. Walks are those of the
simulator (t4, 40 s, a count of noise, the shoe without any), with the true curves and effects as the model; f_z is
compared with the shoe's at the times that the daemon stamps, less the 10 ms that triangles are old on average.

Takes about 5 minutes; the simulated day some minutes more.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import insole_daemon
from benchmarks.physics.effects import BOARDS, COMPENSATOR, cubic, walk
from insole_daemon.config import Config
from insole_daemon.diagnosis.compensation import of_walk
from insole_daemon.physics import effects_document
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.dynamic import DynamicModel
from insole_daemon.physics.effect import Effect, effect
from insole_daemon.physics.static_curve import StaticCurve
from insole_daemon.service.foot import Foot
from insole_daemon.service.foot_setup import FootSetup, load_setups
from insole_daemon.simulation.conditions import Conditions, InstrumentConditions
from insole_daemon.simulation.trial import Trial
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import builtin

LAYOUT = builtin("left", (5, 6, 7))
HYSTERESIS = effect("hysteresis", r_pa=[3e3, 1e4, 3e4], w=[0.1, 0.08, 0.06])
VISCOELASTICITY = effect("viscoelasticity", a=0.15, tau_s=0.3)
DELAY = effect("delay", delay_s=0.025)
FOUR = (HYSTERESIS, VISCOELASTICITY, effect("lag", tau_s=0.02), DELAY)
WALKS: dict[str, tuple[Effect, ...]] = {
    "nothing": (),
    "delay 25 ms": (DELAY,),
    "lag 20 ms": (effect("lag", tau_s=0.02),),
    "lag 80 ms": (effect("lag", tau_s=0.08),),
    "viscoelasticity 15 %": (VISCOELASTICITY,),
    "hysteresis": (HYSTERESIS,),
    "hysteresis, viscoelasticity, lag 20 ms, delay 25 ms": FOUR,
}
AGE_S = 0.01
FULL_SCALE_PA = 350e3
ROUNDS = 5
PERIOD_NS = 20_000_000


def cycles(counts: NDArray[np.uint8]) -> Cycles:
    """Complete ones, 20 ms apart."""
    n = len(counts)
    wide, flags = np.zeros((n, len(LAYOUT)), np.int64), np.zeros(n, bool)
    t_ns = PERIOD_NS * np.arange(1, n + 1)
    return Cycles(
        t_ns, 10**18 + t_ns, counts, wide.astype(np.uint16), wide, wide, wide + 2 * np.arange(n)[:, None],
        wide > 0, flags, flags,
    )  # fmt: skip


def cost(n: int) -> None:
    """Microseconds of a cycle and foot, medians of ROUNDS."""
    calibration = cubic(LAYOUT)
    counts = np.rint(Chain([], LAYOUT, calibration).forward()(walk(n, 50.0), np.arange(n) / 50.0))
    closed = cycles(np.nan_to_num(counts, nan=240).clip(1, 254).astype(np.uint8))
    setup: FootSetup = replace(load_setups(Config())[0], calibration=calibration)
    kinds: dict[str, Sequence[Effect]] = {"no effects": (), "four": FOUR, "compensator of effects.py": COMPENSATOR}
    spent_us: dict[str, list[float]] = {name: [] for name in kinds}
    for _ in range(ROUNDS):
        for name, effects in kinds.items():
            foot = Foot(replace(setup, calibration=replace(calibration, effects=tuple(effects))))
            begin = time.process_time_ns()
            for at in range(n):
                foot.messages(closed, at)
            spent_us[name].append((time.process_time_ns() - begin) * 1e-3 / n)
    plain = float(np.median(spent_us["no effects"]))
    for name, times_us in spent_us.items():
        middle = float(np.median(times_us))
        print(f"a cycle of one foot, {name}: {middle:.0f} µs" + (f", {middle - plain:+.0f} µs" if times_us else ""))


def walks() -> None:
    """The table."""
    exact = InstrumentConditions(
        offset_s=0.0, rate_ppm=0.0, force_noise_n=0.0, force_drift_n=0.0, moment_noise_nm=0.0, moment_drift_nm=0.0
    )
    conditions = Conditions(length_s=40.0, reference=exact)
    print("\n| in the insole | static, RMSE of f_z, N | its best shift taken out | dynamic |\n|---|---|---|---|")
    for name, effects in WALKS.items():
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "walk"
            Trial("t4", Config(), [LAYOUT], effects={"left": effects}, conditions=conditions, seed=5).write(folder)
            document = json.loads(next(folder.glob("*calibration.json")).read_text())
            shoe = insole_daemon.load(folder)["left"].reference
            assert shoe is not None
            assert shoe.time_s is not None
            errors = []
            for own in ((), effects):
                path = Path(place) / "model.json"
                path.write_text(json.dumps(document | {"effects": effects_document.document(own, LAYOUT)}))
                t_s, f_z_n = of_walk(path, folder)["left"]
                left = [
                    float(np.sqrt(np.mean((f_z_n - np.interp(t_s - late_s, shoe.time_s, shoe["fz_n"])) ** 2)))
                    for late_s in (AGE_S, *np.arange(0.0, 0.1, 0.002))
                ]
                errors.append((left[0], min(left)))
        (static, shifted), (dynamic, _) = errors
        print(f"| {name} | {static:.1f} | {shifted:.1f} | {dynamic:.1f} |", flush=True)


def day() -> None:
    """24 hours of the same walk: whether what is remembered builds up."""
    calibration = replace(cubic(LAYOUT), effects=(*FOUR, effect("creep", a=[0.03, 0.02], tau_s=[5.0, 500.0])))
    step = np.rint(Chain([], LAYOUT, calibration).forward()(walk(3300, 50.0), np.arange(3300) / 50.0))
    model = DynamicModel(LAYOUT, calibration, BOARDS, 0, zeroed=False)
    static_pa = StaticCurve(calibration, 0.0).pressure_pa(step)
    valid = np.tile(PRESSURE_TAXELS, (len(step), len(LAYOUT), 1))
    seconds = np.arange(len(step)) / 50.0
    began, minutes = time.process_time(), 24 * 60 * 50 * 60 // len(step)
    early = late = model(static_pa, step, valid, seconds).pressure_pa
    for k in range(1, minutes):
        late = model(static_pa, step, valid, seconds + k * len(step) / 50.0).pressure_pa
        if k == minutes // 2:
            early = late
    apart = float(np.nanmax(np.abs(late - early)))
    finite = bool(np.isfinite(late[valid]).all())
    print(
        f"\na day of {minutes * len(step):,} cycles took {time.process_time() - began:.0f} s of CPU: finite {finite}, "
        f"the last minute {apart / FULL_SCALE_PA:.1e} of full scale from that of noon"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cycles", type=int, default=2000, help="whose cost is measured, in each round")
    parser.add_argument("--day", action="store_true", help="a simulated day of one foot, some minutes")
    options = parser.parse_args()
    cost(options.cycles)
    walks()
    if options.day:
        day()


if __name__ == "__main__":
    main()
