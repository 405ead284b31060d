"""Error of the wrench with 3 of 28 triangles loose, and whether the stated uncertainty covers it.

    python -m benchmarks.faults.missing_area [cases, 40] [first seed, 1000]

Emulated boards under a person who walks or stands, twice with the same noise: whole, and with three random triangles of
one foot open, status bits off. Compared in every cycle of a foot, with the messages that the daemon would publish:

- the error, against what the three triangles bear in the whole one: what the missing area alone explains;
- the error, and the stated standard deviation: |error| ≤ 1 stated standard deviation, for f_z and both moments; once
  against the wrench of the whole one, once against the load itself, whose noise and gain errors are in no field.

Takes about 10 minutes.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from benchmarks.faults.detection import CONFIG, LAYOUTS, START_NS, Person
from insole_daemon.physics import calibration as calibrations
from insole_daemon.service.foot import Foot
from insole_daemon.service.foot_setup import FootSetup
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.simulation.generation import GenerationName
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.reader import SkinReader
from insole_daemon.wire.messages import Wrench

SECONDS, LOOSE_FROM_S, COMPARED_FROM_S = 12.0, 2.0, 2.1
NAMES = ("f_z_n", "m_x_nm", "m_y_nm")
STD_NAMES = ("f_z_std_n", "m_x_std_nm", "m_y_std_nm")


def messages_of(
    foot: int, person: Person, generation: GenerationName, seed: int, faults: list[InjectedFault]
) -> tuple[Cycles, list[Wrench], NDArray[np.float64]]:
    """The cycles of one foot, their wrenches, and (n, n_triangles, 12) pressure where valid, else 0."""
    layout, insole = LAYOUTS[foot], CONFIG.insoles[foot]
    emulator = Emulator(CONFIG, [layout], person, seed=seed, generation=generation, faults=faults, status_bits=False)
    reader = SkinReader([layout], period_ns=20_000_000, slack_ns=5_000_000)
    (closed,) = reader.feed(emulator.frames(START_NS, SECONDS))
    cycles = Cycles.concatenate(closed, len(layout))
    live = Foot(FootSetup(CONFIG, insole, layout, calibrations.default(layout, insole.boards), None, "none"))
    wrenches, pressures = [], []
    for at in range(len(cycles)):
        _, pressure, wrench, _ = live.messages(cycles, at)
        live.watch(cycles, at)
        wrenches.append(wrench)
        pressures.append(np.where(pressure.valid, pressure.pressure_pa, 0))
    return cycles, wrenches, np.array(pressures)


def case(seed: int) -> NDArray[np.float64]:
    """(n_cycles, 3, 4): of f_z and the moments the error, what was missing, the stated std, the error to the load."""
    rng = np.random.default_rng([seed, 5])
    foot, generation = int(rng.integers(2)), ("mtb3", "mtb4")[rng.integers(2)]
    person = Person(LAYOUTS, seed)
    layout = LAYOUTS[foot]
    rows = rng.choice(len(layout), 3, replace=False)
    loose = [
        InjectedFault("loose", LOOSE_FROM_S, None, layout.triangles[row].board, layout.triangles[row].triangle)
        for row in rows
    ]
    cycles, whole, pressures = messages_of(foot, person, generation, seed, [])
    same, part, _ = messages_of(foot, person, generation, seed, loose)
    t_s = (cycles.t_mono_ns - START_NS) * 1e-9
    assert np.allclose(cycles.t_mono_ns, same.t_mono_ns, rtol=0, atol=1e6)  # the length of a frame depends on its bits
    x, y = layout.xy_m[..., 0], layout.xy_m[..., 1]
    arms = layout.taxel_area_m2 * np.stack([np.ones_like(x), y, -x])
    missing = np.einsum("krt,nrt->nk", arms[:, rows], pressures[:, rows])
    # Every triangle when it was read: up to a cycle ago.
    read_s = (cycles.triangle_t_ns - START_NS) * 1e-9
    load = np.stack([person.pressure_pa(layout.foot, read_s[:, row])[:, row] for row in range(len(layout))], axis=1)
    truth = np.einsum("krt,nrt->nk", arms, load)
    estimates = np.array([[getattr(wrench, name) for name in NAMES] for wrench in part])
    std = np.array([[getattr(wrench, name) for name in STD_NAMES] for wrench in part])
    reference = np.array([[getattr(wrench, name) for name in NAMES] for wrench in whole])
    return np.stack([estimates - reference, missing, std, estimates - truth], axis=2)[t_s >= COMPARED_FROM_S]


def main() -> None:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    cases = [case(seed + number) for number in range(n)]
    every = np.concatenate(cases)
    print(f"{n} cases, {len(every)} cycles; three of 28 triangles open, MTB3 and MTB4, walking and standing")
    for number, name in enumerate(NAMES):
        error, missing, std, to_load = every[:, number].T
        inside, inside_load = np.abs(error) <= std, np.abs(to_load) <= std
        worst = min(float((np.abs(of[:, number, 0]) <= of[:, number, 2]).mean()) for of in cases)
        unexplained = np.abs(error + missing)
        print(
            f"{name:7} rms error {np.sqrt((error**2).mean()):7.2f}   error beyond what is missing: at most "
            f"{unexplained.max():.1e}   inside the stated std: {100 * inside.mean():.1f} % of cycles, "
            f"{100 * worst:.1f} % in the worst case; of the load itself {100 * inside_load.mean():.1f} %   "
            f"rms of the std {np.sqrt((std**2).mean()):.2f}"
        )


if __name__ == "__main__":
    main()
