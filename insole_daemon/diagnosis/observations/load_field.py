"""The load field of a simulated recording: courses over time, each with a shape over the insole.

A foot loads the insole in a few regions whose forces change, so the matrix of pressures has a low rank. The readings of
a simulation have noise, which must not enter regressors; singular vectors that stand out of white noise keep the load
and lose most of the noise, without any filtering in time.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ...errors import DiagnosisError
from ...physics.law import Array
from ...recording.loading import FootRecording, Recording
from ...skin.geometry import PRESSURE_TAXELS
from .frame_bursts import places_in_bursts
from .grid_readings import read_rows
from .reference_wrench import FINE_S
from .wrench import LARGEST, SMALLEST

NOISE_EDGE = 1.03  # factor on the largest singular value of white noise
MOST_COURSES = 40
MOST_UNKNOWN = 0.2  # share of the taxels whose load the simulation may lack
MOST_UNCERTAIN = 0.1  # of a triangle's load: standard deviation from the change of its place
MOST_UNCERTAIN_TAXEL = 0.03  # of a taxel's load, which is less smooth than the mean of a triangle
PLACE_TOLERANCE_M = 1e-6
LENGTHS_M = np.geomspace(0.006, 0.05, 8)  # of the covariance of the Gaussian process
NUGGETS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
CENTRE_TAXEL = 3  # in the middle of a triangle


@dataclass(frozen=True, slots=True)
class Move:
    """Displacement of the insole against its map: mm forward and to the left, degrees, logarithm of its scale."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    rotation_deg: float = 0.0
    log_scale: float = 0.0

    def further(self, x_mm: float, y_mm: float, rotation_deg: float, scale: float) -> Move:
        """Return the displacement moved by as much more."""
        return Move(
            self.x_mm + x_mm, self.y_mm + y_mm, self.rotation_deg + rotation_deg, self.log_scale + float(np.log(scale))
        )

    @property
    def parameters(self) -> dict[str, float]:
        """Return the parameters of the law `map_transform`."""
        return {
            "x_mm": self.x_mm, "y_mm": self.y_mm, "rotation_deg": self.rotation_deg,
            "scale": float(np.exp(self.log_scale)),
        }  # fmt: skip

    def places_m(self, xy_m: Array) -> Array:
        """Return the places (T, 12, 2), m, of taxels that are at `xy_m` by the map; the law `map_transform`."""
        pivot = xy_m[:, CENTRE_TAXEL].mean(axis=0)
        angle = np.deg2rad(self.rotation_deg)
        rotation = np.exp(self.log_scale) * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return np.asarray((xy_m - pivot) @ rotation.T + pivot + np.array([self.x_mm, self.y_mm]) * 1e-3)


@dataclass(frozen=True, eq=False)
class LoadField:
    """Pressure on taxels, Pa: `courses` (M, r) every FINE_S of the simulation's clock, times `shapes` (T, 12, r).

    Times count from the first row of the simulation.
    """

    courses: Array
    shapes: Array
    known: NDArray[np.bool_]  # (T, 12) taxels whose load the simulation has; that of others is interpolated
    spoiled: NDArray[np.bool_]  # (M, T) where a simulated reading is at an end of its range
    noise_pa: Array  # (T, 12) standard deviation of what is left of the simulation's noise
    period_s: float  # between two readings of the simulation
    xy_m: Array  # (T, 12, 2)
    in_burst_s: Array  # (T,) of the simulation's readings (`places_in_bursts`)

    def at(self, at_s: Array) -> Array:
        """Return the pressure (n, T, 12), Pa, at times (n,) of the simulation's clock."""
        position = np.clip(at_s / FINE_S, 0, len(self.courses) - 1.001)
        row = position.astype(np.intp)
        fraction = (position - row)[:, None]
        courses = self.courses[row] * (1 - fraction) + self.courses[row + 1] * fraction
        flat = courses @ self.shapes.reshape(-1, self.shapes.shape[-1]).T
        return np.asarray(flat.reshape(len(at_s), *self.shapes.shape[:2]))

    def felt_at(self, places_m: Array) -> LoadField:
        """Return the field for taxels that are at `places_m` (T, 12, 2)."""
        if np.allclose(places_m, self.xy_m, atol=PLACE_TOLERANCE_M):
            return self
        return replace(self, shapes=self.shapes + self.between(places_m) - self.between(self.xy_m))

    def moved(self, move: Move, rows: NDArray[np.intp]) -> LoadField:
        """Return the field for an insole displaced by `move`, with triangles in the places of `rows` (T,).

        Beyond the taxels of the simulation, the load is not known. All rows of a triangle are spoiled where that makes
        its mean uncertain.
        """
        if move == Move() and np.array_equal(rows, np.arange(len(rows))):
            return self
        places_m = move.places_m(self.xy_m)
        felt = self.felt_at(places_m)
        std_pa = self._process.std_of_change(self.xy_m, places_m)
        known = self.known & (std_pa < MOST_UNCERTAIN_TAXEL * np.sqrt(np.sum(felt.shapes**2, axis=-1)))
        mean_pa = np.sqrt(np.sum(np.mean(felt.shapes[:, PRESSURE_TAXELS], axis=1) ** 2, axis=-1))
        spoiled = self.spoiled | (np.mean(std_pa[:, PRESSURE_TAXELS], axis=1) > MOST_UNCERTAIN * mean_pa)
        return replace(felt, shapes=felt.shapes[rows], known=known[rows], spoiled=spoiled[:, rows])

    def change_by(self, move: Move) -> LoadField:
        """Return the field of the change of load by `move`, by central differences."""
        ahead, behind = (
            self.between(Move(*(side * value for value in astuple(move))).places_m(self.xy_m)) for side in (0.5, -0.5)
        )
        return replace(self, shapes=ahead - behind)

    def between(self, places_m: Array) -> Array:
        """Return the shapes (T, 12, r) at `places_m` (T, 12, 2), interpolated by Gaussian processes."""
        return self._process.shapes(places_m.reshape(-1, 2)).reshape(*places_m.shape[:2], -1)

    @cached_property
    def _process(self) -> GaussianProcess:
        return GaussianProcess(self.xy_m[self.known], self.shapes[self.known])


class GaussianProcess:
    """Interpolates shapes of the load between the taxels that a simulation has: posterior mean of a Gaussian process.

    Length scale and noise share of each shape maximise the marginal likelihood (Rasmussen & Williams 2006, section
    5.4).
    """

    def __init__(self, xy_m: Array, shapes: Array) -> None:
        self._xy_m = xy_m
        n_taxels, n_shapes = shapes.shape
        square_distance = np.sum((xy_m[:, None] - xy_m) ** 2, axis=-1)
        best = np.full(n_shapes, -np.inf)
        self._length_m, self._weights = np.empty(n_shapes), np.empty((n_taxels, n_shapes))
        self._nugget, self._variance = np.empty(n_shapes), np.empty(n_shapes)
        for length in LENGTHS_M:
            eigenvalues, eigenvectors = np.linalg.eigh(np.exp(-0.5 * square_distance / length**2))
            projected = eigenvectors.T @ shapes
            for nugget in NUGGETS:
                inverse = 1.0 / (np.maximum(eigenvalues, 0.0) + nugget)
                power = np.maximum(np.sum(projected**2 * inverse[:, None], axis=0), 1e-300)
                likelihood = np.sum(np.log(inverse)) - n_taxels * np.log(power)
                better = likelihood > best
                best[better], self._length_m[better], self._nugget[better] = likelihood[better], length, nugget
                self._variance[better] = power[better] / n_taxels
                self._weights[:, better] = eigenvectors @ (inverse[:, None] * projected[:, better])

    def shapes(self, xy_m: Array) -> Array:
        """Return the shapes (m, r) at the places `xy_m` (m, 2)."""
        square_distance = np.sum((xy_m[:, None] - self._xy_m) ** 2, axis=-1)
        shapes = np.empty((len(xy_m), self._weights.shape[1]))
        for length in np.unique(self._length_m):
            has_length = self._length_m == length
            shapes[:, has_length] = np.exp(-0.5 * square_distance / length**2) @ self._weights[:, has_length]
        return shapes

    def std_of_change(self, from_m: Array, to_m: Array) -> Array:
        """Return the standard deviation (...) of the root mean square load at `to_m` (..., 2) less that at `from_m`.

        That of the posterior; shapes are of courses with a mean square of 1 that are orthogonal to each other.
        """
        start, end = from_m.reshape(-1, 2), to_m.reshape(-1, 2)
        square_distance = np.sum((self._xy_m[:, None] - self._xy_m) ** 2, axis=-1)
        of_end, of_start = (np.sum((xy[:, None] - self._xy_m) ** 2, axis=-1) for xy in (end, start))
        apart = np.sum((end - start) ** 2, axis=-1)
        variance = np.zeros(len(end))
        for length, nugget in {*zip(self._length_m.tolist(), self._nugget.tolist(), strict=True)}:
            scale = -0.5 / length**2
            change = np.exp(scale * of_end) - np.exp(scale * of_start)
            covariance = np.exp(scale * square_distance) + nugget * np.eye(len(square_distance))
            explained = np.sum(change * np.linalg.solve(covariance, change.T).T, axis=1)
            has_both = (self._length_m == length) & (self._nugget == nugget)
            prior = 2.0 * (1.0 - np.exp(scale * apart))
            variance += np.sum(self._variance[has_both]) * np.maximum(prior - explained, 0.0)
        return np.asarray(np.sqrt(variance).reshape(to_m.shape[:-1]))


def same_foot(simulation: Recording, foot: FootRecording) -> FootRecording:
    """Return the foot of the simulation that is compared with `foot`; DiagnosisError if it is of another insole."""
    simulated = next((own for own in simulation.feet if own.foot == foot.foot), None)
    if simulated is None:
        raise DiagnosisError(
            f"{simulation.folder}: expected a simulation of the {foot.foot} foot, found the "
            f"{' and the '.join(own.foot for own in simulation.feet)}: simulate the insole that was recorded"
        )
    if not np.array_equal(simulated.layout.identities, foot.layout.identities) or not np.allclose(
        simulated.layout.xy_m, foot.layout.xy_m, atol=PLACE_TOLERANCE_M
    ):
        raise DiagnosisError(
            f"{simulation.folder}: expected a simulation with the layout of the recording, found another: simulate the "
            "insole that was recorded, with the map it is believed to have"
        )
    if simulated.calibration is None:
        raise DiagnosisError(f"{simulation.folder}: expected a calibration, which tells the load of its counts")
    if simulated.calibration.effects:
        words = ", ".join(effect.law.word for effect in simulated.calibration.effects)
        raise DiagnosisError(f"{simulation.folder}: its calibration has effects ({words}), expected a static one")
    return simulated


def load_field(simulation: Recording, foot: FootRecording) -> LoadField:
    """Return the load of `simulation`.

    Raises DiagnosisError as `same_foot`, and if it lacks the load of too many taxels.
    """
    simulated = same_foot(simulation, foot)
    calibration = simulated.calibration
    assert calibration is not None
    rows = read_rows(simulation, simulated, calibration, np.median)
    is_pressure_taxel = PRESSURE_TAXELS & np.ones_like(rows.usable)
    n_usable, n_pressure = int(rows.usable.sum()), int(is_pressure_taxel.sum())
    if n_usable < (1 - MOST_UNKNOWN) * n_pressure:
        raise DiagnosisError(
            f"{simulation.folder}: it knows the load of {n_usable} taxels of {n_pressure}, "
            f"expected at least {1 - MOST_UNKNOWN:.0%} of them: its calibration lists too few, or their readings "
            "are not valid"
        )
    coefficients = np.where(rows.usable, np.moveaxis(calibration.coefficients_pa, -1, 0), 0.0)
    pressure_pa = np.polynomial.polynomial.polyval(rows.activation_count, coefficients, tensor=False)[:, rows.usable]
    rms_count = np.sqrt(np.mean(rows.activation_count**2, axis=0))
    half_count_pa = [
        np.polynomial.polynomial.polyval(rms_count + side, coefficients, tensor=False) for side in (0.5, -0.5)
    ]
    noise_pa = rows.noise_count * np.maximum(half_count_pa[0] - half_count_pa[1], 1.0)
    noise_scale_pa = noise_pa[rows.usable]
    time_vectors, singular, taxel_vectors = np.linalg.svd(pressure_pa / noise_scale_pa, full_matrices=False)
    n_rows, n_taxels = pressure_pa.shape
    rank = int(
        np.clip(np.count_nonzero(singular > NOISE_EDGE * (np.sqrt(n_rows) + np.sqrt(n_taxels))), 1, MOST_COURSES)
    )
    courses = CubicSpline(rows.t_s, time_vectors[:, :rank] * np.sqrt(n_rows))(
        np.arange(rows.t_s[0], rows.t_s[-1], FINE_S)
    )
    shapes = np.zeros((*rows.usable.shape, rank))
    shapes[rows.usable] = taxel_vectors[:rank].T * singular[:rank] / np.sqrt(n_rows) * noise_scale_pa[:, None]
    counts = calibration.baseline_count - rows.activation_count
    cut_off = ((counts > LARGEST) & (calibration.baseline_count < LARGEST)) | (counts < SMALLEST)
    spoiled = np.asarray((cut_off & rows.usable).any(axis=2))
    nearest_row = np.clip(np.rint(np.arange(len(courses)) * FINE_S / float(rows.t_s[1] - rows.t_s[0])), 0, n_rows - 1)
    field = LoadField(
        courses, shapes, rows.usable, spoiled[nearest_row.astype(np.intp)], noise_pa * np.sqrt(rank / n_taxels),
        float(np.median(rows.period_s[np.isfinite(rows.period_s)])), simulated.layout.xy_m,
        places_in_bursts(rows.readings, simulated.layout.identities[:, 0]),
    )  # fmt: skip
    is_unknown = is_pressure_taxel & ~rows.usable
    if is_unknown.any():
        shapes[is_unknown] = field.between(field.xy_m)[is_unknown]
    return field
