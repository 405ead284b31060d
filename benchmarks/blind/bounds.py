"""How sure a rate is, and whether stated confidences are true."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import beta, norm


def wilson(right: float, n: int, level: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval; half points are allowed."""
    if n == 0:
        return 0.0, 1.0
    z = float(norm.ppf(0.5 + level / 2))
    p = right / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, middle - half), min(1.0, middle + half)


def clopper_pearson_upper(wrong: int, n: int, level: float = 0.95) -> float:
    """The rate that would show `wrong` or fewer of n with a probability of only 1 - level."""
    return 1.0 if wrong >= n else float(beta.ppf(level, wrong + 1, n - wrong))


def brier(stated: Sequence[tuple[float, bool]]) -> float | None:
    return float(np.mean([(p - was) ** 2 for p, was in stated])) if stated else None


def expected_calibration_error(stated: Sequence[tuple[float, bool]], bins: int = 10) -> float | None:
    if not stated:
        return None
    p = np.array([s for s, _ in stated])
    was = np.array([w for _, w in stated], float)
    group = np.minimum((p * bins).astype(int), bins - 1)
    return float(sum(abs(p[group == g].sum() - was[group == g].sum()) for g in range(bins)) / len(p))
