"""Forces and pressures scaled so that both feet bear the body's weight over a stride.

Over whole strides of level walking at a steady cadence the centre of mass gains no vertical speed, so the mean of
both feet's f_z is the body's weight (Cavagna 1975, J. Appl. Physiol. 39:174). With the impulses I of each steady left
step and the right step that follows,

    gain = m · g · Σ stride / Σ (I_left + I_right)

One gain for both feet corrects what makes an insole read all loads too low or too high by the same fraction, whatever
its cause. It changes neither the symmetry of the feet nor the shape of a curve.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from ...errors import InsoleError
from .intervals import FEWEST
from .steps import Steps
from .symmetry import pair_steps

GRAVITY_M_S2 = 9.80665
PLAUSIBLE_GAIN = 0.8, 1.25  # beyond, something else is wrong: the mass, the calibration, or a part of the foot beside
_SCALED = re.compile(r"_(pa|n)(_s)?$")  # units: N, N·s, N/s, Pa, Pa·s


def scale_to_body_weight(steps: Steps, mass_kg: float) -> Steps:
    """Return `steps` with forces, impulses and pressures multiplied by one gain, which a remark states.

    `mass_kg` is that of the person with everything worn and carried. InsoleError: a foot is missing, too few steady
    steps, or a gain that no insole should need.
    """
    if not mass_kg > 0:
        raise InsoleError(f"expected the mass of the person in kg, found {mass_kg:g}")
    steady = steps.steady
    left, right = pair_steps(steady)
    stride_s = steady["stride_s"][left] if len(left) else np.empty(0)
    impulse_n_s = steady["impulse_n_s"][left] + steady["impulse_n_s"][right] if len(left) else np.empty(0)
    known = np.isfinite(stride_s) & np.isfinite(impulse_n_s)
    if np.count_nonzero(known) < FEWEST:
        raise InsoleError(
            f"the body's weight is compared with {FEWEST} or more steady strides of both feet, found "
            f"{np.count_nonzero(known)}: record both feet while the person walks steadily"
        )
    gain = mass_kg * GRAVITY_M_S2 * float(stride_s[known].sum()) / float(impulse_n_s[known].sum())
    lowest, highest = PLAUSIBLE_GAIN
    if not lowest <= gain <= highest:
        raise InsoleError(
            f"the insoles bear {1 / gain:.0%} of the weight of {mass_kg:g} kg, expected {1 / highest:.0%} to "
            f"{1 / lowest:.0%}: check the mass and the calibrations, and that the whole foot stands on the insole"
        )
    return replace(
        steps,
        columns={name: gain * column if _SCALED.search(name) else column for name, column in steps.columns.items()},
        curves={name: gain * curve if _SCALED.search(name) else curve for name, curve in steps.curves.items()},
        remarks=(*steps.remarks, f"forces and pressures times {gain:.3f}: both feet bear {mass_kg:g} kg over a stride"),
    )
