"""A concealed effect: its word, place, amplitude and law."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from . import laws
from .geometry import PRESSURE_TAXELS, Geometry
from .ranges import draw, entry, limits
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
# In the order of the signal path. Effects outside the vocabulary act at the place of hysteresis.
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
    """`word` is the effect's name in formats.md; `law` is the name of its law in this generator."""

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
        """The amplitude with the sign that was drawn."""
        return self.amplitude * float(self.shape.get("sign", 1.0))

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest amplitude in `ranges.yaml`."""
        low, high = (
            limits("unknown", self.law, "m") if self.word == "unknown" else limits("effects", self.word, self.solved)
        )
        return float(low), float(high)

    @property
    def solved(self) -> str:
        """Name of the parameter that is solved for, in `ranges.yaml`."""
        return str(self.shape.get("solved", SOLVED.get(self.word, "m")))


def scopes_of(word: str) -> tuple[str, ...]:
    """Scopes that an effect called `word` can have, the widest first."""
    return SCOPES.get(word, _MATERIAL_SCOPES)


def _neighbours(geometry: Geometry, triangle: int, n: int) -> list[int]:
    """The `n` triangles nearest to `triangle`, itself first."""
    distance_mm = np.hypot(*(geometry.centre_mm - geometry.centre_mm[triangle]).T)
    return [int(t) for t in np.argsort(distance_mm)[:n]]


def draw_place(
    rng: np.random.Generator, geometry: Geometry, scope: str, peak_share: np.ndarray
) -> tuple[dict[str, Any], np.ndarray]:
    """Draw a place of the scope; return its `where` and its mask (28, 12) bool.

    peak_share: (28,) highest load of each triangle, relative to the largest. A place without load would show nothing.
    """
    mask = np.zeros((28, 12), bool)
    chosen = int(rng.choice(np.flatnonzero(peak_share >= min(0.3, peak_share.max()))))
    triangle_ids = [[int(a), int(s)] for a, s in zip(geometry.address, geometry.slot, strict=True)]
    ids: list[list[int]] = []
    stated_scope = scope
    if scope == "insole":
        mask[:] = True
    elif scope == "board":
        address = int(geometry.address[chosen]) if rng.random() < 0.5 else int(rng.choice(geometry.addresses))
        mask[geometry.address == address] = True
        ids = [[address]]
    elif scope in ("triangle", "group"):
        triangles = [chosen] if scope == "triangle" else sorted(_neighbours(geometry, chosen, int(rng.integers(2, 5))))
        mask[triangles] = True
        ids, stated_scope = [triangle_ids[t] for t in triangles], "triangle"
    else:
        middle_mm = geometry.taxel_mm[chosen, int(rng.choice(PRESSURE_TAXELS))]
        by_distance = sorted(
            PRESSURE_TAXELS, key=lambda k: float(np.hypot(*(geometry.taxel_mm[chosen, k] - middle_mm)))
        )
        taxels = sorted(by_distance[: int(rng.integers(3, 7))])
        mask[chosen, taxels] = True
        ids = [[*triangle_ids[chosen], k] for k in taxels]
    mask[:, [k for k in range(12) if k not in PRESSURE_TAXELS]] = False
    return {"scope": stated_scope, "ids": ids}, mask


def _draw_shape(rng: np.random.Generator, trial: Trial, word: str, law: str) -> dict[str, Any]:
    """Draw the parameters of an effect other than its amplitude."""

    def draw_parameter(name: str) -> Any:
        return draw(rng, "effects", word, name)

    sign = 1.0 if rng.random() < 0.5 else -1.0
    if word == "unknown":
        values = {name: e["range"] for name, e in entry("unknown", law).items() if name not in ("m", "source")}
        shape: dict[str, Any] = {name: float(rng.uniform(low, high)) for name, (low, high) in values.items()}
        return shape | {"start_s": trial.main_s * float(rng.uniform(0.1, 0.25)), "seed": int(rng.integers(2**31))}
    if word == "hysteresis":
        family = draw_parameter("family") if trial.kind == "chamber" else "bouc_wen"
        width = trial.span_pa * draw_parameter("yield_fraction")
        return {"family": family, "width_pa": width, "beta": float(rng.uniform(0.5, 0.7))}
    if word == "snap":
        up = trial.span_pa * draw_parameter("up_fraction")
        return {
            "up_pa": up,
            "down_pa": up * draw_parameter("down_fraction"),
            "spread": draw_parameter("threshold_spread"),
        }
    if word == "viscoelasticity":
        return {"tau_s": draw_parameter("tau_s"), "width": draw_parameter("width_decades")}
    if word == "creep":
        return {"exponent": draw_parameter("exponent"), "onset_s": draw_parameter("onset_s")}
    if word == "temperature":
        return {"sign": sign, "gain_per_k": draw_parameter("gain_per_k")}
    if word == "drift":
        start = trial.main_s * float(rng.uniform(0.0, 0.3))
        return {"sign": sign, "settle_s": draw_parameter("settle_s"), "start_s": start}
    if word == "stiffening":
        return {"knee_pa": trial.span_pa * draw_parameter("knee_fraction")}
    if word == "bit_shift":
        return {"step": draw_parameter("step")}
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
    """Draw an effect called `word` (if `unknown`: with `law`) at a place of the scope; its amplitude is still 0."""
    if word in MAPPING:
        return _conceal_displacement(rng, geometry, trial, word)
    peak = trial.pressure(geometry.centre_mm).max(0)
    where, mask = draw_place(rng, geometry, scope, peak / peak.max())
    shape = {"span_pa": trial.span_pa} | _draw_shape(rng, trial, word, law)
    return Effect(word, law or word, where, mask, 0.0, shape)


def _conceal_displacement(rng: np.random.Generator, geometry: Geometry, trial: Trial, word: str) -> Effect:
    """Draw an effect of `MAPPING`, by which taxels lie elsewhere than in the layout."""
    mask = np.zeros((28, 12), bool)
    if word == "swapped_triangles":
        # The two triangles are far apart and differ in load, because an exchange of neighbours would show little.
        distance_mm = np.hypot(*(geometry.centre_mm[:, None] - geometry.centre_mm[None]).transpose(2, 0, 1))
        peak = trial.pressure(geometry.centre_mm).max(0)
        differs = np.abs(peak[:, None] - peak[None]) > 0.3 * peak.max()
        a, b = (int(x) for x in rng.choice(np.argwhere(np.triu(differs & (distance_mm > 60)))))
        mask[np.ix_([a, b], PRESSURE_TAXELS)] = True
        ids = [[int(geometry.address[t]), int(geometry.slot[t])] for t in (a, b)]
        return Effect(word, word, {"scope": "triangle", "ids": ids}, mask, float(distance_mm[a, b]), {"pair": [a, b]})
    mask[:, PRESSURE_TAXELS] = True
    rotation_deg = float(draw(rng, "effects", word, "rotation_deg")) * (1 if rng.random() < 0.5 else -1)
    shape = {"way": float(rng.uniform(0, 2 * np.pi)), "rotation_deg": rotation_deg}
    return Effect(word, word, {"scope": "insole", "ids": []}, mask, 0.0, shape)


def positions(geometry: Geometry, effects: tuple[Effect, ...]) -> np.ndarray:
    """True positions of the taxels, (28, 12, 2) in mm."""
    taxels_mm = geometry.taxel_mm.copy()
    for effect in effects:
        if effect.word == "swapped_triangles":
            a, b = effect.shape["pair"]
            taxels_mm[[a, b]] = taxels_mm[[b, a]]
        elif effect.word == "map_transform":
            middle = geometry.centre_mm.mean(0)
            angle = np.radians(effect.shape["rotation_deg"])
            cosine, sine = np.cos(angle), np.sin(angle)
            shift = effect.amplitude * np.array([np.cos(effect.shape["way"]), np.sin(effect.shape["way"])])
            taxels_mm = (taxels_mm - middle) @ np.array([[cosine, sine], [-sine, cosine]]) + middle + shift
    return taxels_mm


def crosstalk_field(trial: Trial, taxels_mm: np.ndarray) -> np.ndarray:
    """(336, n_regions): mean field of a taxel's neighbours, weighted by distance, minus the taxel's own field."""
    flat_mm = taxels_mm.reshape(-1, 2)
    distance_mm = np.hypot(*(flat_mm[:, None] - flat_mm[None]).transpose(2, 0, 1))
    weights = np.exp(-((distance_mm / 7.0) ** 2)) * (distance_mm < 13)
    np.fill_diagonal(weights, 0)
    is_pad = np.ones((28, 12), bool)
    is_pad[:, PRESSURE_TAXELS] = False
    weights[:, is_pad.ravel()] = 0
    field_at_taxel = trial.field(flat_mm)
    return weights / weights.sum(1, keepdims=True) @ field_at_taxel - field_at_taxel


def departure(effect: Effect, trial: Trial, load: np.ndarray) -> np.ndarray:
    """What the effect adds to `load` (n, n_columns): Pa per unit of its amplitude; of a lag, the whole change in Pa."""
    shape, law = effect.shape, effect.law
    span = shape.get("span_pa", trial.span_pa)
    if "departure" in shape:
        return np.asarray(shape["departure"], np.float32)[:, None] * np.ones(load.shape[1], np.float32)
    if law == "preload":
        return np.ones_like(load)
    if law == "hysteresis":
        # The state saturates at 1: the amplitude is half the width of a full loop over the span.
        if shape["family"] == "bouc_wen":
            return np.float32(span) * laws.bouc_wen(load, shape["width_pa"], shape["beta"], 1 - shape["beta"])
        return laws.preisach(load, span, shape["width_pa"]) * np.float32(span / shape["width_pa"] / 2)
    if law == "snap":
        return np.float32(span) * laws.snap(load, shape["up_pa"], shape["down_pa"], shape["spread"])
    if law == "viscoelasticity":
        return laws.relaxation(load, shape["tau_s"], shape["width"])
    if law == "creep":
        if trial.cycle is not None:
            of_one_cycle = laws.power_law_steady(trial.cycle, shape["exponent"])
            return np.resize(of_one_cycle, len(load)).astype(np.float32)[:, None] * np.ones(load.shape[1], np.float32)
        return laws.power_law(load, shape["exponent"], shape["onset_s"])
    if law == "lag":
        return laws.low_pass(load, effect.amplitude) - load
    if law == "softening":
        return laws.softening(load, span, shape["tau_s"])
    if law == "mullins":
        return laws.mullins(load, span, shape["heal_s"])
    if law == "overshoot":
        return laws.overshoot(load, shape["tau_s"])
    if law == "rate_magnitude":
        return laws.rate_magnitude(load, span)
    assert law == "sticky_zone", law
    return laws.sticky_zone(load, span, shape["tau_s"])


def hysteresis_twin(creep: Effect, trial: Trial) -> tuple[Effect, float]:
    """A hysteresis that a load of a single speed cannot tell from `creep`, and the share of the loop that differs."""
    assert trial.cycle is not None
    loop = laws.power_law_steady(trial.cycle, creep.shape["exponent"])
    of_one_cycle, missed_share = laws.hysteresis_like(trial.cycle, loop)
    shape = {"family": "plays", "departure": np.resize(of_one_cycle, len(trial.courses))}
    return replace(creep, word="hysteresis", law="hysteresis", shape=shape), missed_share
