"""Time, memory and optimality of the calibration fit at full size: 280 taxels, 60 000 samples of a force shoe.

    python -m benchmarks.calibration.fused_problem [--clarabel]

The problem has 1 120 unknowns, 2 520 constraints that a slope is not negative, and a chamber in addition to the shoe.
The time is that of `insole calibrate` after the samples were read: sums, equations and solution. With --clarabel that
solver gets the same scaled equations. Exits with 1 if it takes more than 10 s of wall clock or 1 GB, or if the residual
of the optimality (KKT) conditions is above 1e-6.

Takes about 15 seconds.
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

from insole_daemon.calibration.problem import FOLDS, FusedProblem, Penalty, Weights
from insole_daemon.calibration.solver import Constraints, solve
from insole_daemon.calibration.statistics import ChamberSums, ShoeSums

TAXELS, SHOE, CHAMBER = 280, 60_000, 20_000
EXPONENTS = (0, 1, 2, 3)
SCALE_COUNT = 40.0
AREA_M2 = 32.4e-6
MOST_S, MOST_MB, MOST_KKT = 10.0, 1000.0, 1e-6


def samples(draw: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Activations of both, wrench, chamber pressure and arms, of curves that stiffen and differ by 15 %.

    A tenth falls before it rises, so that limits matter. Loads of the shoe move as a few regions of the sole do, or
    every taxel would be told apart by itself.
    """
    x_m, y_m = draw.uniform(0, 0.26, TAXELS), draw.uniform(-0.04, 0.04, TAXELS)
    arms = AREA_M2 * np.stack([np.ones(TAXELS), y_m, -x_m])
    centres = np.stack([draw.uniform(0, 0.26, 12), draw.uniform(-0.04, 0.04, 12)], axis=1)
    near = np.exp(-((x_m - centres[:, :1]) ** 2 + (y_m - centres[:, 1:]) ** 2) / (2 * 0.025**2))
    shares = draw.gamma(0.7, 1.0, (SHOE, 12))
    shoe = np.clip(shares @ near * 0.35 + draw.normal(0, 0.01, (SHOE, TAXELS)), 0, 2.2)
    bag = np.linspace(0, 0.3, CHAMBER)[:, None] / draw.lognormal(0, 0.15, TAXELS)
    bag += draw.normal(0, 0.01, bag.shape)
    gain = 3.2e5 * draw.lognormal(0, 0.15, TAXELS)
    dip = np.where(draw.random(TAXELS) < 0.1, -2e4, 0.0)

    def curve(x: np.ndarray) -> np.ndarray:
        return gain * (x + 0.06 * x**2 + 0.02 * x**3) + dip * np.exp(-8 * x)

    wrench = curve(shoe) @ arms.T + draw.normal(0, 1, (SHOE, 3)) * (2.0, 0.15, 0.15)
    pressure = np.linspace(0, 9e4, CHAMBER) + draw.normal(0, 150, CHAMBER)
    return shoe, bag, wrench, pressure, arms


def fused(
    shoe: np.ndarray, bag: np.ndarray, wrench: np.ndarray, pressure: np.ndarray, arms: np.ndarray
) -> FusedProblem:
    parts = [slice(i * SHOE // FOLDS, (i + 1) * SHOE // FOLDS) for i in range(FOLDS)]
    bags = [slice(i * CHAMBER // FOLDS, (i + 1) * CHAMBER // FOLDS) for i in range(FOLDS)]
    valid = np.ones(bag.shape, np.bool_)
    return FusedProblem(
        EXPONENTS, SCALE_COUNT, arms,
        tuple(ShoeSums.of(shoe[p], wrench[p], EXPONENTS) for p in parts),
        tuple(ChamberSums.of(bag[p], valid[p], pressure[p], EXPONENTS) for p in bags),
    )  # fmt: skip


def equations(problem: FusedProblem) -> tuple[np.ndarray, np.ndarray, Constraints]:
    weights = Weights(1 / np.array([2.0, 0.15, 0.15]) ** 2, np.full(TAXELS, 1 / 3000.0**2))
    size = np.diag(problem.equations(weights, None)[0]).reshape(len(EXPONENTS), -1).mean(axis=1)
    target = np.tile([0.0, 3.2e5, 2e4, 6e3], (TAXELS, 1))
    h, g = problem.equations(weights, Penalty(np.tile(np.diag(1e-3 * size), (TAXELS, 1, 1)), target))
    return h, g, problem.limits(target[0], 1.2 * 2.2 * SCALE_COUNT, 5.0)


def by_clarabel(h: np.ndarray, g: np.ndarray, limits: Constraints) -> tuple[np.ndarray, float]:
    """The solution of the same equations in the same scale, and how long it takes."""
    import clarabel
    from scipy import sparse

    scale = 1 / np.sqrt(np.diag(h))
    scaled_g = g * scale
    size = np.abs(scaled_g).max()
    rows = limits.rows * scale
    lengths = np.linalg.norm(rows, axis=1)
    rows, low, high = rows / lengths[:, None], limits.low / lengths / size, limits.high / lengths / size
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    started = time.perf_counter()
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(h * scale * scale[:, None])), scaled_g / size,
        sparse.csc_matrix(np.vstack([-rows, rows])), np.concatenate([-low, high]),
        [clarabel.NonnegativeConeT(2 * len(rows))], settings,
    )  # fmt: skip
    solution = solver.solve()
    return np.array(solution.x) * scale * size, time.perf_counter() - started


def main(arguments: list[str]) -> int:
    shoe, bag, wrench, pressure, arms = samples(np.random.default_rng(1))
    before_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    started, cpu = time.perf_counter(), time.process_time()
    problem = fused(shoe, bag, wrench, pressure, arms)
    summed = time.perf_counter() - started
    h, g, limits = equations(problem)
    solution = solve(h, g, limits)
    took, cpu = time.perf_counter() - started, time.process_time() - cpu
    most_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(f"{len(g)} unknowns, {SHOE} shoe samples, {len(limits.low)} slopes, {solution.active} of them at a limit")
    print(f"sums {summed:.2f} s, all {took:.2f} s of wall clock, {cpu:.2f} s of CPU; KKT residual {solution.kkt:.1e}")
    print(f"{most_mb:.0f} MB at the most, of which {before_mb:.0f} MB hold the samples and the interpreter")
    if "--clarabel" in arguments:
        k, seconds = by_clarabel(h, g, limits)
        own, other = (np.sqrt(problem.residual_squares(each)[0] / SHOE).round(4) for each in (solution.k, k))
        print(f"clarabel: {seconds:.1f} s for the solution alone; RMSE of f_z, m_x, m_y: {own} here, {other} there")
    return int(took > MOST_S or most_mb > MOST_MB or not solution.kkt <= MOST_KKT)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
