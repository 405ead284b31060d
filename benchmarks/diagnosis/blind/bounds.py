"""How sure a rate is, and whether stated confidences are true."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

Stated = Sequence[tuple[float, bool]]  # confidence, and whether it was so
_LEAST = 0.005  # nothing is surer than this in the log score


def wilson(right: float, n: int, level: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval; half points are allowed."""
    if n == 0:
        return 0.0, 1.0
    z = float(norm.ppf(0.5 + level / 2))
    p = right / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, middle - half), min(1.0, middle + half)


def log_score(stated: Stated) -> float | None:
    """Mean logarithm of the probability given to what was so; 0 is perfect."""
    if not stated:
        return None
    p, was = _clipped(stated)
    return float(np.mean(np.log(np.where(was, p, 1 - p))))


def base_log_score(stated: Stated) -> float | None:
    """The log score of who always states the base rate."""
    if not stated:
        return None
    base = float(np.mean([was for _, was in stated]))
    return log_score([(base, was) for _, was in stated])


def slope(stated: Stated) -> float | None:
    """Slope of the reliability curve: least squares of what was so on what was stated; 1 where confidence is true."""
    if len(stated) < 3:
        return None
    p, was = _clipped(stated)
    spread = float(np.var(p))
    return float(np.mean((p - p.mean()) * (was - was.mean())) / spread) if spread > 1e-6 else None


def resampled(stated: Stated, of: object, n: int = 400) -> tuple[float, float] | None:
    """95 % interval of a function of the stated confidences, by the bootstrap."""
    if len(stated) < 3:
        return None
    rng = np.random.default_rng(0)
    drawn = [of([stated[k] for k in rng.integers(len(stated), size=len(stated))]) for _ in range(n)]  # type: ignore[operator]
    found = [x for x in drawn if x is not None]
    return (float(np.quantile(found, 0.025)), float(np.quantile(found, 0.975))) if found else None


def _clipped(stated: Stated) -> tuple[np.ndarray, np.ndarray]:
    p = np.clip([s for s, _ in stated], _LEAST, 1 - _LEAST)
    return p, np.array([was for _, was in stated], float)
