"""The published phenomenon, simulated: a static calibration that is right for standing is wrong for walking.

    python -m benchmarks.physics.paper_phenomenon

Sorrentino et al. 2020 fitted a cubic for each taxel to a vacuum bag and to slow trials in force shoes (T1 to T3), and
validated standing and walking (T4 to T6): the RMSE of f_z rose from 8 N to 95 N. This benchmark repeats it with one
simulated insole in two versions: with noise and digitisation only, and with usual viscoelasticity, hysteresis and
timing (a delay of the bus, the converters' 27 Hz hold). Each version is calibrated by `insole calibrate --method paper`
on the bag and T1 to T3 of a person of 63 kg, and validated on T1 to T6 of one of 54 kg, with other noise and without
smoothing.

The clock of the reference is corrected in all trials, so the remaining delay is the insole's. With physics, all counts
of a row have the row's time, as published, although boards are not synchronised. This is an error of timing, too; with
noise only, each triangle therefore has its own acquisition time, and `as rows` shows the error without that. `delay
removed` is the error with physics after the one shift of T4 to T6 that fits f_z best, as when two recordings are
aligned by their shape. Standing means standing still, as in the paper, without the steps on and off.

Takes about 10 minutes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

import insole_daemon
from insole_daemon.calibration.calibrating import Calibrated, calibrate, curve_pa
from insole_daemon.config import Config
from insole_daemon.physics.effect import Effect, effect
from insole_daemon.physics.sampling import CDC_HZ
from insole_daemon.recording.loading import FootRecording, Recording
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.conditions import ChamberCycles, Conditions, InstrumentConditions
from insole_daemon.simulation.trial import START_NS, Trial

SEED = 1
PAPER_N = {"t1": 7.6, "t2": 11.9, "t3": 34.2, "t4": 93.4, "t5": 84.9, "t6": 95.2}
CALIBRATED_ON = ("vacuum", "t1", "t2", "t3")
WHOLE_TRIALS: Mapping[str, float] = {}
STANDING, WALKING = ("t1", "t2"), ("t4", "t5", "t6")
MASS_KG = {"calibrated": 63.0, "validated": 54.0}
SHIFTS_S = np.arange(-0.1, 0.1001, 0.005)
_SETTLED_S = 5.0  # after the start of a task the weight is on since 2 s
_LEFT = Config(insoles=Config().insoles[:1])
_LAYOUT = load_layout(_LEFT.insoles[0])
_PUBLISHED = ChamberCycles(max_pressure_pa=90e3, speeds_pa_s=(3e3,), cycles=3, hold_s=0.0, minor=())  # section 4.1
_RIGHT_CLOCK = InstrumentConditions(offset_s=0.0, rate_ppm=0.0)


@dataclass(frozen=True, slots=True)
class Errors:
    """RMSE of one task against the force shoe."""

    f_z_n: float
    m_x_nm: float
    m_y_nm: float
    highest_pa: float  # that a taxel seemed to bear
    rows_f_z_n: float  # with the counts as they came, each row at one moment
    shifted_n: NDArray[np.float64]  # (shifts,) of that, with the reference taken that much earlier


def ordinary() -> list[Effect]:
    return [
        effect("viscoelasticity", a=0.05, tau_s=0.3),
        effect("hysteresis", r_pa=[1000.0, 4000.0], w=[0.03, 0.03]),
        effect("sample_and_hold", rate_hz=CDC_HZ),
        effect("delay", delay_s=0.02),
    ]


def recorded(name: str, whose: Literal["calibrated", "validated"], physics: bool, seconds: float | None) -> Recording:
    """A trial of the left foot, read as every recording is; of `seconds` at the most."""
    chamber = name == "vacuum"
    conditions = Conditions(
        mass_kg=None if chamber else MASS_KG[whose],
        chamber=_PUBLISHED if chamber else None,
        reference=_RIGHT_CLOCK,
        take=0 if whose == "calibrated" else 1,
    )
    effects = {"left": ordinary()} if physics else {}
    trial = Trial(name, _LEFT, [_LAYOUT], effects=effects, seed=SEED, conditions=conditions)
    with tempfile.TemporaryDirectory() as folder:
        return insole_daemon.load(trial.write(Path(folder) / name, seconds))


def at_one_moment(foot: FootRecording) -> NDArray[np.float64]:
    """(n, n_triangles, 12) counts at the cycles' times: linear between the moments at which a triangle was read."""
    t_s = (foot.t_ns - START_NS) * 1e-9
    counts = foot.counts.astype(np.float64)
    for row, own_s in enumerate((t_s[:, None] - foot.age_ns * 1e-9).T):
        new = np.flatnonzero(np.diff(own_s, prepend=-np.inf) > 1e-6)
        for taxel in range(counts.shape[2]):
            counts[:, row, taxel] = np.interp(t_s, own_s[new], counts[new, row, taxel])
    return counts


def validate(recording: Recording, calibrated: Calibrated, as_rows: bool) -> Errors:
    """Of a trial against what its force shoe said at the same moments."""
    foot = recording["left"]
    arm_x, arm_y = _LAYOUT.xy_m.reshape(-1, 2)[calibrated.slots].T
    arms = _LAYOUT.taxel_area_m2 * np.stack([np.ones_like(arm_x), arm_y, -arm_x])
    reference = foot.reference
    t_s = (foot.t_ns - START_NS) * 1e-9

    def pressures_pa(counts: NDArray[np.float64]) -> NDArray[np.float64]:
        activation = calibrated.rest_count - counts.reshape(len(counts), -1)
        return curve_pa(calibrated.fit.coefficients_pa, activation[:, calibrated.slots])

    def said(shift_s: float) -> NDArray[np.float64]:
        own_s = reference.time_s - START_NS * 1e-9
        return np.stack([np.interp(t_s - shift_s, own_s, reference[c]) for c in ("fz_n", "mx_nm", "my_nm")], axis=1)

    name = recording.folder.name
    counts = np.ones(len(t_s), bool)
    if name in STANDING:
        counts = (t_s > _SETTLED_S) & (t_s < t_s[-1] - _SETTLED_S)
    rows_pa = pressures_pa(foot.counts)
    pressure_pa = rows_pa if as_rows else pressures_pa(at_one_moment(foot))
    errors = np.sqrt(np.mean((pressure_pa @ arms.T - said(0.0))[counts] ** 2, axis=0))
    rows = rows_pa @ arms.T
    shifted = [float(np.sqrt(np.mean((rows - said(shift_s))[counts, 0] ** 2))) for shift_s in SHIFTS_S]
    rows_n = float(np.sqrt(np.mean((rows - said(0.0))[counts, 0] ** 2)))
    return Errors(*errors.tolist(), float(pressure_pa[counts].max()), rows_n, np.array(shifted))


def experiment(
    physics: bool, tasks: Sequence[str], seconds: float | None = None, calibration_s: Mapping[str, float] = WHOLE_TRIALS
) -> dict[str, Errors]:
    """Return the errors of `tasks` after a calibration.

    `seconds` are recorded of each task at the most, and `calibration_s` of the trials for the calibration, by name.
    """
    trials = [recorded(name, "calibrated", physics, calibration_s.get(name)) for name in CALIBRATED_ON]
    calibrated = calibrate(trials, "left", "paper")
    return {
        name: validate(recorded(name, "validated", physics, seconds), calibrated, as_rows=physics) for name in tasks
    }


def delay_removed(errors: dict[str, Errors]) -> dict[str, float]:
    """RMSE of f_z with the shift that suits all walking best."""
    best = int(np.argmin(sum(errors[name].shifted_n ** 2 for name in WALKING)))
    return {name: float(each.shifted_n[best]) for name, each in errors.items()}


def main() -> None:
    noise, physics = (experiment(on, list(PAPER_N)) for on in (False, True))
    print("RMSE of f_z (N), m_x, m_y (N·m), highest pressure (kPa)")
    print(f"{'':4}{'noise only':^32}{'as rows':>8}{'with physics':^32}{'delay removed':>15}{'paper, f_z':>12}")
    removed = delay_removed(physics)
    for name, paper_n in PAPER_N.items():
        cells = [
            f"{e.f_z_n:8.1f}{e.m_x_nm:8.2f}{e.m_y_nm:8.2f}{e.highest_pa / 1e3:8.0f}"
            for e in (noise[name], physics[name])
        ]
        print(f"{name:4}{cells[0]}{noise[name].rows_f_z_n:8.1f}{cells[1]}{removed[name]:15.1f}{paper_n:12.1f}")
    for what, tasks in (("standing", STANDING), ("walking", WALKING)):
        means = [np.mean([each[name].f_z_n for name in tasks]) for each in (noise, physics)]
        rows_n = np.mean([noise[name].rows_f_z_n for name in tasks])
        removed_n = np.mean([removed[name] for name in tasks])
        print(
            f"{what}: {means[0]:.1f} N with noise only ({rows_n:.1f} as rows), {means[1]:.1f} N with physics, "
            f"{means[1] / means[0]:.1f} times; {removed_n:.1f} N with the delay removed"
        )


if __name__ == "__main__":
    main()
