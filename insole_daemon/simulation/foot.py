"""A person on the insoles, walking or standing: regions of the sole that share the ground's force.

Every region presses with a fixed footprint, a bell-shaped pressure over the taxels that integrates to 1 N; over time
only the force on each region changes. So Σ P_i A_i = f_z for any layout, the CoP is the mean of the regions' centres
weighted by their forces, and both moments are f_z times it.

All magnitudes are approximations of ordinary gait. J. Perry, *Gait Analysis*: stance 62 % of a stride, two force peaks
of 1.1 body weights and a valley between, roll-over heel – lateral midfoot – metatarsals – hallux. P. Cavanagh et al.
1987, quiet standing: heel 60 %, midfoot 8 %, forefoot and toes 32 %. Sorrentino et al. 2020: the highest pressure of
any taxel was 220 kPa standing (task T1), 360 to 630 kPa walking (T4 to T6).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..physics.draws import Drawn, Draws
from ..physics.portable import exp, sin_turns, weighted_sum
from ..skin.geometry import PRESSURE_TAXELS
from ..skin.layout import Foot, Layout

Places = Mapping[Foot, NDArray[np.float64]]  # true positions of a foot's taxels, (n_triangles, 12, 2) in m

GRAVITY_M_S2 = 9.81
STANCE = 0.62  # fraction of a stride in which a foot is on the ground
# Of the force over stance, in body weights: peaks 1.1 at 25 % and 75 %, valley 0.75, both feet together at
# most 1.2 in double support. The first harmonic follows from the weight.
_THIRD_HARMONIC = 0.36
_FIFTH_HARMONIC = -0.05
_DIGITS_M = 9  # of a position; further digits may differ between machines
_VARIED_STRIDES = 97  # number of strides after which the variation repeats

# Centre and spread (1 σ) of a region: x from the rearmost (0) to the foremost taxel (1); y in half widths of
# the sole, positive is lateral. Then the course of its share over stance: when it peaks, how wide, how high;
# and its share in quiet standing.
_REGIONS = np.array([
    #  x     y     σ_x    σ_y   peak  width high  standing
    [0.11,  0.40, 0.080, 0.28, 0.05, 0.17, 0.55, 0.31],  # heel, lateral
    [0.11, -0.40, 0.080, 0.28, 0.05, 0.17, 0.45, 0.29],  # heel, medial
    [0.42,  0.40, 0.100, 0.28, 0.40, 0.15, 0.12, 0.08],  # lateral midfoot
    [0.66,  0.50, 0.060, 0.26, 0.55, 0.17, 0.35, 0.09],  # metatarsals 4 and 5
    [0.72,  0.05, 0.060, 0.26, 0.65, 0.17, 0.60, 0.11],  # metatarsals 2 and 3
    [0.74, -0.45, 0.060, 0.24, 0.72, 0.15, 0.50, 0.09],  # metatarsal 1
    [0.88,  0.15, 0.055, 0.32, 0.85, 0.12, 0.12, 0.01],  # toes 2 to 5
    [0.92, -0.40, 0.055, 0.22, 0.95, 0.13, 0.50, 0.02],  # hallux
    [0.50,  0.85, 0.260, 0.22, 0.50, 1.00, 0.00, 0.00],  # lateral edge, for tilting the foot
    [0.50, -0.85, 0.260, 0.22, 0.50, 1.00, 0.00, 0.00],  # medial edge
])  # fmt: skip

_ALL_BUT_HEEL = slice(2, None)
_ON_TIPTOE = np.array([0.0, 0.0, 0.0, 0.10, 0.30, 0.30, 0.10, 0.20, 0.0, 0.0])  # as the shares late in stance
_LATERAL_EDGE, _MEDIAL_EDGE = 8, 9


def footprints(layout: Layout, xy_m: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Return (n_regions, n_triangles, 12) the pressure of every region per newton, in 1/m².

    The sole is placed by the layout's positions, where Σ · A = 1. `xy_m` (n_triangles, 12, 2) are the taxels' true
    positions, at which the pressure is evaluated.
    """
    layout_m, true_m = (
        np.round(positions_m[:, PRESSURE_TAXELS], _DIGITS_M)
        for positions_m in (layout.xy_m, layout.xy_m if xy_m is None else xy_m)
    )
    low, high = layout_m.min(axis=(0, 1)), layout_m.max(axis=(0, 1))
    lateral = 1.0 if layout.foot == "left" else -1.0  # y points to the wearer's left on both feet

    def exponent(places_m: NDArray[np.float64]) -> NDArray[np.float64]:
        x = (places_m[..., 0] - low[0]) / (high[0] - low[0])
        y = lateral * (places_m[..., 1] - (low[1] + high[1]) / 2) / ((high[1] - low[1]) / 2)
        x_centre, y_centre, x_spread, y_spread = _REGIONS[:, :4, None, None].swapaxes(0, 1)
        along, across = (x - x_centre) / x_spread, (y - y_centre) / y_spread
        exponents: NDArray[np.float64] = -(along * along + across * across) / 2
        return exponents

    # Relative to the nearest taxel, so that a region without a taxel under it still has its share.
    nearest = exponent(layout_m).max(axis=(1, 2), keepdims=True)
    total = exp(exponent(layout_m) - nearest).sum(axis=(1, 2), keepdims=True)
    pressure = np.zeros((len(_REGIONS), len(layout_m), len(PRESSURE_TAXELS)))
    pressure[..., PRESSURE_TAXELS] = exp(exponent(true_m) - nearest) / (total * layout.taxel_area_m2)
    return pressure


class Person(ABC):
    """A person on the insoles: a Load, with the wrench of the ground.

    The wrench is that of a perfect insole with its taxels at the layout's positions: all force passes through the
    taxels.
    """

    def __init__(self, layouts: Sequence[Layout], body_mass_kg: float, places: Places | None = None) -> None:
        """`layouts` has one layout per foot; `places` the taxels' true positions, if they differ from it."""
        self.weight_n = body_mass_kg * GRAVITY_M_S2
        self._footprints = {
            layout.foot: footprints(layout, None if places is None else places[layout.foot]) for layout in layouts
        }
        self._unit_wrenches = {layout.foot: _unit_wrenches(layout) for layout in layouts}

    @abstractmethod
    def region_n(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n_times, n_regions) the force on each region of the sole."""

    def force_n(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n_times,) f_z of `foot`."""
        return weighted_sum(self.region_n(foot, t_s), np.ones(len(_REGIONS)))

    def pressure_pa(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the pressure, see Load; Σ P_i A_i is `force_n`."""
        return weighted_sum(self.region_n(foot, t_s), self._footprints[foot])

    def reference(self, foot: Foot, t_s: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Return fz_n, mx_nm, my_nm (n_times,) about the insole's origin."""
        wrench = weighted_sum(self.region_n(foot, t_s), self._unit_wrenches[foot])
        return {name: wrench[:, i] for i, name in enumerate(("fz_n", "mx_nm", "my_nm"))}


def _unit_wrenches(layout: Layout) -> NDArray[np.float64]:
    """Return (n_regions, 3) f_z, m_x, m_y per newton."""
    weights = footprints(layout) * layout.taxel_area_m2
    x, y = np.moveaxis(np.round(layout.xy_m, _DIGITS_M), -1, 0)
    return np.stack([np.ones(len(weights)), (weights * y).sum(axis=(1, 2)), -(weights * x).sum(axis=(1, 2))], axis=-1)


class Walk(Person):
    """Level walking at a steady cadence: left and right half a stride apart, left heel strike at t = 0.

    Over a stride both feet together bear the body's weight.
    """

    def __init__(
        self,
        layouts: Sequence[Layout],
        body_mass_kg: float = 63.0,
        cadence_per_min: float = 110.0,
        seed: int = 0,
        places: Places | None = None,
    ) -> None:
        """`layouts` has one layout per foot; `cadence_per_min` counts steps of both feet; `places` as for every Person.

        Force and distribution vary from stride to stride (1 σ: 2 % and 8 %), drawn from `seed`.
        """
        super().__init__(layouts, body_mass_kg, places)
        self.stride_s = 120.0 / cadence_per_min
        # The mean over stance of Σ a_n·sin(nπs), n odd, is (2/π)·Σ a_n/n; 2 · STANCE of it is one weight.
        first_harmonic = np.pi / (4 * STANCE) - _THIRD_HARMONIC / 3 - _FIFTH_HARMONIC / 5
        self._harmonics = np.array([first_harmonic, _THIRD_HARMONIC, _FIFTH_HARMONIC])
        varied = Draws(seed, Drawn.STRIDES).normal(2, _VARIED_STRIDES, 1 + len(_REGIONS))
        self._force_factor = 1 + 0.02 * varied[..., 0]
        self._share_factor = exp(0.08 * varied[..., 1:])

    def force_n(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n_times,) f_z of `foot`; 0 in swing."""
        stance, stride = self._stance_phase(foot, t_s)
        in_weights = weighted_sum(sin_turns(stance[:, None] * (0.5, 1.5, 2.5)), self._harmonics)
        force_n: NDArray[np.float64] = (
            self.weight_n * self._force_factor[_foot_index(foot), stride] * in_weights * (stance < 1)
        )
        return force_n

    def region_n(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n_times, n_regions) the force, from heel to toes."""
        stance, stride = self._stance_phase(foot, t_s)
        peak, width, high = _REGIONS[:, 4:7].T
        since = (stance[:, None] - peak) / width
        shares: NDArray[np.float64] = high * self._share_factor[_foot_index(foot), stride] * exp(-since * since / 2)
        shares *= (self.force_n(foot, t_s) / shares.sum(axis=1))[:, None]
        return shares

    def _stance_phase(self, foot: Foot, t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the phase of stance (0 heel strike … 1 toe-off, 1 in swing), and the stride's row in the table."""
        strides = t_s / self.stride_s + 0.5 * _foot_index(foot)
        number = np.floor(strides)
        return np.minimum((strides - number) / STANCE, 1.0), number.astype(np.int64) % _VARIED_STRIDES


class Stand(Person):
    """Quiet standing: half the weight on each foot, swaying by 4 % of it sideways and some mm forward."""

    def __init__(self, layouts: Sequence[Layout], body_mass_kg: float = 63.0, places: Places | None = None) -> None:
        """A person of `body_mass_kg` stands on `layouts`, one per foot; `places` as for every Person."""
        super().__init__(layouts, body_mass_kg, places)

    def force_n(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n_times,) f_z of `foot`; the other foot bears the rest of the weight."""
        sideways = 0.04 * sin_turns(0.31 * t_s)
        return self.weight_n * (0.5 + (sideways if foot == "left" else -sideways))

    def region_n(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n_times, n_regions) the force as distributed in quiet standing."""
        forward = 1 + 0.06 * sin_turns(0.23 * t_s)
        flat = np.zeros_like(t_s)
        return distribute_standing_force(self.force_n(foot, t_s), forward, flat, flat)


def distribute_standing_force(
    force_n: NDArray[np.float64],
    forward: NDArray[np.float64],
    tiptoe: NDArray[np.float64],
    tilt: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return (n, n_regions) the distribution of `force_n` (n,) over the regions of a standing person's foot.

    `forward` (n,): factor of all regions but the heel, 1 in quiet standing; `tilt` (n,): fraction of the force on the
    lateral edge, negative for the medial one; `tiptoe` (n,): fraction of the remaining force that is distributed as on
    tiptoe.
    """
    shares = np.repeat(_REGIONS[None, :, 7], len(force_n), axis=0)
    shares[:, _ALL_BUT_HEEL] *= forward[:, None]
    shares *= ((1.0 - tiptoe) / shares.sum(axis=1))[:, None]
    shares += tiptoe[:, None] * _ON_TIPTOE
    shares *= (1.0 - np.abs(tilt))[:, None]
    shares[:, _LATERAL_EDGE] += np.maximum(tilt, 0.0)
    shares[:, _MEDIAL_EDGE] += np.maximum(-tilt, 0.0)
    return shares * force_n[:, None]


def _foot_index(foot: Foot) -> int:
    return 0 if foot == "left" else 1
