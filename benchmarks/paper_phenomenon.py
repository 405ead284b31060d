"""The published phenomenon in simulation: a static calibration that is right for standing is wrong for walking.

    python benchmarks/paper_phenomenon.py

Sorrentino et al. 2020 calibrated a cubic a taxel on slow data (vacuum bag, T1 to T3) and validated walking (T4 to T6):
the error of f_z grew from 8 N standing to 95 N. Here the same insole, twice: with nothing but noise and digitisation,
and with ordinary viscoelasticity, hysteresis and timing (a late bus, the converters' 27 Hz hold) on. Each is calibrated
anew by ordinary least squares, a cubic a taxel, on the slow cycles of a pressure chamber. As in the paper, what is
fitted is a moving average; its regularised fit to the wrench of T1 to T3 is left out. The clocks are aligned
beforehand. Where standing is concerned, what counts is standing still: not the steps on and off the ground.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.physics.effect import Effect, effect
from insole_daemon.physics.sampling import CDC_HZ
from insole_daemon.recording.loading import FootRecording
from insole_daemon.service.setup import load_layout
from insole_daemon.simulation.conditions import Conditions
from insole_daemon.simulation.trial import START_NS, Trial

SEED = 1
PAPER_N = {"t1": 7.6, "t2": 11.9, "t3": 34.2, "t4": 93.4, "t5": 84.9, "t6": 95.2}
STANDING, WALKING = ("t1", "t2"), ("t4", "t5", "t6")
SLOW_PA_S = 15e3  # of the chamber's cycles, those that are fitted
AVERAGED = 25  # samples: half a second
_SETTLED_S = 5.0  # after the start of a task the weight is on since 2 s
_LEFT = Config(insoles=Config().insoles[:1])
_LAYOUT = load_layout(_LEFT.insoles[0])


@dataclass(frozen=True, slots=True)
class Errors:
    """RMSE of one task against the force shoe."""

    f_z_n: float
    m_x_nm: float
    m_y_nm: float
    highest_pa: float  # that a taxel seemed to bear


def ordinary() -> list[Effect]:
    return [
        effect("viscoelasticity", a=0.05, tau_s=0.3),
        effect("hysteresis", r_pa=[1000.0, 4000.0], w=[0.03, 0.03]),
        effect("delay", delay_s=0.02),
    ]


def recorded(name: str, physics: bool, seconds: float | None = None) -> FootRecording:
    """The left foot of a trial, read as every recording is."""
    effects = {"left": ordinary()} if physics else {}
    trial = Trial(
        name, _LEFT, [_LAYOUT], effects=effects, seed=SEED, conditions=Conditions(cdc_hz=CDC_HZ if physics else None)
    )
    with tempfile.TemporaryDirectory() as folder:
        return insole_daemon.load(trial.write(Path(folder) / name, seconds))["left"]


def paired(foot: FootRecording, columns: Sequence[str]) -> tuple[NDArray[np.float64], ...]:
    """(n,) seconds of the cycles since the start, and each column of the reference then."""
    reference = foot.reference
    assert reference is not None
    assert reference.time_s is not None
    t_s = (foot.t_ns - START_NS) * 1e-9
    # The readings are equally spaced on both clocks: first and number give the true times.
    rate_hz = 100.0 if "fz_n" in reference.columns else 50.0
    own_s = np.arange(len(reference)) / rate_hz
    return t_s, *(np.interp(t_s, own_s, reference[name]) for name in columns)


def averaged(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n − AVERAGED, …) the mean of that many samples (n, …)."""
    total = np.cumsum(x, axis=0)
    return (total[AVERAGED:] - total[:-AVERAGED]) / AVERAGED


def calibrate(chamber: FootRecording) -> NDArray[np.float64]:
    """(n_triangles, 12, 4) coefficients of P in powers of the count below 240, least squares over the slow cycles."""
    t_s, pressure_pa = paired(chamber, ["pressure_pa"])
    pressure_pa = averaged(pressure_pa)
    activation = averaged(240.0 - chamber.counts) / 40
    slow = np.abs(pressure_pa[AVERAGED:] - pressure_pa[:-AVERAGED]) < SLOW_PA_S * (t_s[AVERAGED] - t_s[0])
    until = len(slow) if slow.all() else int(np.argmin(slow))
    coefficients = np.zeros((*chamber.counts.shape[1:], 4))
    for row, taxel in np.argwhere(chamber.calibration.usable).tolist():
        powers = activation[:until, row, taxel, None] ** np.arange(4)
        fit = np.linalg.lstsq(powers, pressure_pa[:until], rcond=None)[0]
        coefficients[row, taxel] = fit / 40.0 ** np.arange(4)
    return coefficients


def validate(name: str, foot: FootRecording, coefficients: NDArray[np.float64]) -> Errors:
    t_s, *reference = paired(foot, ["fz_n", "mx_nm", "my_nm"])
    activation = 240.0 - foot.counts.astype(np.float64)
    pressure_pa = np.zeros_like(activation)
    for k in (3, 2, 1, 0):
        pressure_pa = pressure_pa * activation + coefficients[..., k]
    x, y = _LAYOUT.xy_m[..., 0], _LAYOUT.xy_m[..., 1]
    force = pressure_pa * _LAYOUT.taxel_area_m2
    wrench = [(force * arm).sum(axis=(1, 2)) for arm in (1.0, y, -x)]
    counts = np.ones(len(t_s), bool)
    if name in STANDING:
        counts = (t_s > _SETTLED_S) & (t_s < t_s[-1] - _SETTLED_S)
    errors = [float(np.sqrt(np.mean((a - b)[counts] ** 2))) for a, b in zip(wrench, reference, strict=True)]
    return Errors(*errors, float(pressure_pa[counts].max()))


def experiment(physics: bool, tasks: Sequence[str], seconds: float | None = None) -> dict[str, Errors]:
    """The errors of `tasks`, calibrated in the chamber beforehand; `seconds` of each task at the most."""
    coefficients = calibrate(recorded("plenum", physics, None if seconds is None else 150.0))
    return {name: validate(name, recorded(name, physics, seconds), coefficients) for name in tasks}


def main() -> None:
    noise, physics = (experiment(on, list(PAPER_N)) for on in (False, True))
    print("RMSE of f_z (N), m_x, m_y (N·m), highest pressure (kPa)")
    print(f"{'':4}{'noise only':^32}{'with physics':^32}{'paper, f_z':>12}")
    for name, paper_n in PAPER_N.items():
        cells = [
            f"{e.f_z_n:8.1f}{e.m_x_nm:8.2f}{e.m_y_nm:8.2f}{e.highest_pa / 1e3:8.0f}"
            for e in (noise[name], physics[name])
        ]
        print(f"{name:4}{cells[0]}{cells[1]}{paper_n:12.1f}")
    for what, tasks in (("standing", STANDING), ("walking", WALKING)):
        means = [np.mean([each[name].f_z_n for name in tasks]) for each in (noise, physics)]
        print(
            f"{what}: {means[0]:.1f} N with noise only, {means[1]:.1f} N with physics, {means[1] / means[0]:.1f} times"
        )


if __name__ == "__main__":
    main()
