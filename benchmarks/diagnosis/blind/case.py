"""One case, nothing written yet: insole, trial, what is concealed, and how the load is known."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from . import geometry as places
from .boards import Timing, timing
from .calibration_file import believed_curves
from .chamber import chamber
from .effect import MEMORY, Effect, conceal, hysteresis_twin, positions, scopes
from .faults import FAULTS, Fault, fault
from .geometry import Geometry
from .load_error import Believed, believed
from .plan import EQUIVALENT, Spec
from .ranges import draw
from .sensor import Sensors, sensors
from .signal_path import Signal
from .strength import IMITATORS, Bench, Clock, solve
from .trial import Trial
from .walk import ACTIVITIES, walk

MOST_K = 2000.0  # beyond it a law has broken
_ATTEMPTS = 4  # to draw a trial in which the strength asked for is within the effect's range
_WITH_AMPLITUDE = ("hysteresis", "creep", "viscoelasticity")
_SURELY_DISTINCT = 40.0  # x the floor: nothing imitates that
IMITATED = 0.5  # x the floor: a word that leaves less than this at the same place is right as well


class UnsolvedError(Exception):
    """The strength of an effect is none that was asked for."""


@dataclass(frozen=True)
class Case:
    """Raises UnsolvedError where the strength of an effect is not finite, or absurd."""

    spec: Spec
    geometry: Geometry
    sensors: Sensors
    trial: Trial
    effects: tuple[Effect, ...]
    faults: tuple[Fault, ...]
    k: dict[str, float]  # of each effect, alone
    amplitude_fraction: dict[str, float]
    accept: dict[str, list[str]]  # words that are right beside the concealed one
    clock: Clock
    simulation: Believed | None  # what the load is known from where there is no reference
    timing: Timing
    rows: bool  # handed out as rows of a host instead of frames
    memory_in_calibration: bool
    reference_noise: np.ndarray  # (3,) N, N m, N m; in a chamber (1,) Pa
    epoch_s: int
    rng: np.random.Generator  # for what is drawn when it is written

    def __post_init__(self) -> None:
        for word, k in self.k.items():
            if not np.isfinite(k) or k > MOST_K:
                raise UnsolvedError(f"{self.spec}: a {word} of {k:g} x the floor; its law has broken under this load")

    @cached_property
    def at_mm(self) -> np.ndarray:
        return positions(self.geometry, self.effects)

    @cached_property
    def signal(self) -> Signal:
        return Signal(self.trial, self.at_mm, self.sensors, self.effects, np.arange(336))

    @cached_property
    def clean(self) -> Signal:
        """With nothing concealed but where the taxels lie."""
        return Signal(self.trial, self.at_mm, self.sensors, (), np.arange(336))

    @cached_property
    def curves(self) -> tuple[np.ndarray, np.ndarray]:
        """Baselines and coefficients of the calibration that is handed out."""
        rng = np.random.default_rng(self.epoch_s)
        had = self.effects if self.memory_in_calibration else ()
        return believed_curves(rng, self.geometry, self.sensors, had, 1.02 * self.trial.span_pa)


def _scope(rng: np.random.Generator, word: str, spec: Spec, own_clock: bool) -> str:
    options = scopes(word)
    if spec.kind == "undecidable":
        return options[0]
    if word == "delay" and own_clock:
        return "board"  # a common one cannot be told from the offset
    if word == "unknown":
        return ("board", "triangle")[int(rng.integers(2))] if spec.local else "insole"
    if word == "viscoelasticity" and spec.kind == "triple":
        return options[0]
    local = [s for s in options if s != "insole"]
    if spec.local and local:
        return local[int(rng.integers(len(local)))]
    # Half of what can be anywhere is everywhere: that is what physics mostly does.
    return options[0] if rng.random() < 0.5 else options[int(rng.integers(len(options)))]


def _clock(rng: np.random.Generator, spec: Spec) -> tuple[Clock, Effect | None]:
    """The reference's clock, and the `clock` that is concealed in it, its amplitude still open where it is solved."""
    everywhere = {"scope": "insole", "ids": []}
    nowhere = np.zeros((28, 12), bool)
    if "clock" in spec.words:
        sign = 1.0 if rng.random() < 0.5 else -1.0
        kind = ("own", "can_rate", "can_offset", "rows")[int(rng.integers(4))]
        if kind == "rows":
            offset = float(rng.choice([-1, 1]) * rng.uniform(0.3, 3.0))
            rate = sign * draw(rng, "effects", "clock", "rows_rate")
            shape = {"kind": kind, "offset_s": offset, "rate": rate}
            return Clock("none", offset, rate), Effect("clock", kind, everywhere, nowhere, 1.0, shape)
        if kind == "can_offset":
            # Readings that come late would be a delay.
            return Clock("can"), Effect("clock", kind, everywhere, nowhere, 0.0, {"kind": kind, "solved": "offset_s"})
        declared = "own" if kind == "own" else "can"
        return Clock(declared), Effect("clock", kind, everywhere, nowhere, 0.0, {"kind": kind, "sign": sign})
    if spec.against == "simulation" or spec.kind == "undecidable" or spec.variant in EQUIVALENT:
        return Clock("can"), None
    # Half of the instruments have a clock of their own; where all boards are late, few, or it could not be told.
    own = rng.random() < (0.3 if {"lag", "delay"} & set(spec.words) else 0.5)
    if own:
        offset, ppm = draw(rng, "clocks", "own_offset_s"), draw(rng, "clocks", "own_rate_ppm")
        return Clock("own", offset, 1e-6 * ppm), None
    return Clock("can", 1e-3 * rng.normal(0, 0.3), 1e-6 * rng.normal(0, 8)), None


def _undecidable(rng: np.random.Generator, spec: Spec, geometry: Geometry, trial: Trial) -> Effect:
    word = EQUIVALENT[spec.variant][int(rng.integers(len(EQUIVALENT[spec.variant])))]
    if spec.variant == "warm":
        effect = conceal(rng, geometry, trial, word, "insole")
        effect.shape.update({"gain_per_k": 0.0, "start_s": 0.0, "settle_s": 0.4 * trial.main_s})
        return effect
    if spec.variant == "ramps" and word == "viscoelasticity":
        word = "creep"  # the other two are made to look alike exactly
    if word == "hysteresis":
        return hysteresis_twin(conceal(rng, geometry, trial, "creep", "insole"), trial)[0]
    return conceal(rng, geometry, trial, word, "insole")


def _accept(bench: Bench, effect: Effect) -> list[str]:
    """Words that are as right as the concealed one, by definition or by a fit that leaves next to nothing."""
    right = [effect.word]
    if bench.k(effect) < _SURELY_DISTINCT:
        right += [w for w in IMITATORS.get(effect.word, ()) if bench.imitated(effect, w) < IMITATED]
    if effect.law == "load_noise":
        right.append("noise_burst")
    return right


def _draw_once(rng: np.random.Generator, spec: Spec) -> Case:
    geometry = places.insole(("left", "right")[int(rng.integers(2))], int(rng.choice([5, 8])))
    these = sensors(rng)
    if spec.recording == "chamber":
        protocol = spec.variant if spec.variant in ("sine", "ramps") else "full"
        trial = chamber(rng, protocol, spec.variant == "warm")
        noise = np.array([draw(rng, "chamber", "gauge_noise_pa")])
    else:
        activity = ACTIVITIES[
            int(rng.choice(4, p=[0.55, 0.25, 0.1, 0.1] if spec.kind == "null" else [0.6, 0.3, 0.1, 0]))
        ]
        trial = walk(rng, geometry, activity)
        noise = np.array([draw(rng, "walking", f"shoe_noise_{unit}") for unit in ("n", "nm", "nm")])
    clock, concealed_clock = _clock(rng, spec)
    simulation = believed(rng, trial) if spec.against == "simulation" else None
    own = clock.declared == "own" or simulation is not None
    bench = Bench(
        trial, geometry, these, spec.recording == "chamber" or simulation is not None, own,
        noise, simulation.trial if simulation else None,
    )  # fmt: skip
    open_: list[Effect] = []
    faults: list[Fault] = []
    if spec.kind == "undecidable":
        open_.append(_undecidable(rng, spec, geometry, trial))
    for word in spec.words:
        if word in FAULTS:
            faults.append(fault(rng, geometry, trial, word))
        elif word == "clock":
            assert concealed_clock is not None
            open_.append(concealed_clock)
        else:
            open_.append(conceal(rng, geometry, trial, word, _scope(rng, word, spec, own), spec.law))
    solved: list[Effect] = []
    k: dict[str, float] = {}
    fraction: dict[str, float] = {}
    accept = {f.word: [f.word] for f in faults}
    for f in faults:
        if f.word == "reference_fault" and f.shape["kind"] == "drift":
            accept[f.word].append("drift")
    for effect in open_:
        if effect.law == "rows":
            k[effect.word] = min(bench.k(effect, clock), MOST_K)
            solved.append(effect)
            accept[effect.word] = ["clock"]
            continue
        found, k[effect.word] = solve(bench, effect, spec.k, clock.declared)
        if found.word == "clock":
            clock = _with_clock(rng, clock, found)
        if found.word in _WITH_AMPLITUDE:
            fraction[found.word] = bench.amplitude_fraction(found)
        accept[found.word] = _accept(bench, found)
        solved.append(found)
    words = set(spec.words)
    steady = bool(words & {"lag", "delay", "clock", "frame_loss"}) or spec.kind == "undecidable"
    timing_ = timing(rng, steady)
    if clock.declared == "none":
        period = int(rng.choice([10, 20, 50]))
        timing_ = Timing((period, period, period), 0.0, timing_.b_first)
    rows = not (words & {"frame_loss", "open_triangle", "delay", "clock"}) and bool(rng.random() < 0.08)
    return Case(
        spec=spec,
        geometry=geometry,
        sensors=these,
        trial=trial,
        effects=tuple(solved),
        faults=tuple(faults),
        k=k,
        amplitude_fraction=fraction,
        accept=accept,
        clock=clock,
        simulation=simulation,
        timing=timing_,
        rows=rows and spec.kind != "undecidable",
        memory_in_calibration=bool(words & set(MEMORY)) and bool(rng.random() < 0.5),
        reference_noise=noise,
        epoch_s=1_600_000_000 + int(rng.integers(150_000_000)),
        rng=rng,
    )


def _with_clock(rng: np.random.Generator, clock: Clock, effect: Effect) -> Clock:
    """The clock with the concealed offset or rate in it."""
    if effect.law == "can_offset":
        return Clock("can", effect.amplitude, 1e-6 * rng.normal(0, 8))
    offset = draw(rng, "clocks", "own_offset_s") if clock.declared == "own" else 1e-3 * rng.normal(0, 0.3)
    return Clock(clock.declared, offset, 1e-6 * effect.signed)


def draw_case(seed: int, index: int, spec: Spec) -> Case:
    """Case `index` of the seed. Drawn again where the trial cannot show the effect as strongly as asked."""
    rng = np.random.default_rng([seed, 1, index])
    made: list[Case] = []
    refused: UnsolvedError | None = None
    for _ in range(_ATTEMPTS):
        try:
            made.append(_draw_once(rng, spec))
        except UnsolvedError as problem:
            refused = problem
            continue
        if min(made[-1].k.values(), default=np.inf) >= 0.95 * spec.k:
            break
    if not made and refused is not None:
        raise refused
    return max(made, key=lambda case: min(case.k.values(), default=np.inf))


def _settled(case: Case, shape: dict[str, Any]) -> float:
    """How much of a drift has come when what the tool is given ends."""
    if "settle_s" not in shape:
        return 1.0
    return 1 - float(np.exp(-(case.trial.main_s - shape["start_s"]) / shape["settle_s"]))


def parameters(case: Case, effect: Effect) -> dict[str, list[float]]:
    """What is scored, under the names of formats.md; only where this generator's law has the same parameter."""
    s, amplitude, signed = effect.shape, effect.amplitude, effect.signed
    if effect.word == "rezero":
        when = amplitude * case.trial.main_s
        columns = np.flatnonzero(effect.place.ravel())
        pair = Signal(case.trial, case.at_mm, case.sensors, case.effects, columns).mean(np.array([when - 1e-6, when]))
        return {"t_s": [when], "shift_count": [float((pair[1] - pair[0]).mean())]}
    if effect.word == "clock":
        if effect.law == "rows":
            return {"offset_s": [s["offset_s"]], "rate": [s["rate"]]}
        return {"offset_s": [amplitude]} if effect.law == "can_offset" else {"rate": [1e-6 * signed]}
    if effect.word == "map_transform":
        x, y = amplitude * np.cos(s["way"]), amplitude * np.sin(s["way"])
        return {"x_mm": [float(x)], "y_mm": [float(y)], "rotation_deg": [s["rotation_deg"]]}
    found: dict[str, float] = {
        "snap": {"up_pa": s.get("up_pa"), "down_pa": s.get("down_pa"), "step_pa": amplitude * s.get("span_pa", 0)},
        "viscoelasticity": {"a": amplitude, "tau_s": s.get("tau_s")},
        "lag": {"tau_s": amplitude},
        "delay": {"delay_s": amplitude},
        "temperature": {"count_per_k": signed},
        "drift": {"shift_count": signed * _settled(case, s)},
        "stiffening": {"knee_pa": s.get("knee_pa")},
        "gain": {"gain": 1 + signed},
        "baseline": {"shift_count": signed},
        "preload": {"p0_pa": amplitude},
        "crosstalk": {"k": amplitude},
        "bit_shift": {"shift": case.sensors.shift + s.get("step", 0)},
    }.get(effect.word, {})
    return {name: [float(value)] for name, value in found.items() if value is not None}
