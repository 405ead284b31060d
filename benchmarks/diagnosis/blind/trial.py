"""A trial: the pressure on the insole and its temperature, on the grid of the laws."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .geometry import AREA_MM2, PRESSURE_TAXELS
from .laws import STEP_S, interpolate


@dataclass(frozen=True)
class Trial:
    """From `-lead_s`, before the first frame, to the end of what is kept back.

    The pressure at a position is the sum over regions of `courses` times how much of a region is felt there.
    """

    kind: str  # chamber or walk
    protocol: str
    courses: np.ndarray  # (n, n_regions) Pa
    regions: np.ndarray  # (n_regions, 3): x mm, y mm, sigma mm; sigma is infinite in a chamber
    temperature_c: np.ndarray  # (n,)
    lead_s: float
    main_s: float  # what the tool is given ends here
    span_pa: float
    cycle: np.ndarray | None = None  # one cycle of a load that has repeated it for ever

    @cached_property
    def seconds(self) -> np.ndarray:
        return np.arange(len(self.courses)) * STEP_S - self.lead_s

    @property
    def end_s(self) -> float:
        return float(self.seconds[-1])

    def position(self, seconds: np.ndarray) -> np.ndarray:
        """Row number of a time, fractional."""
        return (seconds + self.lead_s) / STEP_S

    def at(self, values: np.ndarray, seconds: np.ndarray) -> np.ndarray:
        """Rows of `values`, given on the grid, at `seconds`."""
        return interpolate(values, self.position(seconds))

    def field(self, at_mm: np.ndarray) -> np.ndarray:
        """Share of each region's pressure felt at positions (..., 2): (..., n_regions)."""
        away = ((at_mm[..., None, :] - self.regions[:, :2]) ** 2).sum(-1)
        return np.exp(-away / (2 * self.regions[:, 2] ** 2))

    def pressure(self, at_mm: np.ndarray) -> np.ndarray:
        """(n, n_positions) Pa at positions (n_positions, 2), float32."""
        return self.courses.astype(np.float32) @ self.field(at_mm).T.astype(np.float32)

    def wrench(self, at_mm: np.ndarray) -> np.ndarray:
        """(n, 3): f_z N, m_x N m, m_y N m on the pressure taxels at (28, 12, 2).

        f_z = sum P A, m_x = sum y P A, m_y = -sum x P A.
        """
        at = at_mm[:, PRESSURE_TAXELS].reshape(-1, 2)
        return self.courses @ (arms(at) @ self.field(at)).T


def arms(at_mm: np.ndarray) -> np.ndarray:
    """(3, n): what 1 Pa on each taxel at (n, 2) adds to f_z, m_x and m_y."""
    return AREA_MM2 * 1e-6 * np.stack([np.ones(len(at_mm)), 1e-3 * at_mm[:, 1], -1e-3 * at_mm[:, 0]])


def wandering(rng: np.random.Generator, seconds: np.ndarray, main_s: float, swing_k: float) -> np.ndarray:
    """A temperature that goes up and down more than once within `main_s`."""
    period = main_s / rng.uniform(1.3, 1.8)
    shape = (1 - np.cos(2 * np.pi * seconds / period)) / 2
    shape = shape + 0.2 * np.sin(2 * np.pi * seconds / (0.37 * main_s) + rng.uniform(0, 6))
    return rng.uniform(20, 28) + swing_k * (shape - np.interp(0, seconds, shape))
