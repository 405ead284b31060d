"""The load that a simulated recording tells, with places: a few courses in time, each with a shape over the insole.

What presses on a sole is a handful of regions whose force changes, so the pressures of all taxels are few courses
mixed. A simulation's readings have noise of their own; as a regressor it would pass for physics. Keeping the mixtures
that stand out of white noise takes most of it away without touching time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ...errors import DiagnosisError
from ...physics.law import Array
from ...recording.loading import FootRecording, Recording
from ...skin.geometry import PRESSURE_TAXELS
from .wrench import FINE_S, LARGEST, SMALLEST, read_rows

EDGE = 1.03  # times the largest singular value of white noise
MOST_COURSES = 40
MOST_BARE = 0.2  # of the taxels, that a simulation may know nothing of
SAME_PLACE_M = 1e-6
LENGTHS_M = np.geomspace(0.006, 0.05, 8)  # of the interpolation
NUGGETS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
CENTRE = 3  # the taxel in the middle of a triangle


@dataclass(frozen=True, slots=True)
class Move:
    """Where the insole lies against its map: millimetres forward and to the left, degrees, logarithm of its scale."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    rotation_deg: float = 0.0
    log_scale: float = 0.0

    def further(self, x_mm: float, y_mm: float, rotation_deg: float, scale: float) -> Move:
        """By as much more."""
        return Move(
            self.x_mm + x_mm, self.y_mm + y_mm, self.rotation_deg + rotation_deg, self.log_scale + float(np.log(scale))
        )

    @property
    def parameters(self) -> dict[str, float]:
        """As the law `map_transform` has them."""
        return {
            "x_mm": self.x_mm, "y_mm": self.y_mm, "rotation_deg": self.rotation_deg,
            "scale": float(np.exp(self.log_scale)),
        }  # fmt: skip

    def places_m(self, xy_m: Array) -> Array:
        """(T, 12, 2) where taxels are that are believed to be at `xy_m`; the law `map_transform`."""
        pivot = xy_m[:, CENTRE].mean(axis=0)
        angle = np.deg2rad(self.rotation_deg)
        turn = np.exp(self.log_scale) * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return np.asarray((xy_m - pivot) @ turn.T + pivot + np.array([self.x_mm, self.y_mm]) * 1e-3)


@dataclass(frozen=True, eq=False)
class LoadField:
    """Pressure on taxels: `courses` (M, r) every FINE_S of the simulation's clock, times `shapes` (T, 12, r), Pa.

    Its times count from its first row.
    """

    courses: Array
    shapes: Array
    known: NDArray[np.bool_]  # (T, 12) taxels that the simulation tells; others are interpolated
    spoiled: NDArray[np.bool_]  # (M, T) where a simulated reading is at the end of its range
    noise_pa: Array  # (T, 12) standard deviation that noise of the simulation leaves
    period_s: float  # between two of its readings
    xy_m: Array  # (T, 12, 2)

    def at(self, at_s: Array) -> Array:
        """(n, T, 12) Pa at times (n,) of its clock."""
        position = np.clip(at_s / FINE_S, 0, len(self.courses) - 1.001)
        left = position.astype(np.intp)
        share = (position - left)[:, None]
        courses = self.courses[left] * (1 - share) + self.courses[left + 1] * share
        flat = courses @ self.shapes.reshape(-1, self.shapes.shape[-1]).T
        return np.asarray(flat.reshape(len(at_s), *self.shapes.shape[:2]))

    def felt_at(self, places_m: Array) -> LoadField:
        """As felt by taxels that are at `places_m` (T, 12, 2)."""
        if np.allclose(places_m, self.xy_m, atol=SAME_PLACE_M):
            return self
        return replace(self, shapes=self.shapes + self.between(places_m) - self.between(self.xy_m))

    def moved(self, move: Move, rows: NDArray[np.intp]) -> LoadField:
        """As felt by an insole that lies at `move`, its triangles in the places of the triangles `rows` (T,)."""
        if move == Move() and np.array_equal(rows, np.arange(len(rows))):
            return self
        felt = self.felt_at(move.places_m(self.xy_m))
        return replace(felt, shapes=felt.shapes[rows], known=self.known[rows])

    def between(self, places_m: Array) -> Array:
        """(T, 12, r) shapes at `places_m` (T, 12, 2), by Gaussian processes through what is known."""
        return self._process.shapes(places_m.reshape(-1, 2)).reshape(*places_m.shape[:2], -1)

    @cached_property
    def _process(self) -> GaussianProcess:
        return GaussianProcess(self.xy_m[self.known], self.shapes[self.known])


class GaussianProcess:
    """The load between the taxels that a simulation knows: of each shape the mean of all fields that go with it.

    Its length and what of it is noise maximise the marginal likelihood (Rasmussen & Williams 2006, section 5.4).
    """

    def __init__(self, xy_m: Array, shapes: Array) -> None:
        self._xy_m = xy_m
        k, r = shapes.shape
        square = np.sum((xy_m[:, None] - xy_m) ** 2, axis=-1)
        best = np.full(r, -np.inf)
        self._length_m, self._weights = np.empty(r), np.empty((k, r))
        for length in LENGTHS_M:
            value, vector = np.linalg.eigh(np.exp(-0.5 * square / length**2))
            turned = vector.T @ shapes
            for nugget in NUGGETS:
                inverse = 1.0 / (np.maximum(value, 0.0) + nugget)
                power = np.maximum(np.sum(turned**2 * inverse[:, None], axis=0), 1e-300)
                likelihood = np.sum(np.log(inverse)) - k * np.log(power)
                better = likelihood > best
                best[better], self._length_m[better] = likelihood[better], length
                self._weights[:, better] = vector @ (inverse[:, None] * turned[:, better])

    def shapes(self, xy_m: Array) -> Array:
        """(m, r) at the places (m, 2)."""
        square = np.sum((xy_m[:, None] - self._xy_m) ** 2, axis=-1)
        found = np.empty((len(xy_m), self._weights.shape[1]))
        for length in np.unique(self._length_m):
            which = self._length_m == length
            found[:, which] = np.exp(-0.5 * square / length**2) @ self._weights[:, which]
        return found


def same_foot(simulation: Recording, foot: FootRecording) -> FootRecording:
    """The foot of the simulation that `foot` is compared with; DiagnosisError where it is another insole."""
    same = next((each for each in simulation.feet if each.foot == foot.foot), None)
    if same is None:
        raise DiagnosisError(
            f"{simulation.folder}: expected a simulation of the {foot.foot} foot, found the "
            f"{' and the '.join(each.foot for each in simulation.feet)}: simulate the insole that was recorded"
        )
    if not np.array_equal(same.layout.identities, foot.layout.identities) or not np.allclose(
        same.layout.xy_m, foot.layout.xy_m, atol=SAME_PLACE_M
    ):
        raise DiagnosisError(
            f"{simulation.folder}: expected a simulation with the layout of the recording, found another: simulate the "
            "insole that was recorded, with the map it is believed to have"
        )
    if same.calibration is None:
        raise DiagnosisError(f"{simulation.folder}: expected a calibration, which tells the load of its counts")
    if same.calibration.effects:
        words = ", ".join(each.law.word for each in same.calibration.effects)
        raise DiagnosisError(f"{simulation.folder}: its calibration has effects ({words}), expected a static one")
    return same


def load_field(simulation: Recording, foot: FootRecording) -> LoadField:
    """The load that `simulation` tells; DiagnosisError as `same_foot`, and where it knows too few taxels."""
    same = same_foot(simulation, foot)
    calibration = same.calibration
    assert calibration is not None
    rows = read_rows(simulation, same, calibration, np.median)
    there = PRESSURE_TAXELS & np.ones_like(rows.usable)
    if rows.usable.sum() < (1 - MOST_BARE) * there.sum():
        raise DiagnosisError(
            f"{simulation.folder}: it knows the load of {int(rows.usable.sum())} taxels of {int(there.sum())}, "
            f"expected at least {1 - MOST_BARE:.0%} of them: its calibration lists too few, or their readings are not "
            "valid"
        )
    coefficients = np.where(rows.usable, np.moveaxis(calibration.coefficients_pa, -1, 0), 0.0)
    pressure = np.polynomial.polynomial.polyval(rows.activation_count, coefficients, tensor=False)[:, rows.usable]
    middle = np.sqrt(np.mean(rows.activation_count**2, axis=0))
    half = [np.polynomial.polynomial.polyval(middle + side, coefficients, tensor=False) for side in (0.5, -0.5)]
    noise_pa = rows.noise_count * np.maximum(half[0] - half[1], 1.0)
    scale = noise_pa[rows.usable]
    left, size, right = np.linalg.svd(pressure / scale, full_matrices=False)
    n, m = pressure.shape
    r = int(np.clip(np.count_nonzero(size > EDGE * (np.sqrt(n) + np.sqrt(m))), 1, MOST_COURSES))
    courses = CubicSpline(rows.t_s, left[:, :r] * np.sqrt(n))(np.arange(rows.t_s[0], rows.t_s[-1], FINE_S))
    shapes = np.zeros((*rows.usable.shape, r))
    shapes[rows.usable] = right[:r].T * size[:r] / np.sqrt(n) * scale[:, None]
    counts = calibration.baseline_count - rows.activation_count
    cut_off = ((counts > LARGEST) & (calibration.baseline_count < LARGEST)) | (counts < SMALLEST)
    spoiled = np.asarray((cut_off & rows.usable).any(axis=2))
    nearest = np.clip(np.rint(np.arange(len(courses)) * FINE_S / float(rows.t_s[1] - rows.t_s[0])), 0, n - 1)
    found = LoadField(
        courses, shapes, rows.usable, spoiled[nearest.astype(np.intp)], noise_pa * np.sqrt(r / m),
        float(np.median(rows.period_s[np.isfinite(rows.period_s)])), same.layout.xy_m,
    )  # fmt: skip
    bare = there & ~rows.usable
    if bare.any():
        shapes[bare] = found.between(found.xy_m)[bare]
    return found
