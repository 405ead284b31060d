"""Errors of `insole calibrate` and `insole validate` in the experiment of Sorrentino et al. 2020, simulated.

    python -m benchmarks.calibration.paper_experiment

A person of 63 kg calibrates (bag, T1 to T3), one of 54 kg validates (T1 to T6). The insole has usual viscoelasticity,
hysteresis, sample-and-hold and delay (paper_phenomenon.py). For comparison, the error of noise alone: the true curves
on the same trials without these effects. Errors of standing are those while the reference is steady, errors of walking
those of every cycle; with the clock that fits best, as `validate` uses, and with the true clock, which includes the
insole's delay. Exits with 1 if the error of standing is above 1.5 times that of noise alone.

Takes about 10 minutes.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from benchmarks.physics.paper_phenomenon import CALIBRATED_ON, PAPER_N, STANDING, recorded
from insole_daemon.calibration import document
from insole_daemon.calibration.calibrating import Calibrated, calibrate
from insole_daemon.calibration.validation import Result, ShoeResult, validate
from insole_daemon.physics.calibration import Calibration
from insole_daemon.recording.loading import Recording
from insole_daemon.skin.geometry import N_TAXELS

MOST_TIMES = 1.5  # what noise leaves, standing


def as_the_daemon_reads_it(calibrated: Calibrated, true: Calibration) -> Calibration:
    """The calibration in place of the true one of the recording."""
    shape = true.usable.shape
    slots = calibrated.slots
    k = calibrated.fit.coefficients_pa.shape[1]
    usable = np.zeros(shape[0] * N_TAXELS, bool)
    usable[slots] = True
    coefficients = np.full((usable.size, k), np.nan)
    coefficients[slots] = calibrated.fit.coefficients_pa
    return replace(
        true,
        baseline_count=np.where(usable, calibrated.rest_count, np.nan).reshape(shape),
        coefficients_pa=coefficients.reshape(*shape, k),
        usable=usable.reshape(shape),
        provenance=document.provenance(calibrated),
    )


def judged(recording: Recording, calibration: Calibration) -> tuple[Result, float]:
    """What validate says, and the RMSE of f_z in N at the true clock."""
    (result,), _ = validate([recording], calibration)
    readings = result.trial.readings
    is_complete = np.isfinite(readings.values).all(axis=1)
    at_once_n = np.interp(result.trial.t_s, readings.t_s[is_complete], readings.values[is_complete, 0])
    return result, float(np.sqrt(np.mean((result.estimate[:, 0] - at_once_n) ** 2)))


def main() -> int:
    worn = [recorded(name, "calibrated", True, None) for name in CALIBRATED_ON]
    true = worn[0]["left"].calibration
    assert true is not None
    ours, paper = (as_the_daemon_reads_it(calibrate(worn, "left", method), true) for method in ("default", "paper"))
    print("RMSE of f_z, N; in brackets m_x, m_y, N·m; CoP in mm")
    print(f"{'':4}{'noise only':>12}{'ours':>26}{'CoP':>14}{'true clock':>12}{'as published':>14}{'the paper':>11}")
    failed = False
    for name, paper_n in PAPER_N.items():
        noise, _ = judged(recorded(name, "validated", False, None), true)
        trial = recorded(name, "validated", True, None)
        (fitted, true_clock_n), (published, _) = judged(trial, ours), judged(trial, paper)
        outcomes = [each.outcome for each in (noise, fitted, published)]
        assert all(isinstance(each, ShoeResult) for each in outcomes)
        steady = name in STANDING
        noise_n, own_n, published_n = (each.steady_rmse_n if steady else each.f_z.rmse for each in outcomes)
        own = outcomes[1]
        failed |= steady and own_n > MOST_TIMES * noise_n
        print(
            f"{name:4}{noise_n:12.1f}{own_n:12.1f} ({own.m_x.rmse:.2f}, {own.m_y.rmse:.2f})"
            f"{own.cop_x.rmse * 1e3:9.1f}, {own.cop_y.rmse * 1e3:.1f}"
            f"{true_clock_n:12.1f}{published_n:14.1f}{paper_n:11.1f}"
            + (f"   {own_n / noise_n:.2f} times what noise leaves" if steady else "")
        )
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
