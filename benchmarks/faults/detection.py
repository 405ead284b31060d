"""Detection rate, delay and false alarms of the faults that are detected in the counts alone.

    python -m benchmarks.faults.detection [--cases 100] [--hours 4] [--seed 1000]

Emulated boards of both generations under a person who walks or stands, one random fault a case (`random_fault`: where,
when, how, for how long, from a seed of its own). A case counts from the moment its fault becomes observable, which is
worked out here from the true load as insole_daemon/skin/faults/taxels.py and rezero.py state it in words; one that
never becomes observable (a taxel that nobody treads on) is drawn anew, and counted. The watch never sees a status word.

Seeds from 1000 on are for scoring alone; thresholds were looked at on seeds from 500 000 on.

Takes hours: 1 600 cases and 4 simulated hours.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.faults import FaultKind, InjectedFault
from insole_daemon.simulation.foot import Stand, Walk
from insole_daemon.simulation.generation import GenerationName
from insole_daemon.simulation.random_faults import random_fault
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.faults import Change, FaultWatch
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.identifiers import ERROR_NOT_CONNECTED
from insole_daemon.skin.layout import Foot, Layout
from insole_daemon.skin.reader import SkinReader

KINDS: tuple[FaultKind, ...] = (
    "loose", "dead", "stuck", "saturated", "rezero", "silent", "reset", "address_clash",
)  # fmt: skip
GENERATIONS: tuple[GenerationName, ...] = ("mtb3", "mtb4")
ACCEPTED: dict[FaultKind, tuple[str, ...]] = {
    "loose": ("triangle_loose",),
    "dead": ("taxel_dead", "taxel_stuck"),  # one that stuck near its rest level is a dead one to who looks
    "stuck": ("taxel_dead", "taxel_stuck"),
    "saturated": ("taxel_saturated",),
    "rezero": ("board_rezeroed",),
    "silent": ("board_silent",),
    "reset": ("board_silent", "board_reset"),  # first it is silent, and some never come back
    "address_clash": ("board_address_clash",),
}
ALLOWED_S: dict[FaultKind, float] = dict.fromkeys(KINDS, 0.5) | {"rezero": 2.0}

SITS_S, HEALTHY_S, FAULTY_S = 1.5, 4.0, 6.0  # a case: nobody stands on it, healthy, and the time a fault falls in
START_NS = 1_700_000_000_000_000_000
COUNT_PA = 8000.0
STEP_S = 0.005

CONFIG = Config()
LAYOUTS = [load_layout(insole) for insole in CONFIG.insoles]


class Person:
    """Sits, stands and walks, one after another; a cadence and a weight of their own."""

    RAMP_S = 0.4  # from one to the next

    def __init__(self, layouts: Sequence[Layout], seed: int, seconds: float | None = None) -> None:
        """For `seconds` something else every 20 to 120 s, mostly walking; None: sits for SITS_S, then does one."""
        rng = np.random.default_rng([seed, 77])
        mass_kg, cadence = float(rng.uniform(50, 100)), float(rng.uniform(90, 130))
        self._loads = (Walk(layouts, mass_kg, cadence, seed=seed), Stand(layouts, mass_kg))
        self._begin_s, self._what = [-1.0], [-1]  # -1: sits
        t_s = SITS_S
        while True:
            self._begin_s.append(t_s)
            self._what.append(int(rng.choice((0, 1, -1), p=(0.6, 0.4, 0) if seconds is None else (0.8, 0.12, 0.08))))
            t_s += float(rng.uniform(20, 120))
            if seconds is None or t_s > seconds:
                break

    def pressure_pa(self, foot: Foot, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """See simulation.load.Load."""
        begin_s, what = np.array(self._begin_s), np.array(self._what)
        at = np.searchsorted(begin_s, t_s, side="right") - 1
        share = np.minimum((t_s - begin_s[at]) / self.RAMP_S, 1.0)
        result = np.zeros((len(t_s), len(LAYOUTS[0]), 12))
        for number, load in enumerate(self._loads):
            weight = (what[at] == number) * share + (what[np.maximum(at - 1, 0)] == number) * (1 - share)
            some = np.flatnonzero(weight)
            if len(some):
                result[some] += weight[some, None, None] * load.pressure_pa(foot, t_s[some])
        return result


@dataclass
class Case:
    """One occurrence of a fault and what came of it."""

    kind: FaultKind
    generation: GenerationName
    seed: int
    foot: int
    faults: list[InjectedFault]
    observable_s: list[float | None] = field(default_factory=list)  # of each, since power-up
    latency_s: float | None = None  # from then to the last one's being told; None: not found
    from_onset_s: float | None = None
    others: list[Change] = field(default_factory=list)  # what this fault does not explain
    out_of_range: bool = False  # it stuck where its board can only say 0: a saturated one to who looks


def watch_all(
    feet: Sequence[int],
    person: Person,
    generation: GenerationName,
    seed: int,
    seconds: float,
    faults: Sequence[InjectedFault] = (),
) -> tuple[list[list[tuple[float, Change]]], list[list[Cycles]]]:
    """Of each foot of `feet`: (seconds, change), and, where there are faults, the cycles they were found in."""
    on_the_bus = range(2) if any(fault.other for fault in faults) else feet
    emulator = Emulator(
        CONFIG, [LAYOUTS[foot] for foot in on_the_bus], person, seed=seed, generation=generation, faults=faults
    )
    reader = SkinReader([LAYOUTS[foot] for foot in feet], period_ns=20_000_000, slack_ns=5_000_000)
    watches = [FaultWatch(LAYOUTS[f], {board.address: board for board in CONFIG.insoles[f].boards}) for f in feet]
    changes: list[list[tuple[float, Change]]] = [[] for _ in feet]
    kept: list[list[Cycles]] = [[] for _ in feet]
    run = emulator.run(START_NS)
    while run.now_ns < START_NS + seconds * 1e9:
        closed_of_feet = reader.feed(run.advance(run.now_ns + 1_000_000_000))
        for of_foot, more in zip(closed_of_feet, reader.advance(run.now_ns - 20_000_000), strict=True):
            of_foot += more
        for foot, closed in enumerate(closed_of_feet):
            for cycles in closed:
                if faults:
                    kept[foot].append(cycles)
                for at in range(len(cycles)):
                    watches[foot].screen(cycles, at)
                    for change in watches[foot].update(cycles, at):
                        changes[foot].append(((int(cycles.t_mono_ns[at]) - START_NS) * 1e-9, change))
    return changes, kept


def draw(kind: FaultKind, generation: GenerationName, seed: int) -> Case:
    rng = np.random.default_rng([seed, KINDS.index(kind), GENERATIONS.index(generation)])
    faults = random_fault(kind, rng, LAYOUTS, HEALTHY_S, FAULTY_S)
    foot = next(f for f in range(2) if faults[0].board in LAYOUTS[f].identities[:, 0])
    return Case(kind, generation, seed, foot, faults)


def observable_s(case: Case, fault: InjectedFault, person: Person) -> float | None:
    """When a fault can be seen from the true load, since power-up; None: never. Loose contacts are looked up later."""
    end_s = fault.until_s if fault.until_s is not None else HEALTHY_S + FAULTY_S
    t_s = np.arange(fault.t_s, end_s, STEP_S)
    if case.kind in ("silent", "address_clash", "reset", "loose"):
        return fault.t_s
    layout = LAYOUTS[case.foot]
    load = person.pressure_pa(layout.foot, t_s) / COUNT_PA
    if case.kind == "rezero":
        own = layout.identities[:, 0] == fault.board
        moments = np.arange(fault.t_s, fault.t_s + 0.08, STEP_S)  # an MTB3 reads its baseline a little later
        bears = person.pressure_pa(layout.foot, moments)[:, own][..., PRESSURE_TAXELS].mean(axis=(1, 2)) / COUNT_PA
        return fault.t_s if bears.min() >= 2.0 else None
    assert fault.triangle is not None
    assert fault.taxel is not None
    row = layout.rows[fault.board, fault.triangle]
    if case.kind == "saturated":
        if fault.level_pa is None:
            return fault.t_s
        return _after(load[:, row, fault.taxel] * COUNT_PA >= fault.level_pa, t_s, 0.05)
    around = load.reshape(len(load), -1)[:, neighbours(case.foot, row, fault.taxel)]
    stuck_count = 0.0 if case.kind == "dead" else (fault.level_pa or 0.0) / COUNT_PA
    if abs(stuck_count) >= 5.0:
        idle = (around.max(axis=1) == 0) | (stuck_count >= 5 * around.mean(axis=1) + 5.0)
        return _after(idle, t_s, 0.2)
    # Nearer to its rest it is a dead one: once the others bear so much more that what it says is nothing.
    return _after(around.min(axis=1) >= 6.0 + 10 * max(stuck_count, 0.0), t_s, 0.2)


def neighbours(foot: int, row: int, taxel: int) -> NDArray[np.intp]:
    """The four pressure taxels nearest to one, as places among the 12 · n_triangles."""
    xy = LAYOUTS[foot].xy_m
    distance = np.hypot(*(xy - xy[row, taxel]).transpose(2, 0, 1))
    distance[:, ~PRESSURE_TAXELS] = np.inf
    distance[row, taxel] = np.inf
    return np.argsort(distance.ravel(), kind="stable")[:4]


def _after(visible: NDArray[np.bool_], t_s: NDArray[np.float64], enough_s: float) -> float | None:
    """When it has been there for `enough_s` in total."""
    at = int(np.searchsorted(np.cumsum(visible) * STEP_S, enough_s - STEP_S / 2))
    return float(t_s[at]) if at < len(t_s) else None


def play(case: Case) -> bool:
    """Emulate the case and fill in what was found; False if its fault was never observable."""
    person = Person(LAYOUTS, case.seed)
    case.observable_s = [observable_s(case, fault, person) for fault in case.faults]
    if None in case.observable_s:
        return False
    seconds = HEALTHY_S + FAULTY_S + (2.0 if case.kind == "rezero" else 0.6)
    (changes,), (kept,) = watch_all([case.foot], person, case.generation, case.seed, seconds, case.faults)
    if case.kind == "loose":
        case.observable_s = [_first_open_s(case, fault, kept) for fault in case.faults]
        case.faults = [f for f, seen in zip(case.faults, case.observable_s, strict=True) if seen is not None]
        case.observable_s = [seen for seen in case.observable_s if seen is not None]
        if not case.faults:
            return False
    if case.kind == "stuck":
        case.out_of_range = _sends_0(case, case.faults[0], kept)
    latencies: list[float | None] = []
    for fault, seen_s in zip(case.faults, case.observable_s, strict=True):
        assert seen_s is not None
        detected_s = [t_s for t_s, c in changes if c.began and t_s >= fault.t_s and _is_it(case, fault, c)]
        latencies.append(max(detected_s[0] - seen_s, 0.0) if detected_s else None)
    if None not in latencies:
        case.latency_s = max(each for each in latencies if each is not None)
        case.from_onset_s = max(
            each + seen - fault.t_s
            for each, seen, fault in zip(latencies, case.observable_s, case.faults, strict=True)
            if each is not None and seen is not None
        )
    case.others = [c for t_s, c in changes if t_s > 1.0 and not any(_follows(case, f, c, t_s) for f in case.faults)]
    return True


def _first_open_s(case: Case, fault: InjectedFault, kept: Sequence[Cycles]) -> float | None:
    """When the status of an open line came first: the truth, which the watch does not look at."""
    row = LAYOUTS[case.foot].rows[fault.board, fault.triangle or 0]
    for cycles in kept:
        shown = np.flatnonzero(cycles.status[:, row] & 0xF == ERROR_NOT_CONNECTED)
        if len(shown):
            return float(cycles.t_mono_ns[shown[0]] - START_NS) * 1e-9
    return None


def _sends_0(case: Case, fault: InjectedFault, kept: list[Cycles]) -> bool:
    """Whether a stuck taxel stands at the end of the range: 1500 kPa on a sensitive one are more than 8 bits."""
    row = LAYOUTS[case.foot].rows[fault.board, fault.triangle or 0]
    until_s = fault.until_s if fault.until_s is not None else np.inf
    cycles = Cycles.concatenate(kept, len(LAYOUTS[case.foot]))
    t_s = (cycles.t_mono_ns - START_NS) * 1e-9
    counts = cycles.counts[(t_s > fault.t_s + 0.1) & (t_s < until_s), row, fault.taxel]
    return bool(np.median(counts) == 0)


def _is_it(case: Case, fault: InjectedFault, change: Change) -> bool:
    where = (change.board, change.triangle, change.taxel)
    accepted = (*ACCEPTED[case.kind], "taxel_saturated") if case.out_of_range else ACCEPTED[case.kind]
    return change.kind in accepted and where == (fault.board, fault.triangle, fault.taxel)


def _follows(case: Case, fault: InjectedFault, change: Change, t_s: float) -> bool:
    """Whether a change is this fault, its end or a consequence of it."""
    if t_s < fault.t_s:
        return False
    if case.kind == "reset":
        return change.board == fault.board  # a new baseline, other settings
    if case.kind == "silent":
        return change.board == fault.board and change.kind in ("board_silent", "board_reset")
    if case.kind == "address_clash":  # the other one is silent under its own address
        return change.board in (fault.board, fault.other)
    return _is_it(case, fault, change)


def table_row(kind: FaultKind, generation: GenerationName, n: int, seed: int) -> list[Case]:
    """Print a line of the table; the cases behind it."""
    cases: list[Case] = []
    drawn = 0
    while len(cases) < n:
        case = draw(kind, generation, seed + drawn)
        drawn += 1
        if play(case):
            cases.append(case)
    latency = [case.latency_s for case in cases if case.latency_s is not None]
    onset = [case.from_onset_s for case in cases if case.from_onset_s is not None]
    allowed_s = ALLOWED_S[kind]
    p50, p99 = np.percentile(latency, [50, 99]) if latency else (np.nan, np.nan)
    others = Counter(change.kind for case in cases for change in case.others if change.began)
    print(
        f"{generation}  {kind:14} {sum(each <= allowed_s for each in latency):4}/{n} in {allowed_s:.1f} s   "
        f"{len(latency):4} found   p50 {p50 * 1e3:5.0f} ms   p99 {p99 * 1e3:5.0f} ms   "
        f"{sum(each <= allowed_s for each in onset):4} so soon after its onset   "
        f"never observable {drawn - n:3}   other events {dict(others)}",
        flush=True,
    )
    return cases


def false_events(hours: float, seed: int, generations: Sequence[str]) -> None:
    """Healthy boards under a person who mostly walks, both feet, a quarter of an hour a person."""
    for generation, share in (("mtb4", 0.75), ("mtb3", 0.25)):
        if generation not in generations:
            continue
        counted: Counter[str] = Counter()
        listed: list[str] = []
        lives = max(1, round(4 * hours * share))
        for life in range(lives):
            changes, _ = watch_all(
                (0, 1),
                Person(LAYOUTS, seed + life, 900.0),
                generation,
                seed + life,
                900.0,  # type: ignore[arg-type]
            )
            for foot, of_foot in enumerate(changes):
                for t_s, change in of_foot:
                    if t_s > 1.0 and change.began:
                        counted[change.kind] += 1
                        listed.append(f"  seed {seed + life} {LAYOUTS[foot].foot} {t_s:.2f} s: {change.text}")
        print(
            f"{generation}  {lives / 4:g} h healthy, both feet: {counted.total()} false events, "
            f"{counted.total() * 4 / lives:.2f} an hour {dict(counted)}",
            flush=True,
        )
        print("\n".join(listed[:20]))


def cost_us(seconds: float = 60.0) -> tuple[float, float, float]:
    """(mean, p50, p99) µs of CPU of an update in healthy walking, cycles one at a time."""
    _, (kept,) = watch_all([0], Person(LAYOUTS, 1), "mtb4", 1, seconds, [InjectedFault("silent", 1e6, None, 5)])
    cycles = Cycles.concatenate(kept, len(LAYOUTS[0]))
    watch = FaultWatch(LAYOUTS[0], {board.address: board for board in CONFIG.insoles[0].boards})
    took = np.empty(len(cycles))
    for at in range(len(cycles)):
        began = time.thread_time_ns()
        watch.screen(cycles, at)
        watch.update(cycles, at)
        took[at] = time.thread_time_ns() - began
    p50, p99 = np.percentile(took, [50, 99]) * 1e-3
    return float(took.mean()) * 1e-3, float(p50), float(p99)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=100, help="of each kind and generation")
    parser.add_argument("--hours", type=float, default=4.0, help="of healthy walking")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--kinds", nargs="*", default=KINDS)
    parser.add_argument("--generations", nargs="*", default=GENERATIONS)
    asked = parser.parse_args()
    cases = [
        case
        for generation in asked.generations
        for kind in KINDS
        if asked.cases and kind in asked.kinds
        for case in table_row(kind, generation, asked.cases, asked.seed)
    ]
    for case in cases:
        if case.latency_s is None or case.latency_s > ALLOWED_S[case.kind]:
            print(f"  missed: {case.generation} seed {case.seed} {case.faults} after {case.latency_s}")
        for change in case.others:
            if change.began:
                print(f"  other: {case.generation} seed {case.seed} {case.kind}: {change.text}")
    if asked.hours:
        false_events(asked.hours, asked.seed + 100_000, asked.generations)
    mean, p50, p99 = cost_us()
    print(f"an update of one foot: {mean:.0f} µs of CPU in the mean, p50 {p50:.0f} µs, p99 {p99:.0f} µs")


if __name__ == "__main__":
    main()
