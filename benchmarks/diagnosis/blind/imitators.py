"""Effects that can be mistaken for another effect, and small examples of them for a linear fit."""

from typing import Any

from .effect import Effect
from .trial import Trial

EITHER_SIGN = ("gain", "baseline", "drift", "temperature")
# Words that can be mistaken for a word, if its effect is weak or fast or the load has one speed.
IMITATORS = {
    "gain": ("baseline", "preload"),
    "baseline": ("gain", "preload"),
    "preload": ("gain", "baseline"),
    "lag": ("delay", "viscoelasticity"),
    "delay": ("lag",),
    "viscoelasticity": ("lag", "creep", "hysteresis"),
    "creep": ("viscoelasticity", "hysteresis"),
    "hysteresis": ("viscoelasticity", "creep"),
    "drift": ("temperature",),
    "temperature": ("drift",),
}


def small_effects(effect: Effect, word: str, trial: Trial) -> list[Effect]:
    """Small effects called `word` at the place of `effect`, over the range of their other parameters."""
    shapes: dict[str, list[tuple[float, dict[str, Any]]]] = {
        "gain": [(0.02, {})],
        "baseline": [(1.0, {})],
        "preload": [(500.0, {})],
        "delay": [(0.01, {})],
        "lag": [(0.01, {}), (0.06, {})],
        "viscoelasticity": [(0.05, {"tau_s": tau_s, "width": 0.15}) for tau_s in (0.1, 0.35, 1.2)],
        "creep": [(0.05, {"exponent": 0.2, "onset_s": onset_s}) for onset_s in (1.0, 4.0)],
        "hysteresis": [
            (0.01, {"family": "bouc_wen", "width_pa": width_fraction * trial.span_pa, "beta": 0.6})
            for width_fraction in (0.03, 0.09)
        ],
        "drift": [
            (1.0, {"settle_s": settle_s, "start_s": start_fraction * trial.main_s})
            for settle_s, start_fraction in ((25.0, 0.0), (60.0, 0.0), (40.0, 0.25))
        ],
        "temperature": [(1.0, {"gain_per_k": 0.0})],
    }
    return [
        Effect(word, word, effect.where, effect.place, amplitude, {**shape, "span_pa": trial.span_pa})
        for amplitude, shape in shapes[word]
    ]
