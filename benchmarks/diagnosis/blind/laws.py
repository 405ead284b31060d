"""What a load does to a sensor: laws of other families than those a diagnosis fits, on a grid of STEP_S.

Every function takes a load (n,) or (n, n_columns) in Pa and returns a departure from it in Pa: the sensor feels the
load plus so many times the departure.
"""

from collections.abc import Callable

import numpy as np
from scipy.optimize import nnls
from scipy.signal import fftconvolve, lfilter

STEP_S = 0.004
FELT_S = 200.0
_COARSE = 5  # steps between the points at which slow laws are evaluated


def low_pass(load: np.ndarray, tau_s: float) -> np.ndarray:
    """tau dz/dt = load - z, settled at the first value; exact for a load that is linear between the grid's points."""
    e = np.exp(-STEP_S / tau_s)
    ramp = tau_s / STEP_S * (1 - e)
    b = np.array([1 - ramp, ramp - e], load.dtype)
    a = np.array([1, -e], load.dtype)
    z, _ = lfilter(b, a, load, axis=0, zi=((1 - b[0]) * load[:1]).astype(load.dtype))
    return z


def interpolate(values: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Rows of `values` (n, ...) at fractional row numbers `position` (m,), clamped to the ends."""
    position = np.clip(position, 0, len(values) - 1.000001)
    below = position.astype(np.int64)
    share = (position - below).astype(values.dtype).reshape(-1, *[1] * (values.ndim - 1))
    return values[below] * (1 - share) + values[below + 1] * share


def _every(load: np.ndarray, step: int, law: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """`law` evaluated on every `step`-th row of `load`, interpolated to all rows."""
    coarse = law(load[::step])
    return interpolate(np.concatenate([coarse, coarse[-1:]]), np.arange(len(load)) / step)


def bouc_wen(load: np.ndarray, yield_pa: float, beta: float = 0.6, gamma: float = 0.4) -> np.ndarray:
    """Minus the state h in [-1, 1] of dh/dP = (1 - |h| (gamma + beta sgn(h dP))) / yield (Bouc, Wen), midpoint rule."""

    def of_one(rises: list[float]) -> list[float]:
        h, out = 0.0, []
        for x in rises:
            sign = 1.0 if x > 0 else -1.0 if x < 0 else 0.0
            middle = h + x / 2 * (1 - abs(h) * gamma - beta * h * sign)
            h += x * (1 - abs(middle) * gamma - beta * middle * sign)
            out.append(-h)
        return out

    def states(few: np.ndarray) -> np.ndarray:
        if few.size == len(few):  # one column: plain floats are ten times faster
            rises = (np.diff(few.ravel(), prepend=few.ravel()[:1]) / yield_pa).tolist()
            return np.array(of_one(rises), few.dtype).reshape(few.shape)
        h, out = np.zeros(few.shape[1:]), np.empty_like(few)
        for k, x in enumerate(np.diff(few, axis=0, prepend=few[:1]) / yield_pa):
            sign = np.sign(x)
            middle = h + x / 2 * (1 - np.abs(h) * gamma - beta * h * sign)
            h = h + x * (1 - np.abs(middle) * gamma - beta * middle * sign)
            out[k] = -h
        return out

    return _every(load, 2, states)


def relay(load: np.ndarray, up: float, down: float) -> np.ndarray:
    """1 from load >= up until load <= down; 0 at first."""
    index = np.arange(len(load), dtype=np.int32).reshape(-1, *[1] * (load.ndim - 1))
    on = np.maximum.accumulate(np.where(load >= up, index, np.int32(-1)), axis=0)
    off = np.maximum.accumulate(np.where(load <= down, index, np.int32(0)), axis=0)
    return (on > off).astype(load.dtype)


def preisach(load: np.ndarray, span: float, width: float, levels: int = 26) -> np.ndarray:
    """A Preisach density, log-normal in the relays' width and flat in their middle, less its static curve.

    The static curve is a cubic through 0: what is left is the loop, and the virgin material at rest reads 0.
    """
    middles = span * (np.arange(levels) + 0.5) / levels
    halves = width * np.exp(np.linspace(-1.2, 1.2, 9))
    weights = np.exp(-(np.linspace(-1.2, 1.2, 9) ** 2) / 0.5)

    def total(few: np.ndarray) -> np.ndarray:
        found, sum_of_weights = np.zeros_like(few), 0.0
        for half, weight in zip(halves, weights, strict=True):
            for middle in middles:
                if middle + half < span:
                    found += weight * relay(few, middle + half, middle - half)
                    sum_of_weights += weight
        return found * span / sum_of_weights

    loop = _every(load, 2, total) - load
    curve = np.stack([(load / span) ** p for p in (1, 2, 3)], -1).reshape(-1, 3)
    return loop - (curve @ np.linalg.lstsq(curve, loop.ravel(), rcond=None)[0]).reshape(load.shape).astype(load.dtype)


def snap(load: np.ndarray, up: float, down: float, spread: float) -> np.ndarray:
    """A step of 1 Pa: seven domains that let go at slightly different pressures."""
    deviations = 1 + spread * np.array([-1.4, -0.8, -0.3, 0.0, 0.3, 0.8, 1.4])
    return sum(relay(load, up * d, down * d) for d in deviations) / np.float32(len(deviations))


def relaxation(load: np.ndarray, tau_s: float, width_decades: float) -> np.ndarray:
    """A log-normal spectrum of relaxation times about tau, less the load."""
    positions = np.linspace(-1.8, 1.8, 5)
    weights = np.exp(-(positions**2) / 2)
    weights /= weights.sum()
    z = sum(
        np.float32(w) * low_pass(load, tau_s * 10 ** (width_decades * p))
        for p, w in zip(positions, weights, strict=True)
    )
    return z - load


def power_law(load: np.ndarray, exponent: float, onset_s: float) -> np.ndarray:
    """Boltzmann superposition of J(t) = ((1 + t/onset)^n - 1) / ((1 + FELT_S/onset)^n - 1), less the load.

    A load that is held is felt in full after FELT_S, which no trial is longer than: creep never exceeds the static
    curve, so a calibration of the bare material stays right.
    """

    def slow(few: np.ndarray) -> np.ndarray:
        t = np.arange(len(few)) * STEP_S * _COARSE
        kernel = ((1 + t / onset_s) ** exponent - 1) / ((1 + FELT_S / onset_s) ** exponent - 1)
        steps = np.diff(few, axis=0, prepend=few[:1])
        kernel = kernel.reshape(-1, *[1] * (few.ndim - 1)).astype(few.dtype)
        return few[:1] + fftconvolve(steps, kernel, axes=0)[: len(few)]

    return _every(load, _COARSE, slow) - load


def power_law_steady(cycle: np.ndarray, exponent: float) -> np.ndarray:
    """Departure under a load that has repeated `cycle` for ever: (i w)^-n per harmonic, unity at the first."""
    spectrum = np.fft.rfft(cycle)
    harmonic = np.arange(len(spectrum), dtype=float)
    spectrum[1:] *= (1j * harmonic[1:]) ** -exponent
    spectrum[0] = 0
    return np.fft.irfft(spectrum, len(cycle))


def plays(load: np.ndarray, radii: np.ndarray, start: float) -> np.ndarray:
    """The play operator by its definition, (n_radii, n)."""
    out, w = np.empty((len(load), len(radii))), np.full(len(radii), start)
    for k, x in enumerate(load):
        w = np.minimum(np.maximum(w, x - radii), x + radii)
        out[k] = w
    return out.T


def hysteresis_like(cycle: np.ndarray, departure: np.ndarray) -> tuple[np.ndarray, float]:
    """The rate-independent material that closes the loop `departure` over this one `cycle` as nearly as any can.

    A non-negative density of plays and a static curve, a cubic. Returns its departure and what part it misses of the
    RMS of the loop less its own cubic.
    """
    half = np.ptp(cycle) / 2
    mid = cycle.min() + half
    # Dense where the loop turns: right after a reversal, and shortly before the next.
    radii = np.concatenate([np.geomspace(1e-4, 0.5, 50), 1 - np.geomspace(1e-3, 0.49, 50)])
    n = len(cycle)
    features = plays(np.tile(cycle, 2), half * radii, mid)[:, n:].T - cycle[:, None]
    static = np.linalg.qr(np.vander((cycle - mid) / half, 4))[0]
    features -= static @ (static.T @ features)
    wanted = departure - static @ (static.T @ departure)
    weights, missed = nnls(features, wanted)
    # Wide plays are mostly static: what they add to the curve goes, or it would be many times the load.
    return departure - wanted + features @ weights, float(missed / np.linalg.norm(wanted))


# Outside the vocabulary ----------------------------------------------------------------------------------------------


def softening(load: np.ndarray, span: float, tau_s: float) -> np.ndarray:
    """The gain grows with the mean load of the past: a product, no superposition."""
    return load * low_pass(load, tau_s) / np.float32(span)


def mullins(load: np.ndarray, span: float, heal_s: float) -> np.ndarray:
    """The curve depends on the highest load so far, and heals."""

    def highest(few: np.ndarray) -> np.ndarray:
        most, keep, out = np.zeros(few.shape[1:]), np.exp(-2 * STEP_S / heal_s), np.empty_like(few)
        for k, x in enumerate(few):
            most = np.maximum(x, most * keep)
            out[k] = most
        return out

    return load * _every(load, 2, highest) / np.float32(span)


def overshoot(load: np.ndarray, tau_s: float) -> np.ndarray:
    """The reading runs ahead and relaxes: opposite in sign to viscoelasticity."""
    return load - low_pass(load, tau_s)


def rate_magnitude(load: np.ndarray, span: float) -> np.ndarray:
    """Reads less while the load moves, whichever way."""
    return (-span * np.tanh(np.abs(np.gradient(load, STEP_S, axis=0)) / (0.3 * span))).astype(load.dtype)


def sticky_zone(load: np.ndarray, span: float, tau_s: float) -> np.ndarray:
    """A dead zone that widens while the load rests."""

    def ages(few: np.ndarray) -> np.ndarray:
        age, out = np.zeros(few.shape[1:]), np.empty_like(few)
        for k, x in enumerate(few < 0.05 * span):
            age = age + 2 * STEP_S / tau_s * np.where(x, 1 - age, -2 * age)
            out[k] = age
        return out

    return -np.minimum(load, np.float32(0.3 * span) * _every(load, 2, ages))


def telegraph(rng: np.random.Generator, seconds: np.ndarray, hold_s: float) -> np.ndarray:
    """0 or 1, changing at random after `hold_s` on average."""
    changes = np.cumsum(rng.exponential(hold_s, 4 + int(3 * np.ptp(seconds) / hold_s))) + seconds[0]
    return (np.searchsorted(changes, seconds) % 2).astype(float)
