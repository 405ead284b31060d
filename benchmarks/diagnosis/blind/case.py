"""Draws a case: insole, trial, concealed effects and faults, and the reference or simulation of the load."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .boards import Timing, draw_timing
from .calibration_file import fit_curves
from .chamber import chamber
from .effect import MEMORY, Effect, conceal, hysteresis_twin, positions, scopes_of
from .faults import FAULTS, Fault, draw_fault
from .geometry import Geometry, build_insole
from .imitators import IMITATORS
from .load_error import SimulatedTrial, draw_simulated_trial
from .plan import EQUIVALENT, Spec
from .ranges import draw
from .sensor import Sensors, draw_sensors
from .signal_path import Signal
from .strength import Bench, Clock, solve
from .trial import Trial
from .walk import ACTIVITIES, walk

MOST_K = 2000.0  # the law of a stronger effect has become numerically unstable
_ATTEMPTS = 4  # draws of a case, until the strength asked for is within the effect's range
_WITH_AMPLITUDE = ("hysteresis", "creep", "viscoelasticity")
_DISTINCT_K = 40.0  # x the floor: no other effect imitates an effect this strong
IMITATION_LIMIT = 0.5  # x the floor: a word whose best fit at the same place leaves less is right as well


class UnsolvedError(Exception):
    """The strength of an effect is not finite, or greater than `MOST_K`."""


@dataclass(frozen=True)
class Case:
    """A case before it is written; UnsolvedError if a strength is not finite or above `MOST_K`."""

    spec: Spec
    geometry: Geometry
    sensors: Sensors
    trial: Trial
    effects: tuple[Effect, ...]
    faults: tuple[Fault, ...]
    k: dict[str, float]  # strength of each effect alone, in multiples of the floor
    amplitude_fraction: dict[str, float]
    accept: dict[str, list[str]]  # words that are right for each effect and fault
    clock: Clock
    simulation: SimulatedTrial | None  # None where there is a reference
    timing: Timing
    rows: bool  # handed out as rows of a host instead of frames
    memory_in_calibration: bool
    reference_noise: np.ndarray  # (3,) N, N m, N m; in a chamber (1,) Pa
    epoch_s: int
    rng: np.random.Generator  # for what is drawn while the case is written

    def __post_init__(self) -> None:
        for word, k in self.k.items():
            if not np.isfinite(k) or k > MOST_K:
                raise UnsolvedError(f"{self.spec}: a {word} of {k:g} x the floor; its law has broken under this load")

    @cached_property
    def taxels_mm(self) -> np.ndarray:
        """True positions of the taxels, (28, 12, 2)."""
        return positions(self.geometry, self.effects)

    @cached_property
    def signal(self) -> Signal:
        """Readings of all 336 taxels with the concealed effects."""
        return Signal(self.trial, self.taxels_mm, self.sensors, self.effects, np.arange(336))

    @cached_property
    def clean(self) -> Signal:
        """Readings of all 336 taxels at their true positions, without any other concealed effect."""
        return Signal(self.trial, self.taxels_mm, self.sensors, (), np.arange(336))

    @cached_property
    def curves(self) -> tuple[np.ndarray, np.ndarray]:
        """Baselines and coefficients of the calibration that is handed out."""
        rng = np.random.default_rng(self.epoch_s)
        memory = self.effects if self.memory_in_calibration else ()
        return fit_curves(rng, self.geometry, self.sensors, memory, 1.02 * self.trial.span_pa)


def _draw_scope(rng: np.random.Generator, word: str, spec: Spec, own_clock: bool) -> str:
    """Draw the scope of an effect among those that the case allows."""
    options = scopes_of(word)
    if spec.kind == "undecidable":
        return options[0]
    if word == "delay" and own_clock:
        return "board"  # a delay of all boards and an offset of the clock change the readings alike
    if word == "unknown":
        return ("board", "triangle")[int(rng.integers(2))] if spec.local else "insole"
    if word == "viscoelasticity" and spec.kind == "triple":
        return options[0]
    narrow = [s for s in options if s != "insole"]
    if spec.local and narrow:
        return narrow[int(rng.integers(len(narrow)))]
    # Half of the effects have the widest scope, because most physics acts on the whole insole.
    return options[0] if rng.random() < 0.5 else options[int(rng.integers(len(options)))]


def _draw_clock(rng: np.random.Generator, spec: Spec) -> tuple[Clock, Effect | None]:
    """Draw the reference's clock, and the concealed effect `clock` if the case has one, not solved yet."""
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
            # The offset is positive, so that readings come early: late readings would be a delay.
            return Clock("can"), Effect("clock", kind, everywhere, nowhere, 0.0, {"kind": kind, "solved": "offset_s"})
        declared = "own" if kind == "own" else "can"
        return Clock(declared), Effect("clock", kind, everywhere, nowhere, 0.0, {"kind": kind, "sign": sign})
    if spec.against == "simulation" or spec.kind == "undecidable" or spec.variant in EQUIVALENT:
        return Clock("can"), None
    # Half of the instruments have a clock of their own. Beside a lag or delay fewer have, because an offset hides it.
    has_own_clock = rng.random() < (0.3 if {"lag", "delay"} & set(spec.words) else 0.5)
    if has_own_clock:
        offset, ppm = draw(rng, "clocks", "own_offset_s"), draw(rng, "clocks", "own_rate_ppm")
        return Clock("own", offset, 1e-6 * ppm), None
    return Clock("can", 1e-3 * rng.normal(0, 0.3), 1e-6 * rng.normal(0, 8)), None


def _draw_undecidable(rng: np.random.Generator, spec: Spec, geometry: Geometry, trial: Trial) -> Effect:
    """Draw one of the effects that this trial cannot tell apart."""
    word = EQUIVALENT[spec.variant][int(rng.integers(len(EQUIVALENT[spec.variant])))]
    if spec.variant == "warm":
        effect = conceal(rng, geometry, trial, word, "insole")
        effect.shape.update({"gain_per_k": 0.0, "start_s": 0.0, "settle_s": 0.4 * trial.main_s})
        return effect
    if spec.variant == "ramps" and word == "viscoelasticity":
        word = "creep"  # only hysteresis and creep are made to look exactly alike
    if word == "hysteresis":
        return hysteresis_twin(conceal(rng, geometry, trial, "creep", "insole"), trial)[0]
    return conceal(rng, geometry, trial, word, "insole")


def _accepted_words(bench: Bench, effect: Effect) -> list[str]:
    """Words that are right for `effect`: its own, those that imitate it, and `noise_burst` for noise that grows."""
    accepted = [effect.word]
    if bench.k(effect) < _DISTINCT_K:
        accepted += [word for word in IMITATORS.get(effect.word, ()) if bench.imitated(effect, word) < IMITATION_LIMIT]
    if effect.law == "load_noise":
        accepted.append("noise_burst")
    return accepted


def _draw_trial(rng: np.random.Generator, spec: Spec, geometry: Geometry) -> tuple[Trial, np.ndarray]:
    """Draw the trial, and the noise of its reference: (1,) Pa in a chamber, (3,) N, N m, N m for a shoe."""
    if spec.recording == "chamber":
        protocol = spec.variant if spec.variant in ("sine", "ramps") else "full"
        trial = chamber(rng, protocol, spec.variant == "warm")
        return trial, np.array([draw(rng, "chamber", "gauge_noise_pa")])
    activity_shares = [0.55, 0.25, 0.1, 0.1] if spec.kind == "null" else [0.6, 0.3, 0.1, 0]
    trial = walk(rng, geometry, ACTIVITIES[int(rng.choice(4, p=activity_shares))])
    return trial, np.array([draw(rng, "walking", f"shoe_noise_{unit}") for unit in ("n", "nm", "nm")])


def _draw_concealed(
    rng: np.random.Generator, spec: Spec, bench: Bench, concealed_clock: Effect | None
) -> tuple[list[Effect], list[Fault]]:
    """Draw the effects, without amplitudes, and the faults."""
    geometry, trial = bench.geometry, bench.trial
    effects: list[Effect] = []
    faults: list[Fault] = []
    if spec.kind == "undecidable":
        effects.append(_draw_undecidable(rng, spec, geometry, trial))
    for word in spec.words:
        if word in FAULTS:
            faults.append(draw_fault(rng, geometry, trial, word))
        elif word == "clock":
            assert concealed_clock is not None
            effects.append(concealed_clock)
        else:
            scope = _draw_scope(rng, word, spec, bench.own_clock)
            effects.append(conceal(rng, geometry, trial, word, scope, spec.law))
    return effects, faults


@dataclass
class _SolvedEffects:
    """Effects with amplitudes, and what is known of each by its word."""

    clock: Clock  # the reference's, with the concealed effect `clock` in it
    effects: list[Effect] = field(default_factory=list)
    k: dict[str, float] = field(default_factory=dict)
    amplitude_fraction: dict[str, float] = field(default_factory=dict)
    accept: dict[str, list[str]] = field(default_factory=dict)


def _solve_effects(
    rng: np.random.Generator, spec: Spec, bench: Bench, effects: list[Effect], clock: Clock
) -> _SolvedEffects:
    """Give each effect the amplitude at which it is `spec.k` x the floor, or the nearest within its range."""
    solved = _SolvedEffects(clock)
    for effect in effects:
        if effect.law == "rows":
            solved.k[effect.word] = min(bench.k(effect, clock), MOST_K)
            solved.effects.append(effect)
            solved.accept[effect.word] = ["clock"]
            continue
        strong_effect, solved.k[effect.word] = solve(bench, effect, spec.k, clock.declared)
        if effect.word == "clock":
            solved.clock = _with_clock(rng, clock, strong_effect)
        if effect.word in _WITH_AMPLITUDE:
            solved.amplitude_fraction[effect.word] = bench.amplitude_fraction(strong_effect)
        solved.accept[effect.word] = _accepted_words(bench, strong_effect)
        solved.effects.append(strong_effect)
    return solved


def _accepted_words_of_fault(fault: Fault) -> list[str]:
    """Words that are right for a fault: its own, and `drift` for a reference that drifts."""
    is_drift = fault.word == "reference_fault" and fault.shape["kind"] == "drift"
    return [fault.word, "drift"] if is_drift else [fault.word]


def _draw_case_timing(rng: np.random.Generator, spec: Spec, clock: Clock) -> Timing:
    """Draw the timing of the boards; equal periods where the reference has rows without times."""
    steady = bool(set(spec.words) & {"lag", "delay", "clock", "frame_loss"}) or spec.kind == "undecidable"
    timing = draw_timing(rng, steady)
    if clock.declared == "none":
        period = int(rng.choice([10, 20, 50]))
        return Timing((period, period, period), 0.0, timing.b_first)
    return timing


def _draw_once(rng: np.random.Generator, spec: Spec) -> Case:
    """Draw a case of `spec`, whatever strengths its effects reach."""
    geometry = build_insole(("left", "right")[int(rng.integers(2))], int(rng.choice([5, 8])))
    sensors = draw_sensors(rng)
    trial, reference_noise = _draw_trial(rng, spec, geometry)
    clock, concealed_clock = _draw_clock(rng, spec)
    simulation = draw_simulated_trial(rng, trial) if spec.against == "simulation" else None
    bench = Bench(
        trial=trial,
        geometry=geometry,
        sensors=sensors,
        per_taxel=spec.recording == "chamber" or simulation is not None,
        own_clock=clock.declared == "own" or simulation is not None,
        reference_noise=reference_noise,
        load_error=simulation.trial if simulation else None,
    )
    effects, faults = _draw_concealed(rng, spec, bench, concealed_clock)
    solved = _solve_effects(rng, spec, bench, effects, clock)
    timing = _draw_case_timing(rng, spec, solved.clock)
    words = set(spec.words)
    rows = not (words & {"frame_loss", "open_triangle", "delay", "clock"}) and bool(rng.random() < 0.08)
    return Case(
        spec=spec,
        geometry=geometry,
        sensors=sensors,
        trial=trial,
        effects=tuple(solved.effects),
        faults=tuple(faults),
        k=solved.k,
        amplitude_fraction=solved.amplitude_fraction,
        accept={fault.word: _accepted_words_of_fault(fault) for fault in faults} | solved.accept,
        clock=solved.clock,
        simulation=simulation,
        timing=timing,
        rows=rows and spec.kind != "undecidable",
        memory_in_calibration=bool(words & set(MEMORY)) and bool(rng.random() < 0.5),
        reference_noise=reference_noise,
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
    """Draw case `index` of the seed, again if the trial cannot show the effect as strongly as asked."""
    rng = np.random.default_rng([seed, 1, index])
    cases: list[Case] = []
    refusal: UnsolvedError | None = None
    for _ in range(_ATTEMPTS):
        try:
            cases.append(_draw_once(rng, spec))
        except UnsolvedError as error:
            refusal = error
            continue
        if min(cases[-1].k.values(), default=np.inf) >= 0.95 * spec.k:
            break
    if not cases and refusal is not None:
        raise refusal
    return max(cases, key=lambda case: min(case.k.values(), default=np.inf))
