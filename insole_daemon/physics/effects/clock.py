"""Clock: offset and rate between the clock of the readings and the clock of the reference."""

from __future__ import annotations

from ..law import Array, Law, Parameter, Values


def _times(values: Values, t_s: Array) -> Array:
    """Return the reference times, in s, at the CAN times `t_s`."""
    return values["offset_s"] + (1.0 + values["rate"]) * t_s


LAW = Law(
    word="clock",
    order=None,
    domain="time",
    equation="t_reference = offset + (1 + rate)·t_can",
    source="two quartz clocks: constant offset, constant rate error of 10 to 200 ppm",
    parameters=(
        Parameter("offset_s", "s", -1e10, 1e10, (-3.0, 3.0), "reference's time when the CAN's is 0"),
        Parameter("rate", "1", -0.1, 0.1, (-2e-4, 2e-4), "relative rate error of the reference's clock"),
    ),
    scopes=("insole",),
    inverse_is="none needed: readings stay as they are, and their times in the reference are `Chain.reference_s`",
    times=_times,
)
