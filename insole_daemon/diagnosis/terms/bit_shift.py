"""`bit_shift`: a board drops k bits fewer than its configuration says, so 2^k times as many counts are below no-load.

The activation counts from the baseline of the calibration, so it changes by a constant, too, if the firmware did not
take its own baseline without load.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.interpolated_noise import echo_of_readings
from .term import Setting, Term, TermColumns, needs_calibration

STEPS = (-2, -1, 1, 2)  # −k: real minus configured shift


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return a column for each step, the wrench of g(a0 + (a − a0)·2^step) − g(a), with the echo of the noise.

    a0 is the activation of the digitiser's value 0.
    """
    seen = load.observation
    activation = seen.activation_count
    zero = np.array([[np.nan if each.zero_count is None else each.zero_count] for each in seen.readings])
    zero_activation = np.nan_to_num(seen.calibration.baseline_count - zero)
    columns, pressure_pa = [], seen.pressure_pa
    for step in STEPS:
        times = 2.0**step
        corrected = zero_activation + (activation - zero_activation) * times
        column = load.wrench_of(seen.static_pa(corrected) - pressure_pa)[..., None]
        echo = echo_of_readings(seen, times * seen.slope_at(corrected) - seen.slope_at(activation))
        columns.append(TermColumns(({"step": float(step)},), column, echo=echo))
    return columns


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return real minus configured shift; `diagnosis.parameters` adds the configured one."""
    return {"shift": int(settings[0]["step"])}


TERM = Term(
    word="bit_shift",
    scopes=("board", "insole"),
    share="whole",
    columns=_columns,
    parameters=_parameters,
    is_of_readings=True,
    needs=needs_calibration,
)
