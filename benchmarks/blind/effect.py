"""One concealed effect: its word, where it is, how strong, and what it does on the 1 kHz grid."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.blind import laws
from benchmarks.blind.geometry import PRESSURE_TAXELS, Geometry
from benchmarks.blind.loads import Load
from benchmarks.blind.ranges import draw, entry, limits

# The value an amplitude is solved for, by effect; what stands for it in ranges.yaml.
SOLVED = {
    "hysteresis": "amplitude_fraction",
    "snap": "step_fraction",
    "viscoelasticity": "a",
    "creep": "a",
    "lag": "tau_s",
    "delay": "delay_s",
    "temperature": "count_per_k",
    "drift": "shift_count",
    "rezero": "shift_count",
    "stiffening": "strength",
    "gain": "gain",
    "baseline": "shift_count",
    "clock": "rate_ppm",
}
UNKNOWN = tuple(entry("unknown"))
# Where an effect can be; gain or baseline of a whole insole is what every calibration has a few per cent of.
SCOPES = {
    "hysteresis": ("insole", "board", "triangle", "taxel"),
    "snap": ("insole", "board", "triangle", "taxel"),
    "viscoelasticity": ("insole", "board", "triangle", "taxel"),
    "creep": ("insole", "board", "triangle", "taxel"),
    "lag": ("insole", "board"),
    "delay": ("insole", "board"),
    "temperature": ("insole", "board", "triangle"),
    "drift": ("insole", "board", "triangle"),
    "rezero": ("board",),
    "stiffening": ("insole",),
    "gain": ("board", "triangle"),
    "baseline": ("board", "triangle"),
    "clock": ("insole",),
    "bit_shift": ("board",),
}
ON_THE_LOAD = ("hysteresis", "snap", "softening", "mullins", "overshoot", "rate_magnitude", "sticky_zone")


@dataclass(frozen=True)
class Effect:
    """`word` as the contract has it; `law` is this generator's name for what it does."""

    word: str
    law: str
    where: dict[str, Any]
    place: np.ndarray  # (28, 12) bool
    amplitude: float = 0.0
    shape: dict[str, Any] = field(default_factory=dict)
    departure: np.ndarray | None = None  # (n,) Pa per unit of amplitude, of what works on the load itself

    def with_amplitude(self, amplitude: float) -> "Effect":
        return replace(self, amplitude=amplitude)

    @property
    def limits(self) -> tuple[float, float]:
        if self.word == "unknown":
            low, high = entry("unknown", self.law)["m"]["range"]
        else:
            low, high = limits("effects", self.word, SOLVED[self.word])
        return low, high


def place(rng: np.random.Generator, geometry: Geometry, scope: str) -> tuple[dict[str, Any], np.ndarray]:
    """A place of that scope: its `where` and its (28, 12) mask; taxels are three to six neighbours of one triangle."""
    mask = np.zeros((28, 12), bool)
    chosen = int(rng.integers(28))
    address, slot = int(geometry.address[chosen]), int(geometry.slot[chosen])
    ids: list[list[int]] = []
    if scope == "insole":
        mask[:] = True
    elif scope == "board":
        address = int(rng.choice(geometry.addresses))
        mask[geometry.address == address] = True
        ids = [[address]]
    elif scope == "triangle":
        mask[chosen] = True
        ids = [[address, slot]]
    else:
        about = geometry.taxel_mm[chosen, int(rng.choice(PRESSURE_TAXELS))]
        near = sorted(PRESSURE_TAXELS, key=lambda k: float(np.hypot(*(geometry.taxel_mm[chosen, k] - about))))
        taxels = sorted(near[: int(rng.integers(3, 7))])
        mask[chosen, taxels] = True
        ids = [[address, slot, k] for k in taxels]
    mask[:, [k for k in range(12) if k not in PRESSURE_TAXELS]] = False
    return {"scope": scope, "ids": ids}, mask


def _hysteresis(rng: np.random.Generator, load: Load) -> tuple[dict[str, Any], np.ndarray]:
    family = draw(rng, "effects", "hysteresis", "family")
    width = load.span_pa * draw(rng, "effects", "hysteresis", "yield_fraction")
    history = np.concatenate([load.pressure_pa[: load.lead], load.pressure_pa])
    if family == "bouc_wen":
        raw = load.span_pa * laws.bouc_wen(history, width)[load.lead :]
    else:
        raw = laws.preisach(history, load.span_pa, width)[load.lead :]
    # In units of half a loop, so that the amplitude is the fraction of the span the loop is wide.
    static = np.linalg.qr(np.vander(load.pressure_pa[::50] / load.span_pa, 4))[0]
    loop = raw[::50] - static @ (static.T @ raw[::50])
    return {"family": family}, raw * load.span_pa / (np.ptp(loop) / 2)


def _snap(rng: np.random.Generator, load: Load) -> tuple[dict[str, Any], np.ndarray]:
    up = load.span_pa * draw(rng, "effects", "snap", "up_fraction")
    down = up * draw(rng, "effects", "snap", "down_fraction")
    raw = laws.snap(load.pressure_pa, up, down, draw(rng, "effects", "snap", "threshold_spread"))
    return {"up_pa": up, "down_pa": down}, raw * load.span_pa


def _unknown(rng: np.random.Generator, load: Load, law: str) -> tuple[dict[str, Any], np.ndarray | None]:
    drawn = {name: e["range"] for name, e in entry("unknown", law).items() if name not in ("m", "source")}
    shape = {name: float(rng.uniform(low, high)) for name, (low, high) in drawn.items()}
    p, span = load.pressure_pa, load.span_pa
    departures: dict[str, Callable[[], np.ndarray]] = {
        "softening": lambda: laws.softening(p, span, shape["tau_s"]),
        "mullins": lambda: laws.mullins(p, span, shape["heal_s"]),
        "overshoot": lambda: laws.overshoot(p, shape["tau_s"]),
        "rate_magnitude": lambda: laws.rate_magnitude(p, span),
        "sticky_zone": lambda: laws.sticky_zone(p, span, shape["tau_s"]),
    }
    return shape, departures[law]() if law in departures else None


def hysteresis_twin(creep: Effect, load: Load) -> tuple[Effect, float]:
    """A rate-independent material that this one-speed load cannot tell from `creep`; and by what part of the loop it
    could."""
    assert load.cycle is not None
    wanted = laws.power_law_steady(load.cycle, creep.shape["exponent"])
    one, missed = laws.hysteresis_like(load.cycle, wanted)
    departure = np.resize(one, len(load.pressure_pa))
    return replace(creep, word="hysteresis", law="hysteresis", departure=departure, shape={"family": "plays"}), missed


def conceal(rng: np.random.Generator, geometry: Geometry, load: Load, word: str, scope: str, law: str = "") -> Effect:
    """An effect of that word (`unknown`: of that `law`) somewhere of that scope, its amplitude still to be solved."""
    where, mask = place(rng, geometry, scope)
    sign = 1.0 if rng.random() < 0.5 else -1.0
    shape: dict[str, Any] = {}
    departure = None
    main = load.main_s
    if word == "unknown":
        shape, departure = _unknown(rng, load, law)
        shape["start_s"] = main * float(rng.uniform(0.1, 0.25))
    elif word == "hysteresis":
        shape, departure = _hysteresis(rng, load)
    elif word == "snap":
        shape, departure = _snap(rng, load)
    elif word == "viscoelasticity":
        shape = {"tau_s": draw(rng, "effects", word, "tau_s"), "width": draw(rng, "effects", word, "width_decades")}
    elif word == "creep":
        shape = {"exponent": draw(rng, "effects", word, "exponent"), "onset_s": draw(rng, "effects", word, "onset_s")}
    elif word == "temperature":
        shape = {"sign": sign, "gain_per_k": draw(rng, "effects", word, "gain_per_k")}
    elif word == "drift":
        settle = draw(rng, "effects", word, "settle_s")
        shape = {"sign": sign, "settle_s": settle, "start_s": main * float(rng.uniform(0.0, 0.3))}
    elif word == "rezero":
        shape = {"sign": sign, "t_s": main * draw(rng, "effects", word, "when_fraction")}
    elif word == "stiffening":
        shape = {"knee_pa": load.span_pa * draw(rng, "effects", word, "knee_fraction")}
    elif word in ("gain", "baseline", "clock"):
        shape = {"sign": sign}
    elif word == "bit_shift":
        shape = {"step": draw(rng, "effects", word, "step")}
    return Effect(word, law or word, where, mask, 0.0, shape, departure)
