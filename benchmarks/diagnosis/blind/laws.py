"""Laws of the concealed effects, of other families than those that a diagnosis fits, on a grid of STEP_S.

A law takes a load (n,) or (n, n_columns) in Pa and returns a departure (same shape) in Pa. The sensor feels the load
plus the departure times the effect's amplitude.
"""

from collections.abc import Callable

import numpy as np
from scipy.optimize import nnls
from scipy.signal import fftconvolve, lfilter

STEP_S = 0.004
FELT_S = 200.0  # creep of a load that is held this long equals the load
_SLOW_STEP = 5  # rows between the points at which creep is evaluated


def low_pass(load: np.ndarray, tau_s: float) -> np.ndarray:
    """z of tau dz/dt = load - z, settled at the first value; exact for a load that is linear between grid points."""
    decay = np.exp(-STEP_S / tau_s)
    ramp = tau_s / STEP_S * (1 - decay)
    b = np.array([1 - ramp, ramp - decay], load.dtype)
    a = np.array([1, -decay], load.dtype)
    z, _ = lfilter(b, a, load, axis=0, zi=((1 - b[0]) * load[:1]).astype(load.dtype))
    return z


def interpolate(values: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Rows of `values` (n, ...) at fractional row numbers `position` (m,), clamped to the ends."""
    position = np.clip(position, 0, len(values) - 1.000001)
    below = position.astype(np.int64)
    share = (position - below).astype(values.dtype).reshape(-1, *[1] * (values.ndim - 1))
    return values[below] * (1 - share) + values[below + 1] * share


def _on_coarse_grid(load: np.ndarray, step: int, law: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """`law` evaluated on every `step`-th row of `load`, interpolated to all rows."""
    coarse = law(load[::step])
    return interpolate(np.concatenate([coarse, coarse[-1:]]), np.arange(len(load)) / step)


def bouc_wen(load: np.ndarray, yield_pa: float, beta: float = 0.6, gamma: float = 0.4) -> np.ndarray:
    """Minus the state h in [-1, 1] of dh/dP = (1 - |h| (gamma + beta sgn(h dP))) / yield (Bouc, Wen).

    The equation is integrated with the midpoint rule.
    """

    def states_of_column(rises: list[float]) -> list[float]:
        h, minus_states = 0.0, []
        for rise in rises:
            sign = 1.0 if rise > 0 else -1.0 if rise < 0 else 0.0
            middle = h + rise / 2 * (1 - abs(h) * gamma - beta * h * sign)
            h += rise * (1 - abs(middle) * gamma - beta * middle * sign)
            minus_states.append(-h)
        return minus_states

    def states(coarse_load: np.ndarray) -> np.ndarray:
        if coarse_load.size == len(coarse_load):  # for one column, plain floats are ten times faster
            rises = (np.diff(coarse_load.ravel(), prepend=coarse_load.ravel()[:1]) / yield_pa).tolist()
            return np.array(states_of_column(rises), coarse_load.dtype).reshape(coarse_load.shape)
        h, minus_states = np.zeros(coarse_load.shape[1:]), np.empty_like(coarse_load)
        for k, rise in enumerate(np.diff(coarse_load, axis=0, prepend=coarse_load[:1]) / yield_pa):
            sign = np.sign(rise)
            middle = h + rise / 2 * (1 - np.abs(h) * gamma - beta * h * sign)
            h = h + rise * (1 - np.abs(middle) * gamma - beta * middle * sign)
            minus_states[k] = -h
        return minus_states

    return _on_coarse_grid(load, 2, states)


def relay(load: np.ndarray, up: float, down: float) -> np.ndarray:
    """1 from a load >= up until a load <= down, else 0; starts at 0."""
    index = np.arange(len(load), dtype=np.int32).reshape(-1, *[1] * (load.ndim - 1))
    on = np.maximum.accumulate(np.where(load >= up, index, np.int32(-1)), axis=0)
    off = np.maximum.accumulate(np.where(load <= down, index, np.int32(0)), axis=0)
    return (on > off).astype(load.dtype)


def preisach(load: np.ndarray, span: float, width: float, levels: int = 26) -> np.ndarray:
    """Departure of a Preisach density, log-normal in the relays' width and flat in their middle.

    Its static curve, a cubic through 0, is subtracted: the loop remains, and the virgin material at rest reads 0.
    """
    middles = span * (np.arange(levels) + 0.5) / levels
    half_widths = width * np.exp(np.linspace(-1.2, 1.2, 9))
    weights = np.exp(-(np.linspace(-1.2, 1.2, 9) ** 2) / 0.5)

    def response(coarse_load: np.ndarray) -> np.ndarray:
        weighted_sum, sum_of_weights = np.zeros_like(coarse_load), 0.0
        for half_width, weight in zip(half_widths, weights, strict=True):
            for middle in middles:
                if middle + half_width < span:
                    weighted_sum += weight * relay(coarse_load, middle + half_width, middle - half_width)
                    sum_of_weights += weight
        return weighted_sum * span / sum_of_weights

    departure = _on_coarse_grid(load, 2, response) - load
    powers = np.stack([(load / span) ** p for p in (1, 2, 3)], -1).reshape(-1, 3)
    return departure - (powers @ np.linalg.lstsq(powers, departure.ravel(), rcond=None)[0]).reshape(load.shape).astype(
        load.dtype
    )


def snap(load: np.ndarray, up: float, down: float, spread: float) -> np.ndarray:
    """A step of 1 Pa between `down` and `up`, made of seven domains that snap at slightly different pressures."""
    factors = 1 + spread * np.array([-1.4, -0.8, -0.3, 0.0, 0.3, 0.8, 1.4])
    return sum(relay(load, up * factor, down * factor) for factor in factors) / np.float32(len(factors))


def relaxation(load: np.ndarray, tau_s: float, width_decades: float) -> np.ndarray:
    """Response of a log-normal spectrum of relaxation times about tau, minus the load."""
    positions = np.linspace(-1.8, 1.8, 5)
    weights = np.exp(-(positions**2) / 2)
    weights /= weights.sum()
    z = sum(
        np.float32(w) * low_pass(load, tau_s * 10 ** (width_decades * p))
        for p, w in zip(positions, weights, strict=True)
    )
    return z - load


def power_law(load: np.ndarray, exponent: float, onset_s: float) -> np.ndarray:
    """Boltzmann superposition of J(t) = ((1 + t/onset)^n - 1) / ((1 + FELT_S/onset)^n - 1), minus the load.

    A load that is held is felt in full after FELT_S, and no trial is longer. Creep therefore never exceeds the static
    curve, and a calibration of the material without creep stays right.
    """

    def superpose(coarse_load: np.ndarray) -> np.ndarray:
        t = np.arange(len(coarse_load)) * STEP_S * _SLOW_STEP
        kernel = ((1 + t / onset_s) ** exponent - 1) / ((1 + FELT_S / onset_s) ** exponent - 1)
        steps = np.diff(coarse_load, axis=0, prepend=coarse_load[:1])
        kernel = kernel.reshape(-1, *[1] * (coarse_load.ndim - 1)).astype(coarse_load.dtype)
        return coarse_load[:1] + fftconvolve(steps, kernel, axes=0)[: len(coarse_load)]

    return _on_coarse_grid(load, _SLOW_STEP, superpose) - load


def power_law_steady(cycle: np.ndarray, exponent: float) -> np.ndarray:
    """Departure of steady creep over one `cycle` (n,): (i w)^-n for each harmonic, with magnitude 1 at the first."""
    spectrum = np.fft.rfft(cycle)
    harmonic = np.arange(len(spectrum), dtype=float)
    spectrum[1:] *= (1j * harmonic[1:]) ** -exponent
    spectrum[0] = 0
    return np.fft.irfft(spectrum, len(cycle))


def plays(load: np.ndarray, radii: np.ndarray, start: float) -> np.ndarray:
    """States (n_radii, n) of the play operator, by its definition."""
    states, state = np.empty((len(load), len(radii))), np.full(len(radii), start)
    for k, value in enumerate(load):
        state = np.minimum(np.maximum(state, value - radii), value + radii)
        states[k] = state
    return states.T


def hysteresis_like(cycle: np.ndarray, departure: np.ndarray) -> tuple[np.ndarray, float]:
    """Fit a rate-independent material to the loop `departure` (n,) over one `cycle` (n,), by least squares.

    The material has a non-negative density of plays and a static curve, a cubic. Returns its departure (n,), and its
    residual relative to the loop without its own cubic.
    """
    half_span = np.ptp(cycle) / 2
    middle = cycle.min() + half_span
    # Radii are dense where the loop turns: right after a reversal, and shortly before the next.
    radii = np.concatenate([np.geomspace(1e-4, 0.5, 50), 1 - np.geomspace(1e-3, 0.49, 50)])
    n = len(cycle)
    features = plays(np.tile(cycle, 2), half_span * radii, middle)[:, n:].T - cycle[:, None]
    static = np.linalg.qr(np.vander((cycle - middle) / half_span, 4))[0]
    features -= static @ (static.T @ features)
    loop = departure - static @ (static.T @ departure)
    weights, residual_norm = nnls(features, loop)
    # Wide plays are mostly static. Their static part is not added, because it would be many times the load.
    return departure - loop + features @ weights, float(residual_norm / np.linalg.norm(loop))


# Outside the vocabulary ----------------------------------------------------------------------------------------------


def softening(load: np.ndarray, span: float, tau_s: float) -> np.ndarray:
    """The gain grows with the mean of past loads: a product, not a superposition."""
    return load * low_pass(load, tau_s) / np.float32(span)


def mullins(load: np.ndarray, span: float, heal_s: float) -> np.ndarray:
    """The static curve depends on the highest load so far, and recovers over `heal_s`."""

    def healing_peak(coarse_load: np.ndarray) -> np.ndarray:
        peak, decay, peaks = np.zeros(coarse_load.shape[1:]), np.exp(-2 * STEP_S / heal_s), np.empty_like(coarse_load)
        for k, row in enumerate(coarse_load):
            peak = np.maximum(row, peak * decay)
            peaks[k] = peak
        return peaks

    return load * _on_coarse_grid(load, 2, healing_peak) / np.float32(span)


def overshoot(load: np.ndarray, tau_s: float) -> np.ndarray:
    """The reading overshoots and relaxes: viscoelasticity with the opposite sign."""
    return load - low_pass(load, tau_s)


def rate_magnitude(load: np.ndarray, span: float) -> np.ndarray:
    """The reading is lower while the load rises or falls."""
    return (-span * np.tanh(np.abs(np.gradient(load, STEP_S, axis=0)) / (0.3 * span))).astype(load.dtype)


def sticky_zone(load: np.ndarray, span: float, tau_s: float) -> np.ndarray:
    """A dead zone that widens while the load rests."""

    def ages(coarse_load: np.ndarray) -> np.ndarray:
        age, ages_out = np.zeros(coarse_load.shape[1:]), np.empty_like(coarse_load)
        for k, is_at_rest in enumerate(coarse_load < 0.05 * span):
            age = age + 2 * STEP_S / tau_s * np.where(is_at_rest, 1 - age, -2 * age)
            ages_out[k] = age
        return ages_out

    return -np.minimum(load, np.float32(0.3 * span) * _on_coarse_grid(load, 2, ages))


def telegraph(rng: np.random.Generator, seconds: np.ndarray, hold_s: float) -> np.ndarray:
    """Draw a signal (n,) of 0 and 1 that changes at random, on average after `hold_s`."""
    changes = np.cumsum(rng.exponential(hold_s, 4 + int(3 * np.ptp(seconds) / hold_s))) + seconds[0]
    return (np.searchsorted(changes, seconds) % 2).astype(float)
