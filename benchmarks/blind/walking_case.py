"""Draws a case of walking: a force shoe, or for what is about the map a simulated recording of the same walk."""

import numpy as np

from benchmarks.blind import geometry as places
from benchmarks.blind.case import Case
from benchmarks.blind.effect import Effect
from benchmarks.blind.geometry import PRESSURE_TAXELS, Geometry
from benchmarks.blind.plan import Spec
from benchmarks.blind.ranges import draw
from benchmarks.blind.sensor import sensors
from benchmarks.blind.walk_chain import FULL_PA, WalkChain, force_strength
from benchmarks.blind.walking import Walk, walk

WANTED_K = 3.0
_ATTEMPTS = 4  # to draw an effect that is as strong; under the arch none may be
_PATCHES = {"front": 0, "middle": 1, "rear": 2}


def _effect(rng: np.random.Generator, geometry: Geometry, load: Walk, word: str, patch: str) -> Effect:
    mask = np.zeros((28, 12), bool)
    mask[:, PRESSURE_TAXELS] = True
    where = {"scope": "insole", "ids": []}
    if patch:
        board = geometry.board == _PATCHES[patch]
        mask &= board[:, None]
        where = {"scope": "board", "ids": [[int(geometry.address[board][0])]]}
    if word == "hysteresis":
        width = FULL_PA * draw(rng, "effects", "hysteresis", "yield_fraction")
        return Effect(word, word, where, mask, draw(rng, "walking", "hysteresis_fraction"), {"yield_pa": width})
    if word == "viscoelasticity":
        shape = {"tau_s": draw(rng, "walking", "viscoelasticity_tau_s"), "width": 0.15}
        return Effect(word, word, where, mask, draw(rng, "walking", "viscoelasticity_a"), shape)
    if word == "drift":
        shape = {"sign": 1.0 if rng.random() < 0.5 else -1.0, "settle_s": 0.3 * load.main_s, "start_s": 0.0}
        return Effect(word, word, where, mask, draw(rng, "walking", "drift_count"), shape)
    return Effect(word, word, where, mask, draw(rng, "walking", f"{word}_s"))


def _moved(rng: np.random.Generator, geometry: Geometry, word: str) -> tuple[Effect, np.ndarray]:
    """A map that is not the insole: the effect, and where the taxels truly lie (28, 12, 2)."""
    at = geometry.taxel_mm.copy()
    mask = np.zeros((28, 12), bool)
    if word == "swapped_triangles":
        # Two under which different things happen: neighbours would hardly differ.
        far = np.hypot(*(geometry.centre_mm[:, None] - geometry.centre_mm[None]).transpose(2, 0, 1)) > 45
        pairs = np.argwhere(np.triu(far))
        a, b = (int(x) for x in pairs[rng.integers(len(pairs))])
        at[[a, b]] = at[[b, a]]
        mask[np.ix_([a, b], PRESSURE_TAXELS)] = True
        ids = [[int(geometry.address[t]), int(geometry.slot[t])] for t in (a, b)]
        return Effect(word, word, {"scope": "triangle", "ids": ids}, mask), at
    turn = float(draw(rng, "walking", "map_rotation_deg")) * (1 if rng.random() < 0.5 else -1)
    far_mm, way = draw(rng, "walking", "map_shift_mm"), rng.uniform(0, 2 * np.pi)
    shift = far_mm * np.array([np.cos(way), np.sin(way)])
    middle = geometry.centre_mm.mean(0)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    at = (at - middle) @ np.array([[c, s], [-s, c]]) + middle + shift
    shape = {"x_mm": float(shift[0]), "y_mm": float(shift[1]), "rotation_deg": turn}
    return Effect(word, word, {"scope": "insole", "ids": []}, mask, 0.0, shape), at


def walking_case(seed: int, index: int, spec: Spec) -> Case:
    """Case `index` of the seed."""
    rng = np.random.default_rng([seed, 1, index])
    foot = ("left", "right")[int(rng.integers(2))]
    geometry = places.insole(foot, int(rng.choice([5, 8])))
    these, load = sensors(rng), walk(rng, geometry)
    at = geometry.taxel_mm
    # A common delay cannot be told from the offset of another clock.
    own_clock = "delay" not in spec.words and bool(rng.random() < 0.5)
    k: dict[str, float] = {}
    effects: list[Effect] = []
    if spec.kind == "mapping":
        effect, at = _moved(rng, geometry, spec.words[0])
        effects.append(effect)
    else:
        noise = draw(rng, "walking", "shoe_noise_n")
        for word in spec.words:
            for _ in range(_ATTEMPTS):
                effect = _effect(rng, geometry, load, word, spec.variant)
                alone = WalkChain(load, these, (effect,), at)
                k[word] = force_strength(alone, geometry, own_clock, noise)
                if k[word] >= WANTED_K or spec.variant:
                    break
            effects.append(effect)
    return Case(
        spec=spec,
        geometry=geometry,
        sensors=these,
        load=load,
        effects=tuple(effects),
        k=k,
        amplitude_fraction={},
        own_clock=own_clock,
        offset_s=draw(rng, "chamber", "own_clock_offset_s") if own_clock else 0.0,
        rate=1e-6 * draw(rng, "chamber", "own_clock_rate_ppm") if own_clock else 0.0,
        simulated=spec.kind == "mapping" or (spec.kind == "null" and bool(rng.random() < 0.3)),
        epoch_s=1_600_000_000 + int(rng.integers(150_000_000)),
        rng=rng,
        at_mm=at,
    )
