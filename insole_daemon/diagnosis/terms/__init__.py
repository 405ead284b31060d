"""The library: one file a term, with its columns in the regression and what its shares mean in the law's parameters."""

from __future__ import annotations

from . import (
    baseline,
    bit_shift,
    clock,
    creep,
    crosstalk,
    delay,
    drift,
    earlier_load,
    gain,
    hysteresis,
    lag,
    map_transform,
    preload,
    reference_fault,
    rezero,
    snap,
    stiffening,
    swapped_triangles,
    temperature,
    uneven,
    viscoelasticity,
)
from .term import Term

TERMS: tuple[Term, ...] = (
    map_transform.TERM,
    swapped_triangles.TERM,
    preload.TERM,
    crosstalk.TERM,
    hysteresis.TERM,
    snap.TERM,
    viscoelasticity.TERM,
    creep.TERM,
    lag.TERM,
    stiffening.TERM,
    gain.TERM,
    baseline.TERM,
    temperature.TERM,
    drift.TERM,
    rezero.TERM,
    bit_shift.TERM,
    delay.TERM,
    clock.TERM,
    reference_fault.TERM,
    earlier_load.TERM,
    uneven.LOOPS,
    uneven.CREEP,
)
