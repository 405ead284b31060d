"""A walk: the pressure under a foot as regions that come and go, and the wrench they make."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.blind.geometry import AREA_MM2, PRESSURE_TAXELS, Geometry
from benchmarks.blind.laws import STEP_S
from benchmarks.blind.ranges import draw

MAIN_S, KEPT_S = 60.0, 20.0
STANCE = 0.62  # of the step cycle
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


def _bump(u: np.ndarray, begin: float, peak: float, end: float) -> np.ndarray:
    up = np.clip((u - begin) / (peak - begin), 0, 1)
    down = np.clip((end - u) / (end - peak), 0, 1)
    return np.sin(np.pi / 2 * up) ** 2 * np.sin(np.pi / 2 * down) ** 2


@dataclass(frozen=True)
class Walk:
    """`courses` (n, regions) at 1 kHz, Pa at each region's middle."""

    courses: np.ndarray
    temperature_c: np.ndarray
    foot: str
    main_s: float = MAIN_S

    @property
    def protocol(self) -> str:
        return "walk"

    @property
    def seconds(self) -> np.ndarray:
        return np.arange(len(self.courses)) * STEP_S

    @property
    def span_pa(self) -> float:
        return float(1.3 * self.courses.max())  # regions overlap

    def field(self, at_mm: np.ndarray) -> np.ndarray:
        """How much of each region's pressure is felt at positions (..., 2): (..., regions)."""
        side = 1.0 if self.foot == "left" else -1.0
        middle = np.array([(x, side * y) for x, y, *_ in _REGIONS])
        sigma = np.array([r[2] for r in _REGIONS])
        away = ((at_mm[..., None, :] - middle) ** 2).sum(-1)
        return np.exp(-away / (2 * sigma**2))

    def pressure(self, at_mm: np.ndarray) -> np.ndarray:
        """(n, 28, 12) of taxels at (28, 12, 2), float32."""
        n = len(self.courses)
        flat = self.courses.astype(np.float32) @ self.field(at_mm).reshape(-1, len(_REGIONS)).T.astype(np.float32)
        return flat.reshape(n, 28, 12)


@dataclass(frozen=True)
class Wrench:
    """What the force shoe feels: all of what lies on the taxels, at their true positions."""

    walk: Walk
    at_mm: np.ndarray  # (28, 12, 2)

    @cached_property
    def courses(self) -> np.ndarray:
        """(n, 3): f_z N, m_x N m, m_y N m. f_z = sum P A, m_x = sum y P A, m_y = -sum x P A."""
        at = self.at_mm[:, PRESSURE_TAXELS]
        share = self.walk.field(at).reshape(-1, self.walk.courses.shape[1]) * AREA_MM2 * 1e-6
        arms = np.stack([np.ones(len(share)), 1e-3 * at[..., 1].ravel(), -1e-3 * at[..., 0].ravel()])
        return self.walk.courses @ (arms @ share).T


def walk(rng: np.random.Generator, geometry: Geometry) -> Walk:
    """A minute and a bit of walking after standing, as in the paper's T4 to T6."""
    n = round((MAIN_S + KEPT_S) / STEP_S)
    courses = np.zeros((n, len(_REGIONS)))
    shares = np.array([r[3] for r in _REGIONS]) * rng.uniform(0.85, 1.15, len(_REGIONS))
    stand = round(rng.uniform(2.0, 3.5) / STEP_S)
    courses[:stand] = 0.35 * shares * np.array([1, 1, 1, 0.8, 0.8, 0.8, 0.3, 0.3])
    courses[:stand] *= np.clip(np.arange(stand)[::-1] / 400, 0, 1)[:, None]
    at, cycle = stand + 300, draw(rng, "walking", "step_s")
    while True:
        length = round(cycle * STANCE * rng.normal(1, 0.03) / STEP_S)
        if at + length >= n:
            break
        u = np.arange(length) / length
        strength = shares * rng.normal(1, 0.07, len(_REGIONS))
        shift = rng.normal(0, 0.008, len(_REGIONS))
        for r, (_, _, _, _, begin, peak, end) in enumerate(_REGIONS):
            courses[at : at + length, r] = strength[r] * _bump(u, begin, peak + shift[r], end)
        at += round(cycle * rng.normal(1, 0.02) / STEP_S)
    weight = draw(rng, "walking", "weight_n")
    made = Walk(courses, np.zeros(n), geometry.foot)
    highest = np.quantile(Wrench(made, geometry.taxel_mm).courses[:, 0], 0.995)
    t = made.seconds
    warm = rng.uniform(24, 28) + rng.uniform(0.5, 2) * np.sin(2 * np.pi * t / MAIN_S * rng.uniform(0.8, 1.5))
    return Walk(courses * 1.12 * weight / highest, warm, geometry.foot)
