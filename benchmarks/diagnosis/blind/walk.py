"""Trials of walking, standing and swaying, as regions of the foot whose pressure rises and falls."""

import numpy as np

from .geometry import Geometry
from .laws import STEP_S
from .ranges import draw
from .trial import Trial, wandering

ACTIVITIES = ("walking", "mixed", "slow", "standing")
KEPT_S, LEAD_S = 20.0, 10.0
# x mm, y mm (medial is negative on a left foot), sigma mm, share, and when in stance it begins, peaks and ends.
_REGIONS = [
    (30, 4, 17, 1.00, 0.00, 0.16, 0.62),
    (55, 6, 18, 0.45, 0.02, 0.24, 0.70),
    (110, 16, 22, 0.16, 0.08, 0.42, 0.82),
    (178, -18, 13, 0.80, 0.20, 0.72, 0.96),
    (182, 2, 13, 0.95, 0.20, 0.74, 0.97),
    (174, 22, 13, 0.55, 0.16, 0.66, 0.94),
    (222, -14, 11, 0.85, 0.38, 0.85, 1.00),
    (214, 8, 11, 0.35, 0.34, 0.82, 0.99),
]
_STANDING = np.array([0.40, 0.30, 0.10, 0.26, 0.30, 0.20, 0.10, 0.06])
_HEEL = np.array(
    [1.0, 1.0, 0.3, -0.6, -0.6, -0.6, -0.5, -0.5]
)  # relative change of each region when the wearer leans back
_MEDIAL = np.array([0.0, 0.0, -0.8, 0.8, 0.0, -0.8, 0.6, -0.3])


def _rise_and_fall(stance_phase: np.ndarray, begin: float, peak: float, end: float) -> np.ndarray:
    """(n,): 0 up to `begin`, 1 at `peak`, 0 from `end`, with smooth flanks."""
    rise = np.clip((stance_phase - begin) / (peak - begin), 0, 1)
    fall = np.clip((end - stance_phase) / (end - peak), 0, 1)
    return np.sin(np.pi / 2 * rise) ** 2 * np.sin(np.pi / 2 * fall) ** 2


class _Wearer:
    """One wearer: weight distribution, gait and sway."""

    def __init__(self, rng: np.random.Generator, slow: bool):
        self.rng = rng
        self.shares = np.array([r[3] for r in _REGIONS]) * rng.uniform(0.85, 1.15, len(_REGIONS))
        self.cycle_s = draw(rng, "walking", "slow_step_s" if slow else "step_s")
        self.stance = rng.uniform(0.58, 0.68)

    def steps(self, n: int) -> np.ndarray:
        """Draw the pressure (n, n_regions) of steps that all differ."""
        rng, pressure, start = self.rng, np.zeros((n, len(_REGIONS))), round(0.4 / STEP_S)
        turn = rng.uniform(-0.25, 0.25)
        while True:
            length = round(self.cycle_s * self.stance * rng.normal(1, 0.04) / STEP_S)
            if start + length >= n:
                return pressure
            stance_phase = np.arange(length) / length
            turn = 0.9 * turn + rng.normal(0, 0.05)
            strength = self.shares * (1 + turn * _MEDIAL) * rng.normal(1, 0.07, len(_REGIONS))
            shift = rng.normal(0, 0.01, len(_REGIONS))
            for r, (_, _, _, _, begin, peak, end) in enumerate(_REGIONS):
                pressure[start : start + length, r] = strength[r] * _rise_and_fall(
                    stance_phase, begin, peak + shift[r], end
                )
            start += round(self.cycle_s * rng.normal(1, 0.03) / STEP_S)

    def standing(self, n: int) -> np.ndarray:
        """Draw the pressure (n, n_regions) of a wearer who leans to and fro and shifts weight between the feet."""
        seconds = np.arange(n) * STEP_S
        pressure = np.ones((n, len(_REGIONS))) * _STANDING * self.shares
        for direction, size in ((_HEEL, 0.35), (_MEDIAL, 0.25), (np.ones(len(_REGIONS)), 0.35)):
            sway = sum(
                self.rng.normal() * np.sin(2 * np.pi * frequency_hz * seconds + self.rng.uniform(0, 6))
                for frequency_hz in self.rng.uniform(0.05, 0.7, 6)
            )
            pressure *= 1 + np.outer(size * np.tanh(0.5 * sway), direction)
        edge = np.clip(np.minimum(seconds, seconds[-1] - seconds) / 0.4, 0, 1)
        return pressure * (np.sin(np.pi / 2 * edge) ** 2)[:, None]


def _courses(wearer: _Wearer, activity: str, n: int) -> np.ndarray:
    """Draw the pressure (n, n_regions) of an activity, up to a factor."""
    if activity == "standing":
        return wearer.standing(n)
    n_standing = round(wearer.rng.uniform(2.0, 4.0) / STEP_S)
    blocks, is_walking = [wearer.standing(n_standing)], True
    while (missing := n - sum(len(b) for b in blocks)) > 0:
        length = missing
        if activity == "mixed":
            length = min(missing, round(wearer.rng.uniform(*((12, 22) if is_walking else (6, 14))) / STEP_S))
        if missing - length < 5 / STEP_S:
            length = missing
        blocks.append(wearer.steps(length) if is_walking else wearer.standing(length))
        is_walking = not is_walking or activity != "mixed"
    return np.concatenate(blocks)


def walk(rng: np.random.Generator, geometry: Geometry, activity: str) -> Trial:
    """Draw a trial of a minute or more of one of the `ACTIVITIES`; before it the foot is in the air."""
    main_s = draw(rng, "walking", "length_s")
    n = round((main_s + KEPT_S) / STEP_S)
    courses = _courses(_Wearer(rng, activity == "slow"), activity, n)
    courses = np.concatenate([np.zeros((round(LEAD_S / STEP_S), len(_REGIONS))), courses])
    side = 1.0 if geometry.foot == "left" else -1.0
    regions = np.array([(x, side * y, sigma) for x, y, sigma, *_ in _REGIONS], float)
    seconds = np.arange(len(courses)) * STEP_S - LEAD_S
    temperature_c = wandering(rng, seconds, main_s, draw(rng, "walking", "temperature_swing_k"))
    unscaled = Trial("walk", activity, courses, regions, temperature_c, LEAD_S, main_s, 1.0)
    force_n = unscaled.wrench(geometry.taxel_mm)[:, 0]
    peak_force_n = draw(rng, "walking", "weight_n") * (0.75 if activity == "standing" else 1.12)
    courses = courses * peak_force_n / np.quantile(force_n[force_n > 0.02 * force_n.max()], 0.99)
    span_pa = float((courses @ unscaled.field(geometry.taxel_mm.reshape(-1, 2)).T).max())
    return Trial("walk", activity, courses, regions, temperature_c, LEAD_S, main_s, span_pa)
