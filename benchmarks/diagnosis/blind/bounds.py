"""Confidence intervals of rates, and the calibration of stated confidences."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

StatedConfidences = Sequence[tuple[float, bool]]  # stated confidence, and whether the finding was true
_LEAST_PROBABILITY = 0.005  # stated confidences are clipped to 0.005 to 0.995 in the log score


def wilson(n_right: float, n: int, level: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of the rate `n_right` / `n`; `n_right` may contain half points."""
    if n == 0:
        return 0.0, 1.0
    z = float(norm.ppf(0.5 + level / 2))
    share = n_right / n
    middle = (share + z * z / (2 * n)) / (1 + z * z / n)
    half_width = z / (1 + z * z / n) * np.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return max(0.0, middle - half_width), min(1.0, middle + half_width)


def log_score(stated: StatedConfidences) -> float | None:
    """Mean logarithm of the probability that was given to the outcome; 0 is perfect. None without confidences."""
    if not stated:
        return None
    confidence, is_true = _clipped_arrays(stated)
    return float(np.mean(np.log(np.where(is_true, confidence, 1 - confidence))))


def base_log_score(stated: StatedConfidences) -> float | None:
    """Log score of a constant confidence, the share of true findings. None without confidences."""
    if not stated:
        return None
    base_rate = float(np.mean([is_true for _, is_true in stated]))
    return log_score([(base_rate, is_true) for _, is_true in stated])


def slope(stated: StatedConfidences) -> float | None:
    """Slope of the reliability curve: least squares of the outcome (0 or 1) on the stated confidence.

    1 where the confidences are calibrated; None for fewer than three confidences, or where all are equal.
    """
    if len(stated) < 3:
        return None
    confidence, is_true = _clipped_arrays(stated)
    variance = float(np.var(confidence))
    return (
        float(np.mean((confidence - confidence.mean()) * (is_true - is_true.mean())) / variance)
        if variance > 1e-6
        else None
    )


def bootstrap_interval(
    stated: StatedConfidences, statistic: object, n_samples: int = 400
) -> tuple[float, float] | None:
    """95 % bootstrap interval of `statistic`, a function of stated confidences. None for fewer than three."""
    if len(stated) < 3:
        return None
    rng = np.random.default_rng(0)
    samples = [statistic([stated[k] for k in rng.integers(len(stated), size=len(stated))]) for _ in range(n_samples)]  # type: ignore[operator]
    values = [x for x in samples if x is not None]
    return (float(np.quantile(values, 0.025)), float(np.quantile(values, 0.975))) if values else None


def _clipped_arrays(stated: StatedConfidences) -> tuple[np.ndarray, np.ndarray]:
    """Confidences (n,), clipped, and outcomes (n,), 0 or 1."""
    confidence = np.clip([value for value, _ in stated], _LEAST_PROBABILITY, 1 - _LEAST_PROBABILITY)
    return confidence, np.array([is_true for _, is_true in stated], float)
