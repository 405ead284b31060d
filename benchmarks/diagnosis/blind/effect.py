"""One concealed effect: its word, where it is, how strong, and its law."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from . import laws
from .geometry import PRESSURE_TAXELS, Geometry
from .ranges import draw, entry
from .trial import Trial

# The parameter that is solved for the strength asked for, by word, as ranges.yaml calls it.
SOLVED = {
    "hysteresis": "amplitude_fraction",
    "snap": "step_fraction",
    "viscoelasticity": "a",
    "creep": "a",
    "lag": "tau_s",
    "delay": "delay_s",
    "temperature": "count_per_k",
    "drift": "shift_count",
    "rezero": "when_fraction",
    "stiffening": "strength",
    "gain": "gain",
    "baseline": "shift_count",
    "preload": "p0_pa",
    "crosstalk": "k",
    "swapped_triangles": "distance_mm",
    "map_transform": "shift_mm",
    "bit_shift": "step",
    "clock": "rate_ppm",
}
# What a static recalibration removes: its strength is measured before one.
RECALIBRATION = ("gain", "baseline", "stiffening", "preload", "bit_shift")
MAPPING = ("swapped_triangles", "map_transform")
MEMORY = ("hysteresis", "snap", "viscoelasticity", "creep", "lag")
# In the order of the signal path; what is outside the vocabulary acts where hysteresis does.
_MATERIAL_UNKNOWN = ("softening", "mullins", "overshoot", "rate_magnitude", "sticky_zone")
ON_THE_LOAD = ("preload", "crosstalk", "hysteresis", "snap", *_MATERIAL_UNKNOWN, "viscoelasticity", "creep", "lag")
LINEAR_IN_TIME = ("viscoelasticity", "creep", "lag")
UNKNOWN = tuple(entry("unknown"))
# Scopes an effect can have, by word; everything else can be anywhere.
_MATERIAL_SCOPES = ("insole", "board", "group", "triangle", "taxel")
SCOPES = {
    "lag": ("insole", "board"),
    "delay": ("insole", "board"),
    "temperature": ("insole", "board", "triangle"),
    "drift": ("insole", "board", "group", "triangle"),
    "rezero": ("board",),
    "stiffening": ("insole", "board"),
    "gain": ("insole", "board", "group", "triangle"),
    "baseline": ("insole", "board", "group", "triangle"),
    "preload": ("insole", "board"),
    "crosstalk": ("insole",),
    "map_transform": ("insole",),
    "swapped_triangles": ("pair",),
    "clock": ("insole",),
    "bit_shift": ("board",),
}


@dataclass(frozen=True)
class Effect:
    """`word` as in formats.md; `law` is this generator's name for what it does."""

    word: str
    law: str
    where: dict[str, Any]
    place: np.ndarray  # (28, 12) bool
    amplitude: float = 0.0
    shape: dict[str, Any] = field(default_factory=dict)

    def with_amplitude(self, amplitude: float) -> "Effect":
        return replace(self, amplitude=amplitude)

    @property
    def signed(self) -> float:
        return self.amplitude * float(self.shape.get("sign", 1.0))

    @property
    def limits(self) -> tuple[float, float]:
        """Least and largest amplitude."""
        found = entry("unknown", self.law, "m") if self.word == "unknown" else entry("effects", self.word, self.solved)
        low, high = found["range"]
        return float(low), float(high)

    @property
    def solved(self) -> str:
        return str(self.shape.get("solved", SOLVED.get(self.word, "m")))


def scopes(word: str) -> tuple[str, ...]:
    """Scopes that an effect of that word can have, the widest first."""
    return SCOPES.get(word, _MATERIAL_SCOPES)


def _neighbours(geometry: Geometry, triangle: int, n: int) -> list[int]:
    away = np.hypot(*(geometry.centre_mm - geometry.centre_mm[triangle]).T)
    return [int(t) for t in np.argsort(away)[:n]]


def place(
    rng: np.random.Generator, geometry: Geometry, scope: str, loaded: np.ndarray
) -> tuple[dict[str, Any], np.ndarray]:
    """A place of that scope: its `where` and its (28, 12) mask.

    loaded: (28,) share of the highest load that a triangle bears; a place that is never loaded would show nothing.
    """
    mask = np.zeros((28, 12), bool)
    chosen = int(rng.choice(np.flatnonzero(loaded >= min(0.3, loaded.max()))))
    name = [[int(a), int(s)] for a, s in zip(geometry.address, geometry.slot, strict=True)]
    ids: list[list[int]] = []
    kind = scope
    if scope == "insole":
        mask[:] = True
    elif scope == "board":
        address = int(geometry.address[chosen]) if rng.random() < 0.5 else int(rng.choice(geometry.addresses))
        mask[geometry.address == address] = True
        ids = [[address]]
    elif scope in ("triangle", "group"):
        triangles = [chosen] if scope == "triangle" else sorted(_neighbours(geometry, chosen, int(rng.integers(2, 5))))
        mask[triangles] = True
        ids, kind = [name[t] for t in triangles], "triangle"
    else:
        about = geometry.taxel_mm[chosen, int(rng.choice(PRESSURE_TAXELS))]
        near = sorted(PRESSURE_TAXELS, key=lambda k: float(np.hypot(*(geometry.taxel_mm[chosen, k] - about))))
        taxels = sorted(near[: int(rng.integers(3, 7))])
        mask[chosen, taxels] = True
        ids = [[*name[chosen], k] for k in taxels]
    mask[:, [k for k in range(12) if k not in PRESSURE_TAXELS]] = False
    return {"scope": kind, "ids": ids}, mask


def _shape(rng: np.random.Generator, trial: Trial, word: str, law: str) -> dict[str, Any]:
    """What is drawn of an effect beside its amplitude."""

    def drawn(name: str) -> Any:
        return draw(rng, "effects", word, name)

    sign = 1.0 if rng.random() < 0.5 else -1.0
    if word == "unknown":
        values = {name: e["range"] for name, e in entry("unknown", law).items() if name not in ("m", "source")}
        shape: dict[str, Any] = {name: float(rng.uniform(low, high)) for name, (low, high) in values.items()}
        return shape | {"start_s": trial.main_s * float(rng.uniform(0.1, 0.25)), "seed": int(rng.integers(2**31))}
    if word == "hysteresis":
        family = drawn("family") if trial.kind == "chamber" else "bouc_wen"
        width = trial.span_pa * drawn("yield_fraction")
        return {"family": family, "width_pa": width, "beta": float(rng.uniform(0.5, 0.7))}
    if word == "snap":
        up = trial.span_pa * drawn("up_fraction")
        return {"up_pa": up, "down_pa": up * drawn("down_fraction"), "spread": drawn("threshold_spread")}
    if word == "viscoelasticity":
        return {"tau_s": drawn("tau_s"), "width": drawn("width_decades")}
    if word == "creep":
        return {"exponent": drawn("exponent"), "onset_s": drawn("onset_s")}
    if word == "temperature":
        return {"sign": sign, "gain_per_k": drawn("gain_per_k")}
    if word == "drift":
        start = trial.main_s * float(rng.uniform(0.0, 0.3))
        return {"sign": sign, "settle_s": drawn("settle_s"), "start_s": start}
    if word == "stiffening":
        return {"knee_pa": trial.span_pa * drawn("knee_fraction")}
    if word == "bit_shift":
        return {"step": drawn("step")}
    if word in ("gain", "baseline", "clock"):
        return {"sign": sign}
    return {}


def conceal(
    rng: np.random.Generator,
    geometry: Geometry,
    trial: Trial,
    word: str,
    scope: str,
    law: str = "",
) -> Effect:
    """An effect of that word (`unknown`: of that law) somewhere of that scope; its amplitude is still to be solved."""
    if word in MAPPING:
        return _displaced(rng, geometry, trial, word)
    peak = trial.pressure(geometry.centre_mm).max(0)
    where, mask = place(rng, geometry, scope, peak / peak.max())
    shape = {"span_pa": trial.span_pa} | _shape(rng, trial, word, law)
    return Effect(word, law or word, where, mask, 0.0, shape)


def _displaced(rng: np.random.Generator, geometry: Geometry, trial: Trial, word: str) -> Effect:
    mask = np.zeros((28, 12), bool)
    if word == "swapped_triangles":
        # Two under which different things happen: neighbours would hardly differ.
        away = np.hypot(*(geometry.centre_mm[:, None] - geometry.centre_mm[None]).transpose(2, 0, 1))
        peak = trial.pressure(geometry.centre_mm).max(0)
        apart = np.abs(peak[:, None] - peak[None]) > 0.3 * peak.max()
        a, b = (int(x) for x in rng.choice(np.argwhere(np.triu(apart & (away > 60)))))
        mask[np.ix_([a, b], PRESSURE_TAXELS)] = True
        ids = [[int(geometry.address[t]), int(geometry.slot[t])] for t in (a, b)]
        return Effect(word, word, {"scope": "triangle", "ids": ids}, mask, float(away[a, b]), {"pair": [a, b]})
    mask[:, PRESSURE_TAXELS] = True
    turn = float(draw(rng, "effects", word, "rotation_deg")) * (1 if rng.random() < 0.5 else -1)
    shape = {"way": float(rng.uniform(0, 2 * np.pi)), "rotation_deg": turn}
    return Effect(word, word, {"scope": "insole", "ids": []}, mask, 0.0, shape)


def positions(geometry: Geometry, effects: tuple[Effect, ...]) -> np.ndarray:
    """(28, 12, 2) mm: where the taxels truly lie."""
    at = geometry.taxel_mm.copy()
    for e in effects:
        if e.word == "swapped_triangles":
            a, b = e.shape["pair"]
            at[[a, b]] = at[[b, a]]
        elif e.word == "map_transform":
            middle = geometry.centre_mm.mean(0)
            c, s = np.cos(np.radians(e.shape["rotation_deg"])), np.sin(np.radians(e.shape["rotation_deg"]))
            shift = e.amplitude * np.array([np.cos(e.shape["way"]), np.sin(e.shape["way"])])
            at = (at - middle) @ np.array([[c, s], [-s, c]]) + middle + shift
    return at


def crosstalk_field(trial: Trial, at_mm: np.ndarray) -> np.ndarray:
    """(336, n_regions): the field of the mean of a taxel's neighbours, nearer ones counting more, less its own."""
    flat = at_mm.reshape(-1, 2)
    away = np.hypot(*(flat[:, None] - flat[None]).transpose(2, 0, 1))
    weights = np.exp(-((away / 7.0) ** 2)) * (away < 13)
    np.fill_diagonal(weights, 0)
    pads = np.ones((28, 12), bool)
    pads[:, PRESSURE_TAXELS] = False
    weights[:, pads.ravel()] = 0
    field_ = trial.field(flat)
    return weights / weights.sum(1, keepdims=True) @ field_ - field_


def departure(effect: Effect, trial: Trial, load: np.ndarray) -> np.ndarray:
    """What the effect adds to the load (n, n_columns), Pa per unit of its amplitude (of a lag: all of it)."""
    s, law = effect.shape, effect.law
    span = s.get("span_pa", trial.span_pa)
    if "departure" in s:
        return np.asarray(s["departure"], np.float32)[:, None] * np.ones(load.shape[1], np.float32)
    if law == "preload":
        return np.ones_like(load)
    if law == "hysteresis":
        # The state saturates at 1: the amplitude is half the width of a full loop over the span.
        if s["family"] == "bouc_wen":
            return np.float32(span) * laws.bouc_wen(load, s["width_pa"], s["beta"], 1 - s["beta"])
        return laws.preisach(load, span, s["width_pa"]) * np.float32(span / s["width_pa"] / 2)
    if law == "snap":
        return np.float32(span) * laws.snap(load, s["up_pa"], s["down_pa"], s["spread"])
    if law == "viscoelasticity":
        return laws.relaxation(load, s["tau_s"], s["width"])
    if law == "creep":
        if trial.cycle is not None:
            one = laws.power_law_steady(trial.cycle, s["exponent"])
            return np.resize(one, len(load)).astype(np.float32)[:, None] * np.ones(load.shape[1], np.float32)
        return laws.power_law(load, s["exponent"], s["onset_s"])
    if law == "lag":
        return laws.low_pass(load, effect.amplitude) - load
    if law == "softening":
        return laws.softening(load, span, s["tau_s"])
    if law == "mullins":
        return laws.mullins(load, span, s["heal_s"])
    if law == "overshoot":
        return laws.overshoot(load, s["tau_s"])
    if law == "rate_magnitude":
        return laws.rate_magnitude(load, span)
    assert law == "sticky_zone", law
    return laws.sticky_zone(load, span, s["tau_s"])


def hysteresis_twin(creep: Effect, trial: Trial) -> tuple[Effect, float]:
    """A rate-independent material that this one-speed load cannot tell from `creep`; and by what part of the loop it
    could."""
    assert trial.cycle is not None
    wanted = laws.power_law_steady(trial.cycle, creep.shape["exponent"])
    one, missed = laws.hysteresis_like(trial.cycle, wanted)
    shape = {"family": "plays", "departure": np.resize(one, len(trial.courses))}
    return replace(creep, word="hysteresis", law="hysteresis", shape=shape), missed
