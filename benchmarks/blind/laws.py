"""What a load does to a sensor, at 1 kHz: families other than those a diagnosis fits.

Every function takes a load on the 1 kHz grid and returns a departure from it, in the load's unit; the sensor reads the
load plus so many times the departure.
"""

import numpy as np
from scipy.optimize import nnls
from scipy.signal import fftconvolve, lfilter

STEP_S = 1e-3


def low_pass(load: np.ndarray, tau_s: float) -> np.ndarray:
    """tau dz/dt = load - z by the trapezoidal rule along the first axis, settled at the first value."""
    g = STEP_S / (2 * tau_s + STEP_S)
    decay = (2 * tau_s - STEP_S) / (2 * tau_s + STEP_S)
    z, _ = lfilter([g, g], [1.0, -decay], load, axis=0, zi=(g + decay) * load[:1])
    return z


def bouc_wen(load: np.ndarray, yield_pa: float, beta: float = 0.6, gamma: float = 0.4) -> np.ndarray:
    """Minus the state h in [-1, 1] of dh/dP = (1 - |h| (gamma + beta sgn(h dP))) / Y (Bouc, Wen), midpoint."""
    h, out = 0.0, np.empty(len(load))
    for k, rise in enumerate(np.diff(load, prepend=load[0]).tolist()):
        if rise:
            x = rise / yield_pa
            sign = 1.0 if rise > 0 else -1.0
            middle = h + x / 2 * (1 - abs(h) * (gamma + beta * (sign if h > 0 else -sign)))
            h += x * (1 - abs(middle) * (gamma + beta * (sign if middle > 0 else -sign)))
        out[k] = -h
    return out


def bouc_wen_of_many(load: np.ndarray, yield_pa: float, beta: float = 0.6, gamma: float = 0.4) -> np.ndarray:
    """The same for every column of `load` (n, n_taxels), float32."""
    h, out = np.zeros(load.shape[1]), np.empty(load.shape, np.float32)
    before = load[0]
    for k, now in enumerate(load):
        x = (now - before) / yield_pa
        sign = np.sign(x)
        middle = h + x / 2 * (1 - np.abs(h) * gamma - beta * h * sign)
        h = h + x * (1 - np.abs(middle) * gamma - beta * middle * sign)
        out[k] = -h
        before = now
    return out


def relay(load: np.ndarray, up: float, down: float) -> np.ndarray:
    """1 from load >= up until load <= down; 0 at first."""
    index = np.arange(len(load), dtype=np.int32)
    on = np.maximum.accumulate(np.where(load >= up, index, -1))
    off = np.maximum.accumulate(np.where(load <= down, index, 0))
    return (on > off).astype(float)


def preisach(load: np.ndarray, span: float, width: float, levels: int = 26) -> np.ndarray:
    """A Preisach density, log-normal in the relays' width and flat in their middle, less the load itself.

    Every fourth sample is taken; the output does not depend on rate.
    """
    slow = load[::4]
    middles = span * (np.arange(levels) + 0.5) / levels
    halves = width * np.exp(np.linspace(-1.2, 1.2, 9))
    weights = np.exp(-(np.linspace(-1.2, 1.2, 9) ** 2) / 0.5)
    total, sum_of_weights = np.zeros(len(slow)), 0.0
    for half, weight in zip(halves, weights, strict=True):
        for middle in middles:
            if middle + half < span:
                total += weight * relay(slow, middle + half, middle - half)
                sum_of_weights += weight
    grid = np.arange(len(load))
    return np.interp(grid, grid[::4], total * span / sum_of_weights) - load


def snap(load: np.ndarray, up: float, down: float, spread: float) -> np.ndarray:
    """A step of 1 Pa: nine domains that let go at slightly different pressures."""
    deviations = 1 + spread * np.array([-1.5, -1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0, 1.5])
    return np.mean([relay(load, up * d, down * d) for d in deviations], axis=0)


def relaxation(load: np.ndarray, tau_s: float, width_decades: float) -> np.ndarray:
    """A log-normal spectrum of relaxation times about tau, less the load."""
    positions = np.linspace(-2, 2, 7)
    weights = np.exp(-(positions**2) / 2)
    z = sum(w * low_pass(load, tau_s * 10 ** (width_decades * p)) for p, w in zip(positions, weights, strict=True))
    return z / weights.sum() - load


def power_law(load: np.ndarray, exponent: float, onset_s: float) -> np.ndarray:
    """Boltzmann superposition of J(t) = ((1 + t/t0)^n - 1) / ((1 + 60 s/t0)^n - 1)."""
    t = np.arange(len(load)) * STEP_S
    creep = ((1 + t / onset_s) ** exponent - 1) / ((1 + 60 / onset_s) ** exponent - 1)
    return fftconvolve(np.diff(load, prepend=load[0]), creep)[: len(load)]


def power_law_steady(cycle: np.ndarray, exponent: float) -> np.ndarray:
    """The same of a load that has repeated `cycle` for ever: (i w)^-n per harmonic, unity at the first."""
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
    # Every sample counts: a play nearly as wide as the cycle moves only where the load turns, and one that never moved
    # would be a static curve, of which the fit would get the rounding errors.
    n = len(cycle)
    features = plays(np.tile(cycle, 2), half * radii, mid)[:, n:].T - cycle[:, None]
    static = np.linalg.qr(np.vander((cycle - mid) / half, 4))[0]
    features -= static @ (static.T @ features)
    wanted = departure - static @ (static.T @ departure)
    weights, missed = nnls(features, wanted)
    # Wide plays are mostly static: what they add to the curve goes, or it would be many times the load.
    return departure - wanted + features @ weights, float(missed / np.linalg.norm(wanted))


# Outside the library -------------------------------------------------------------------------------------------------


def softening(load: np.ndarray, span: float, tau_s: float) -> np.ndarray:
    return load * low_pass(load, tau_s) / span


def mullins(load: np.ndarray, span: float, heal_s: float) -> np.ndarray:
    highest, keep, out = 0.0, np.exp(-STEP_S / heal_s), np.empty(len(load))
    for k, x in enumerate(load.tolist()):
        highest = max(x, highest * keep)
        out[k] = highest
    return load * out / span


def overshoot(load: np.ndarray, tau_s: float) -> np.ndarray:
    return load - low_pass(load, tau_s)


def rate_magnitude(load: np.ndarray, span: float) -> np.ndarray:
    return -span * np.tanh(np.abs(np.gradient(load, STEP_S)) / (0.3 * span))


def sticky_zone(load: np.ndarray, span: float, tau_s: float) -> np.ndarray:
    age, out = 0.0, np.empty(len(load))
    for k, x in enumerate((load < 0.05 * span).tolist()):
        age += STEP_S / tau_s * ((1 - age) if x else -2 * age)
        out[k] = age
    return -np.minimum(load, span * 0.3 * out)
