"""Steps of simulated steady walking against the person's own: times, forces, impulses, path of the CoP.

    python -m benchmarks run gait.walk

Takes 4 minutes.

60 s of T4, T5 and T6, through boards, bus, digitiser, noise and the daemon's reader, with the true static calibration.
Truth is the person's own force every 0.5 ms: contact is where it leaves 0, toe-off where it is 0 again; the CoP counts
where a tenth of the step's peak force is borne, as in the table. `ordinary` adds viscoelasticity, hysteresis, a bus
that is 20 ms late and the converters' 27 Hz hold, which no static calibration knows of; `ordinary, delay stated` is the
same recording with the delay of the bus in the calibration. `creep, drift` has other laws than the analysis assumes.
Ratios are of steady steps: mean ± SD.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import insole_daemon
from benchmarks.physics.paper_phenomenon import ordinary
from insole_daemon.config import Config
from insole_daemon.mechanics.gait.steps import Steps
from insole_daemon.physics.effect import Effect, effect
from insole_daemon.recording.loading import FootRecording
from insole_daemon.recording.steps import step_table
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.conditions import Conditions
from insole_daemon.simulation.foot import Person
from insole_daemon.simulation.trial import START_NS, Trial

EVERY_S = 0.0005
RATIOS = ("peak_force_n", "impulse_n_s", "cop_path_m", "cop_width_m", "loading_rate_n_s")


def compare(steps: Steps, person: Person, seconds: float) -> tuple[list[float], dict[str, list[float]]]:
    """Errors of contact and toe-off of steady steps in s, and table over truth of each figure."""
    errors_s: list[float] = []
    ratios: dict[str, list[float]] = {name: [] for name in RATIOS}
    offset_s = (steps.start_ns - START_NS) * 1e-9
    t_s = np.arange(0, seconds, EVERY_S)
    for foot in ("left", "right"):
        wrench = person.reference(foot, t_s)
        f_z = wrench["fz_n"]
        edges = np.flatnonzero(np.diff((f_z > 0).astype(np.int8)))
        steady = steps.of(foot).steady
        for number in range(len(steady)):
            middle = int(((steady["contact_s"] + steady["toe_off_s"])[number] / 2 + offset_s) / EVERY_S)
            first, last = edges[edges < middle][-1] + 1, edges[edges >= middle][0]
            errors_s += [
                float(steady["contact_s"][number]) + offset_s - t_s[first],
                float(steady["toe_off_s"][number]) + offset_s - t_s[last],
            ]
            rows = slice(first, last + 1)
            borne = f_z[rows] >= 0.1 * f_z[rows].max()
            x = -wrench["my_nm"][rows][borne] / f_z[rows][borne]
            y = wrench["mx_nm"][rows][borne] / f_z[rows][borne]
            early = f_z[rows][: (last - first) // 2]
            rise = (np.argmax(early >= 0.8 * early.max()) - np.argmax(early >= 0.2 * early.max())) * EVERY_S
            truth = {
                "peak_force_n": f_z[rows].max(),
                "impulse_n_s": f_z[rows].sum() * EVERY_S,
                "cop_path_m": np.hypot(np.diff(x), np.diff(y)).sum(),
                "cop_width_m": np.ptp(y),
                "loading_rate_n_s": 0.6 * early.max() / rise,
            }
            for name, value in truth.items():
                ratios[name].append(float(steady[name][number]) / float(value))
    return errors_s, ratios


def creep_and_drift() -> list[Effect]:
    """Return a memory of several time constants, a strong loop and a temperature that changes the baselines."""
    return [
        effect("creep", a=[0.04, 0.03], tau_s=[0.6, 8.0]),
        effect("hysteresis", r_pa=[2000.0, 15000.0], w=[0.04, 0.06]),
        effect("drift", t_s=[0.0, 60.0], shift_count=[0.0, 3.0]),
    ]


def main() -> None:
    config = Config()
    layouts = [load_layout(insole) for insole in config.insoles]
    figures = " | ".join(RATIOS)
    print(f"| walk | steady steps | contact, toe-off RMS | {figures} |\n|---|---|---|" + "---|" * len(RATIOS))
    kinds = (("noise only", ()), ("ordinary", ordinary()), ("creep, drift", creep_and_drift()))
    for words, effects in kinds:
        for task, mass_kg in (("t4", 45.0), ("t5", 63.0), ("t6", 95.0)):
            of_feet = {layout.foot: effects for layout in layouts}
            trial = Trial(task, config, layouts, effects=of_feet, conditions=Conditions(mass_kg=mass_kg), seed=3)
            with tempfile.TemporaryDirectory() as folder:
                recording = insole_daemon.load(trial.write(Path(folder) / task, 60.0))
            assert isinstance(trial.load, Person)
            print_row(f"{words}, {task}, {mass_kg:g} kg", recording.steps, trial.load)
            if delays := [stated_effect for stated_effect in effects if stated_effect.law.word == "delay"]:
                stated = step_table([with_effects(foot, delays) for foot in recording.feet])
                print_row(f"{words}, delay stated, {task}, {mass_kg:g} kg", stated, trial.load)


def with_effects(foot: FootRecording, effects: Sequence[Effect]) -> FootRecording:
    """Return `foot` with a calibration that states `effects`."""
    assert foot.calibration is not None
    return replace(foot, calibration=replace(foot.calibration, effects=tuple(effects)))


def print_row(words: str, steps: Steps, person: Person) -> None:
    errors_s, ratios = compare(steps, person, 60.0)
    rms_ms = 1e3 * np.sqrt(np.mean(np.square(errors_s)))
    cells = " | ".join(
        f"{100 * np.mean(ratios[name]) - 100:+.1f} ± {100 * np.std(ratios[name]):.1f} %" for name in RATIOS
    )
    print(f"| {words} | {len(errors_s) // 2} | {rms_ms:.1f} ms | {cells} |", flush=True)


if __name__ == "__main__":
    main()
