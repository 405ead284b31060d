"""A trial: the pressure on the insole and its temperature, on the grid of the laws."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .geometry import AREA_MM2, PRESSURE_TAXELS
from .laws import STEP_S, interpolate


@dataclass(frozen=True)
class Trial:
    """Load and temperature from `-lead_s`, before the first frame, to the end of the sealed continuation.

    The pressure at a position is the sum over regions of `courses` times the region's `field` there.
    """

    kind: str  # chamber or walk
    protocol: str
    courses: np.ndarray  # (n, n_regions) Pa
    regions: np.ndarray  # (n_regions, 3): x mm, y mm, sigma mm; sigma is infinite in a chamber
    temperature_c: np.ndarray  # (n,)
    lead_s: float
    main_s: float  # end of the part that the tool gets
    span_pa: float
    cycle: np.ndarray | None = None  # one cycle of a load that repeated it long before the trial, too

    @cached_property
    def seconds(self) -> np.ndarray:
        """Times (n,) of the grid; 0 is the first frame."""
        return np.arange(len(self.courses)) * STEP_S - self.lead_s

    @property
    def end_s(self) -> float:
        """End of the sealed continuation."""
        return float(self.seconds[-1])

    def position(self, seconds: np.ndarray) -> np.ndarray:
        """Fractional row numbers of times (n,)."""
        return (seconds + self.lead_s) / STEP_S

    def at(self, values: np.ndarray, seconds: np.ndarray) -> np.ndarray:
        """`values` (n_grid, ...) of the trial's grid, interpolated at `seconds` (n,)."""
        return interpolate(values, self.position(seconds))

    def field(self, positions_mm: np.ndarray) -> np.ndarray:
        """Share of each region's pressure at positions (..., 2): (..., n_regions)."""
        squared_distance = ((positions_mm[..., None, :] - self.regions[:, :2]) ** 2).sum(-1)
        return np.exp(-squared_distance / (2 * self.regions[:, 2] ** 2))

    def pressure(self, positions_mm: np.ndarray) -> np.ndarray:
        """(n, n_positions) Pa at positions (n_positions, 2), float32."""
        return self.courses.astype(np.float32) @ self.field(positions_mm).T.astype(np.float32)

    def wrench(self, taxels_mm: np.ndarray) -> np.ndarray:
        """(n, 3): f_z N, m_x N m, m_y N m on the pressure taxels at (28, 12, 2).

        f_z = sum P A, m_x = sum y P A, m_y = -sum x P A.
        """
        flat_mm = taxels_mm[:, PRESSURE_TAXELS].reshape(-1, 2)
        return self.courses @ (arms(flat_mm) @ self.field(flat_mm)).T


def arms(taxels_mm: np.ndarray) -> np.ndarray:
    """(3, n): f_z in N, m_x and m_y in N m, of 1 Pa on each of the taxels at (n, 2) in mm."""
    return AREA_MM2 * 1e-6 * np.stack([np.ones(len(taxels_mm)), 1e-3 * taxels_mm[:, 1], -1e-3 * taxels_mm[:, 0]])


def wandering(rng: np.random.Generator, seconds: np.ndarray, main_s: float, swing_k: float) -> np.ndarray:
    """Draw a temperature (n,) in °C that rises and falls more than once within `main_s`."""
    period = main_s / rng.uniform(1.3, 1.8)
    shape = (1 - np.cos(2 * np.pi * seconds / period)) / 2
    shape = shape + 0.2 * np.sin(2 * np.pi * seconds / (0.37 * main_s) + rng.uniform(0, 6))
    return rng.uniform(20, 28) + swing_k * (shape - np.interp(0, seconds, shape))
