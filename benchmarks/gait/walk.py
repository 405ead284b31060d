"""Errors of step times, forces, impulses and CoP paths in simulated steady walking.

    python -m benchmarks run gait.walk

Takes 4 minutes.

60 s of T4, T5 and T6, through boards, bus, digitiser, noise and the daemon's reader, with the true static calibration.
Truth is the person's own force every 0.5 ms: contact is where it leaves 0, toe-off where it is 0 again; the CoP counts
where a tenth of the step's peak force is borne, as in the table. Every effect of `ordinary` and of `creep, drift` is
also there alone, so that the table shows what an error is made of. Rows below a walk are the same recording with more
known of it:

- `delay stated`: the calibration has the delay of the bus;
- `diagnosed`: the calibration is the model that `insole diagnose` made of another walk of another person on the same
  insole, with a force plate on the clock of the frames;
- `true effects`: the calibration has the laws that the simulator applies, which bounds what any analysis can reach;
- `body weight`: as recorded, scaled to the mass of the person.

Errors of contact and toe-off are mean ± SD, ratios mean ± SD, of steady steps.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import insole_daemon
from benchmarks.physics.paper_phenomenon import ordinary
from insole_daemon.config import Config
from insole_daemon.mechanics.gait.body_weight import scale_to_body_weight
from insole_daemon.mechanics.gait.steps import Steps
from insole_daemon.physics.effect import Effect, effect
from insole_daemon.physics.effects_document import document
from insole_daemon.recording.loading import FootRecording
from insole_daemon.recording.steps import step_table
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.conditions import Conditions, InstrumentConditions
from insole_daemon.simulation.foot import Person
from insole_daemon.simulation.trial import START_NS, Trial
from insole_daemon.skin.layout import Layout

EVERY_S = 0.0005
SECONDS = 60.0
SEED = 3  # of the insoles and of the walks; nothing was chosen on these
PERSONS = (("t4", 45.0), ("t5", 63.0), ("t6", 95.0))
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


def walks() -> dict[str, list[Effect]]:
    """Return the effects in the sensors of each kind of walk."""
    kinds = {"noise only": [], "ordinary": ordinary(), "creep, friction, drift": creep_and_drift()}
    alone = [effect for effects in kinds.values() for effect in effects]
    return kinds | {f"{effect.law.word} of {', '.join(_values(effect))}": [effect] for effect in alone}


def main() -> None:
    config = Config()
    layouts = [load_layout(insole) for insole in config.insoles]
    figures = " | ".join(RATIOS)
    print(f"| walk | steady steps | contact | toe-off | RMS of both | RMS of stance | {figures} |")
    print("|---|---|---|---|---|---|" + "---|" * len(RATIOS), flush=True)
    for words, effects in walks().items():
        whole = len(effects) != 1
        with tempfile.TemporaryDirectory() as made:
            folder = Path(made)
            models = diagnose(config, layouts, effects, folder) if whole and effects else []
            for task, mass_kg in PERSONS if whole else PERSONS[1:2]:
                of_feet = {layout.foot: effects for layout in layouts}
                trial = Trial(task, config, layouts, effects=of_feet, conditions=Conditions(mass_kg=mass_kg), seed=SEED)
                written = trial.write(folder / task, SECONDS)
                assert isinstance(trial.load, Person)
                recording, name = insole_daemon.load(written), f"{words}, {task.upper()}, {mass_kg:g} kg"
                print_row(name, recording.steps, trial.load)
                if not (whole and effects):
                    continue
                if delays := [stated for stated in effects if stated.law.word == "delay"]:
                    stated_delay = step_table([with_effects(foot, delays) for foot in recording.feet])
                    print_row("– delay stated", stated_delay, trial.load)
                print_row("– body weight", scale_to_body_weight(recording.steps, mass_kg), trial.load)
                print_row("– diagnosed", insole_daemon.load(written, models).steps, trial.load)
                true = [write_model(written, layout, effects) for layout in layouts]
                print_row("– true effects", insole_daemon.load(written, true).steps, trial.load)


def diagnose(config: Config, layouts: Sequence[Layout], effects: Sequence[Effect], folder: Path) -> list[Path]:
    """Return the models, one a foot, that `insole diagnose` makes of a walk of another person on the same insoles."""
    conditions = Conditions(mass_kg=75.0, take=1, reference=InstrumentConditions(offset_s=0.0, rate_ppm=0.0))
    of_feet = {layout.foot: effects for layout in layouts}
    trial = Trial("t5", config, layouts, effects=of_feet, conditions=conditions, seed=SEED)
    written = trial.write(folder / "plate", SECONDS)
    about = written / "recording.yaml"
    about.write_text(about.read_text().replace("clock: own", "clock: can"))
    models = []
    for layout in layouts:
        out = folder / f"diagnosis-{layout.foot}"
        command = [sys.executable, "-m", "insole_daemon", "diagnose", str(written)]
        done = subprocess.run([*command, "--foot", layout.foot, "--out", str(out)], capture_output=True, text=True)
        models.append(out / "model.json")
        if not models[-1].exists():
            raise SystemExit(done.stderr)
        entries = json.loads(models[-1].read_text())["effects"]
        print(f"{layout.foot}: found {', '.join(entry['effect'] for entry in entries) or 'nothing'}", file=sys.stderr)
    return models


def write_model(recording: Path, layout: Layout, effects: Sequence[Effect]) -> Path:
    """Write the calibration of a foot with `effects` into the folder of the recording, and return the file."""
    model = json.loads((recording / f"{layout.foot}-calibration.json").read_text())
    model["effects"] = document([effect for effect in effects if effect.law.word != "drift"], layout)
    file = recording / f"{layout.foot}-true.json"
    file.write_text(json.dumps(model))
    return file


def with_effects(foot: FootRecording, effects: Sequence[Effect]) -> FootRecording:
    """Return `foot` with a calibration that states `effects`."""
    assert foot.calibration is not None
    return replace(foot, calibration=replace(foot.calibration, effects=tuple(effects)))


def print_row(words: str, steps: Steps, person: Person) -> None:
    errors_s, ratios = compare(steps, person, SECONDS)
    ms = 1e3 * np.array(errors_s).reshape(-1, 2)
    times = [f"{mean:+.1f} ± {spread:.1f} ms" for mean, spread in zip(ms.mean(axis=0), ms.std(axis=0), strict=True)]
    times += [f"{np.sqrt(np.mean(values**2)):.1f} ms" for values in (ms, ms[:, 1] - ms[:, 0])]
    cells = [f"{100 * np.mean(ratios[name]) - 100:+.1f} ± {100 * np.std(ratios[name]):.1f} %" for name in RATIOS]
    print(f"| {words} | {len(ms)} | {' | '.join([*times, *cells])} |", flush=True)


def _values(effect: Effect) -> list[str]:
    return [f"{name} {np.array2string(np.asarray(value), separator=' ')}" for name, value in effect.values.items()]


if __name__ == "__main__":
    main()
