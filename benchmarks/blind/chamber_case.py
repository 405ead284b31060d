"""Draws a case of the chamber, and solves its amplitudes."""

import numpy as np

from benchmarks.blind import geometry as places
from benchmarks.blind.case import Case
from benchmarks.blind.effect import SCOPES, Effect, conceal, hysteresis_twin
from benchmarks.blind.faults import fault
from benchmarks.blind.geometry import Geometry
from benchmarks.blind.loads import Load, chamber
from benchmarks.blind.plan import Spec
from benchmarks.blind.ranges import draw
from benchmarks.blind.sensor import sensors
from benchmarks.blind.strength import Measure, solve

# What the data of an undecidable design cannot tell apart.
EQUIVALENT = {
    "sine": ("hysteresis", "creep", "viscoelasticity", "lag", "delay"),
    "ramps": ("hysteresis", "creep", "viscoelasticity"),
    "warm": ("temperature", "drift"),
}
_SIMULABLE = {"hysteresis", "creep", "viscoelasticity", "drift", "rezero"}
_ATTEMPTS = 4  # to draw a trial in which the strength asked for is within the effect's range


def _scope(rng: np.random.Generator, word: str, spec: Spec, own_clock: bool) -> str:
    if spec.kind in ("outside", "undecidable"):
        return "insole"
    options = SCOPES[word]
    if word == "delay" and own_clock:
        options = ("board",)  # a common one cannot be told from the offset
    if spec.kind == "triple":
        return options[0]
    # Half of what can be anywhere is everywhere: that is what physics mostly does.
    return options[0] if rng.random() < 0.5 else options[int(rng.integers(len(options)))]


def _clock(rng: np.random.Generator, spec: Spec) -> bool:
    """Whether the gauge has a clock of its own."""
    if "clock" in spec.words:
        return True
    if spec.kind == "undecidable" or spec.variant in EQUIVALENT:
        return False
    return bool(rng.random() < (0.3 if {"lag", "delay"} & set(spec.words) else 0.5))


def _undecidable(rng: np.random.Generator, spec: Spec, geometry: Geometry, load: Load) -> Effect:
    word = EQUIVALENT[spec.variant][int(rng.integers(len(EQUIVALENT[spec.variant])))]
    if spec.variant == "warm":
        effect = conceal(rng, geometry, load, word, "insole")
        effect.shape.update({"gain_per_k": 0.0, "start_s": 0.0, "settle_s": 0.4 * load.main_s})
        return effect
    if spec.variant == "ramps" and word == "viscoelasticity":
        word = "creep"  # the other two are made to look alike exactly
    if word == "hysteresis":
        return hysteresis_twin(conceal(rng, geometry, load, "creep", "insole"), load)[0]
    return conceal(rng, geometry, load, word, "insole")


def _draw_once(rng: np.random.Generator, spec: Spec) -> Case:
    foot = ("left", "right")[int(rng.integers(2))]
    geometry = places.insole(foot, int(rng.choice([5, 8])))
    these = sensors(rng)
    protocol = spec.variant if spec.variant in ("sine", "ramps") else "full"
    load = chamber(rng, protocol, ("bag", "plenum")[int(rng.integers(2))], spec.variant == "warm")
    simulated = spec.variant == "" and set(spec.words) <= _SIMULABLE and bool(rng.random() < 0.15)
    own_clock = _clock(rng, spec) or simulated  # a simulation's offset is unknown too
    effects: list[Effect] = []
    if spec.kind == "undecidable":
        effects.append(_undecidable(rng, spec, geometry, load))
    elif spec.kind != "fault":
        for word in spec.words:
            effects.append(conceal(rng, geometry, load, word, _scope(rng, word, spec, own_clock), spec.variant))
    solved, k, fraction = [], {}, {}
    for effect in effects:
        measure = Measure(load, these, effect, own_clock)
        effect = effect.with_amplitude(1.0) if effect.word == "bit_shift" else solve(measure, spec.k)
        k[effect.word] = measure.k(effect.amplitude)
        fraction[effect.word] = measure.amplitude_fraction(effect.amplitude)
        solved.append(effect)
    rate = 1e-6 * draw(rng, "chamber", "own_clock_rate_ppm")
    for effect in solved:
        if effect.word == "clock":
            rate = 1e-6 * effect.amplitude * effect.shape["sign"]
    faults = [fault(rng, geometry, load, word) for word in spec.words] if spec.kind == "fault" else []
    return Case(
        spec=spec,
        geometry=geometry,
        sensors=these,
        load=load,
        effects=tuple(solved),
        faults=tuple(faults),
        k=k,
        amplitude_fraction=fraction,
        own_clock=own_clock,
        offset_s=draw(rng, "chamber", "own_clock_offset_s") if own_clock else 0.0,
        rate=rate if own_clock else 0.0,
        simulated=simulated,
        epoch_s=1_600_000_000 + int(rng.integers(150_000_000)),
        rng=rng,
    )


def chamber_case(seed: int, index: int, spec: Spec) -> Case:
    """Case `index` of the seed. Drawn again where the trial cannot show the effect as strongly as asked."""
    rng = np.random.default_rng([seed, 1, index])
    made = [_draw_once(rng, spec)]
    while min(made[-1].k.values(), default=np.inf) < 0.95 * spec.k and len(made) < _ATTEMPTS:
        made.append(_draw_once(rng, spec))
    return max(made, key=lambda case: min(case.k.values(), default=np.inf))
