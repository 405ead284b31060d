"""Every fault on emulated boards of both generations is detected, masked and reported, and so is its end."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.simulation.foot import Stand, Walk
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.faults import HEALED, KINDS, Change, FaultWatch
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.reader import SkinReader

START_NS = 1_700_000_000_000_000_000
CONFIG = Config()
BOARDS = {board.address: board for board in CONFIG.insoles[0].boards}
LAYOUTS = [load_layout(insole) for insole in CONFIG.insoles]
LAYOUT = LAYOUTS[0]
HEEL = next(  # the triangle whose taxels bear the most in walking
    LAYOUT.triangles[row]
    for row in [int(Walk(LAYOUTS).pressure_pa("left", np.array([0.1])).mean(axis=(0, 2)).argmax())]
)
generations = pytest.mark.parametrize("generation", ["mtb3", "mtb4"])


class StepsOn:
    """Nobody stands on it for a second, then `load`."""

    def __init__(self, load: Walk | Stand, at_s: float = 1.0, off_s: float = 1e9) -> None:
        self._load, self._at_s, self._off_s = load, at_s, off_s

    def pressure_pa(self, foot: str, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        there = (t_s >= self._at_s) & (t_s < self._off_s)
        return self._load.pressure_pa(foot, t_s) * there[:, None, None]  # type: ignore[arg-type]


WALKS, STANDS = StepsOn(Walk(LAYOUTS, seed=3)), StepsOn(Stand(LAYOUTS))


@dataclass
class Watched:
    """The changes that a watch reported, and the taxels that it masked in every cycle."""

    cycles: Cycles
    t_s: NDArray[np.float64]
    changes: list[tuple[float, Change]]
    masked: NDArray[np.bool_]  # (n, n_triangles, 12)
    watch: FaultWatch

    def events(self) -> list[tuple[str, int, int | None, int | None]]:
        """Without the boards that are heard for the first time."""
        return [(c.event, c.board, c.triangle, c.taxel) for t_s, c in self.changes if t_s > 0.5]

    def when(self, event: str) -> float:
        return next(t_s for t_s, change in self.changes if change.event == event and t_s > 0.5)


def cycles_of(
    faults: list[InjectedFault], seconds: float, load: StepsOn, generation: str = "mtb4", period_ms: int = 20
) -> Cycles:
    config = replace(
        CONFIG,
        insoles=tuple(
            replace(insole, boards=tuple(replace(board, period_ms=period_ms) for board in insole.boards))
            for insole in CONFIG.insoles
        ),
    )
    layouts = LAYOUTS if any(fault.other for fault in faults) else LAYOUTS[:1]
    emulator = Emulator(config, layouts, load, seed=5, generation=generation, faults=faults, status_bits=False)  # type: ignore[arg-type]
    reader = SkinReader([LAYOUT], period_ns=20_000_000, slack_ns=5_000_000)
    (closed,) = reader.feed(emulator.frames(START_NS, seconds))
    (by_time,) = reader.advance(START_NS + round(seconds * 1e9))
    return Cycles.concatenate([*closed, *by_time], len(LAYOUT))


def watch(cycles: Cycles, period_ms: int = 20) -> Watched:
    watching = FaultWatch(LAYOUT, {a: replace(board, period_ms=period_ms) for a, board in BOARDS.items()})
    t_s = (cycles.t_mono_ns - START_NS) * 1e-9
    changes, masked = [], []
    for at in range(len(cycles)):
        watching.screen(cycles, at)
        changes += [(float(t_s[at]), change) for change in watching.update(cycles, at)]
        masked.append(watching.masked.copy())
    return Watched(cycles, t_s, changes, np.array(masked), watching)


def rows_of(board: int, triangle: int | None = None) -> NDArray[np.bool_]:
    return np.array([t.board == board and triangle in (None, t.triangle) for t in LAYOUT.triangles])


@generations
@pytest.mark.parametrize("load", [WALKS, STANDS], ids=["walking", "standing"])
@pytest.mark.parametrize("period_ms", [20, 50])
def test_healthy_boards_give_no_event(generation: str, load: StepsOn, period_ms: int) -> None:
    watched = watch(cycles_of([], 15, load, generation, period_ms), period_ms)
    events = [(change.event, change.board) for _, change in watched.changes]
    assert sorted(events) == [("board_streaming", address) for address in (5, 6, 7)], "each when its first tick comes"
    assert not watched.masked.any()
    assert watched.watch.faults == []


@generations
def test_loose_triangle(generation: str) -> None:
    fault = InjectedFault("loose", 3.0, 4.0, HEEL.board, HEEL.triangle)
    watched = watch(cycles_of([fault], 8, WALKS, generation))
    where = (HEEL.board, HEEL.triangle, None)
    assert watched.events() == [("triangle_loose", *where), ("triangle_loose_over", *where)]
    assert watched.when("triangle_loose") - 3.0 < 0.045
    assert watched.when("triangle_loose_over") - 4.0 < 3.1
    row = LAYOUT.rows[where[:2]]
    rails = ((watched.cycles.counts[:, row] == 0) | (watched.cycles.counts[:, row] == 255)).sum(axis=1) >= 10
    assert rails.any()
    assert watched.masked[rails, row].all(), "not in one cycle"
    assert not np.delete(watched.masked, row, axis=1).any()
    assert not watched.masked[-1].any()


@generations
def test_one_contact_in_twenty_is_masked_throughout(generation: str) -> None:
    fault = InjectedFault("loose", 3.0, 8.0, HEEL.board, HEEL.triangle, chance=0.1)
    watched = watch(cycles_of([fault], 9, WALKS, generation))
    assert watched.events() == [("triangle_loose", HEEL.board, HEEL.triangle, None)]


def test_a_triangle_without_noise_is_not_connected() -> None:
    """Open when its board was zeroed, so that it sends the no-load for ever."""
    cycles = cycles_of([], 6, WALKS)
    cycles.counts[:, 4] = 240
    watched = watch(cycles)
    triangle = LAYOUT.triangles[4]
    assert watched.events() == [("triangle_loose", triangle.board, triangle.triangle, None)]
    assert watched.watch.masked[4].all()


def test_a_full_load_is_not_loose() -> None:
    cycles = cycles_of([], 2, STANDS)
    cycles.counts[60:, 4][:, PRESSURE_TAXELS] = 0
    assert {event for event, *_ in watch(cycles).events()} == {"taxel_saturated"}


@generations
@pytest.mark.parametrize("kind", ["dead", "stuck"])
def test_dead_and_stuck_taxels(generation: str, kind: str) -> None:
    level_pa = 200e3 if kind == "stuck" else None
    fault = InjectedFault(kind, 3.0, 6.0, HEEL.board, HEEL.triangle, 3, level_pa=level_pa)  # type: ignore[arg-type]
    watched = watch(cycles_of([fault], 9, WALKS, generation))
    where = (HEEL.board, HEEL.triangle, 3)
    assert watched.events() == [(f"taxel_{kind}", *where), (f"taxel_{kind}_over", *where)]
    assert watched.when(f"taxel_{kind}") - 3.0 < 1.5, "a stride and a little"
    assert watched.when(f"taxel_{kind}_over") - 6.0 < 2.5
    row = LAYOUT.rows[where[:2]]
    assert watched.masked[:, row, 3].any()
    assert watched.masked.sum() == watched.masked[:, row, 3].sum()


def test_a_taxel_that_stands_out_is_stuck_also_in_standing() -> None:
    fault = InjectedFault("stuck", 3.0, None, HEEL.board, HEEL.triangle, 3, level_pa=1.4e6)
    assert watch(cycles_of([fault], 5, STANDS)).events() == [("taxel_stuck", HEEL.board, HEEL.triangle, 3)]


@generations
def test_saturated_taxel(generation: str) -> None:
    fault = InjectedFault("saturated", 3.0, 4.0, HEEL.board, HEEL.triangle, 3)
    watched = watch(cycles_of([fault], 8, WALKS, generation))
    where = (HEEL.board, HEEL.triangle, 3)
    assert watched.events() == [("taxel_saturated", *where), ("taxel_saturated_over", *where)]
    assert watched.when("taxel_saturated") - 3.0 < 0.15


@generations
@pytest.mark.parametrize("load", [StepsOn(Walk(LAYOUTS, seed=3), off_s=6.0), StepsOn(Stand(LAYOUTS), off_s=6.0)])
def test_board_zeroed_under_load_until_it_is_zeroed_without(generation: str, load: StepsOn) -> None:
    heel_strike_s = 3 * Walk(LAYOUTS).stride_s + 0.06  # both loads press on the heel then
    faults = [InjectedFault("rezero", heel_strike_s, None, HEEL.board), InjectedFault("rezero", 7.0, None, HEEL.board)]
    watched = watch(cycles_of(faults, 9, load, generation))
    of_boards = [event for event in watched.events() if event[0].startswith("board")]
    assert of_boards == [("board_rezeroed", HEEL.board, None, None), ("board_rezeroed_over", HEEL.board, None, None)]
    assert watched.when("board_rezeroed") - heel_strike_s < 1.5
    assert 0 < watched.when("board_rezeroed_over") - 7.0 < 1.0
    faulty = (watched.t_s > watched.when("board_rezeroed")) & (watched.t_s < 7.0)
    assert watched.masked[faulty][:, rows_of(HEEL.board)].all()
    assert not watched.masked[-1].any()


@pytest.mark.parametrize("board", [5, 7])
def test_a_drift_of_the_baseline_during_walking_is_no_rezero(board: int) -> None:
    cycles = cycles_of([], 14.0, WALKS)
    t_s = (cycles.t_mono_ns - START_NS) * 1e-9
    dither = np.random.default_rng(0).random(cycles.counts.shape)
    drifted = (cycles.counts + np.floor(0.3 * t_s[:, None, None] + dither)).clip(0, 255).astype(np.uint8)
    events = watch(replace(cycles, counts=np.where(rows_of(board)[:, None], drifted, cycles.counts))).events()
    assert [event for event in events if event[0].startswith("board")] == []


@generations
def test_zeroed_without_load_is_no_fault(generation: str) -> None:
    faults = [InjectedFault("rezero", 3.0, None, address) for address in (5, 6, 7)]
    watched = watch(cycles_of(faults, 12, StepsOn(Walk(LAYOUTS, seed=3), at_s=4.0), generation))
    assert not [event for event in watched.events() if event[0].startswith("board")]
    assert watched.watch.faults == []


def test_a_new_zero_by_a_person_ends_it() -> None:
    faults = [InjectedFault("rezero", 3.5, None, HEEL.board)]
    watched = watch(cycles_of(faults, 7, StepsOn(Stand(LAYOUTS), off_s=5.0)))
    assert watched.watch.masked.any()
    watched.watch.zeroed()
    assert not watched.watch.masked.any()


@generations
def test_silent_board_comes_back(generation: str) -> None:
    watched = watch(cycles_of([InjectedFault("silent", 3.0, 4.0, 6)], 7, WALKS, generation))
    assert watched.events() == [
        ("board_silent", 6, None, None), ("board_streaming", 6, None, None),
        ("board_reset", 6, None, None), ("board_reset_over", 6, None, None),
    ]  # fmt: skip
    assert watched.when("board_silent") - 3.0 < 0.2
    assert watched.when("board_reset") - 4.0 < 0.05
    silent = (watched.t_s >= watched.when("board_silent")) & (watched.t_s < watched.when("board_reset"))
    assert (watched.masked[silent] == rows_of(6)[:, None]).all(), "its event says that it is left out"
    assert not watched.masked[~silent].any(), "one that came back is believed"


@generations
def test_board_that_loses_power(generation: str) -> None:
    for comes_back in ("silent", "configured"):
        fault = InjectedFault("reset", 3.0, 3.5, 6, comes_back=comes_back)  # type: ignore[arg-type]
        kinds = [event for event, *_ in watch(cycles_of([fault], 5, WALKS, generation)).events()]
        assert kinds[0] == "board_silent"
        assert ("board_reset" in kinds) == (comes_back == "configured")


@generations
@pytest.mark.parametrize("period_ms", [20, 50])
def test_two_boards_on_one_address(generation: str, period_ms: int) -> None:
    fault = InjectedFault("address_clash", 3.0, 5.0, HEEL.board, other=9)
    watched = watch(cycles_of([fault], 8, WALKS, generation, period_ms), period_ms)
    where = (HEEL.board, None, None)
    assert watched.events() == [("board_address_clash", *where), ("board_address_clash_over", *where)]
    assert watched.when("board_address_clash") - 3.0 < 0.5
    clashing = (watched.t_s > watched.when("board_address_clash")) & (watched.t_s < 5.0)
    assert (watched.masked[clashing] == rows_of(HEEL.board)[:, None]).all()
    assert not watched.masked[-1].any()


def test_a_period_that_all_boards_do_not_keep_is_no_clash() -> None:
    watched = watch(cycles_of([], 3, WALKS, period_ms=20), period_ms=50)
    assert watched.events() == []


def test_every_board_never_heard_is_silent() -> None:
    cycles = cycles_of([InjectedFault("silent", 0.0, None, 6)], 2, WALKS)
    assert [(f.kind, f.board) for f in watch(cycles).watch.faults] == [("board_silent", 6)]


def test_faults_lists_reported_faults_that_have_not_ended() -> None:
    faults = [InjectedFault("silent", 3.0, 4.0, 6), InjectedFault("loose", 3.2, None, HEEL.board, HEEL.triangle)]
    watching = FaultWatch(LAYOUT, BOARDS)
    cycles = cycles_of(faults, 7, WALKS)
    ongoing: dict[tuple[object, ...], int] = {}
    for at in range(len(cycles)):
        watching.screen(cycles, at)
        for change in watching.update(cycles, at):
            key = (change.kind, change.board, change.triangle, change.taxel)
            if change.began:
                ongoing[key] = change.t_ns
            else:
                ongoing.pop(key, None)
        assert [(f.kind, f.board, f.triangle, f.taxel) for f in watching.faults] == [*ongoing]
        assert [f.since_ns for f in watching.faults] == [*ongoing.values()]


def test_fault_texts_name_the_part_and_the_lost_area() -> None:
    fault = InjectedFault("loose", 3.0, 4.0, HEEL.board, HEEL.triangle)
    began, over = [c.text for t_s, c in watch(cycles_of([fault], 8, WALKS)).changes if t_s > 0.5]
    assert f"board {HEEL.board} triangle {HEEL.triangle} came loose" in began
    assert "10 taxels are left out, 3.6 % of the area" in began
    assert over.startswith(f"board {HEEL.board} triangle {HEEL.triangle} is connected again, after 4.")
    silent, _, reset, _ = [
        c.text for t_s, c in watch(cycles_of([InjectedFault("silent", 3.0, 4.0, 6)], 7, WALKS)).changes[3:]
    ]
    assert "board 6 sends nothing: its 50 taxels are left out, 17.9 % of the area" in silent
    assert "its readings are used, nothing is left out" in reset
    assert set(HEALED) == set(KINDS)


FAULTY = cycles_of(
    [
        InjectedFault("loose", 1.4, 1.7, 5, 9),
        InjectedFault("silent", 1.2, 1.6, 6),
        InjectedFault("stuck", 1.2, None, 7, 2, 3, level_pa=4e5),
    ],
    3,
    STANDS,
)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32))
def test_status_words_and_late_flags_do_not_change_the_verdict(seed: int) -> None:
    rng = np.random.default_rng(seed)
    spoilt = replace(
        FAULTY,
        status=rng.integers(0, 1 << 16, FAULTY.status.shape).astype(np.uint16),
        late=rng.random(len(FAULTY)) < 0.5,
        missing=rng.random(FAULTY.missing.shape) < 0.5,
    )
    one, other = watch(FAULTY), watch(spoilt)
    assert one.changes == other.changes
    assert (one.masked == other.masked).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32))
def test_any_counts_at_all_are_survived(seed: int) -> None:
    """Whatever comes: masks and faults agree, and what is told is consistent."""
    rng = np.random.default_rng(seed)
    n = 60
    part = Cycles(*(getattr(FAULTY, name)[:n] for name in Cycles.__slots__))
    counts = rng.integers(0, 256, part.counts.shape).astype(np.uint8)
    counts[rng.random(counts.shape[:2]) < 0.3] = rng.choice([0, 240, 255])
    watched = watch(replace(part, counts=counts, repeated=rng.random(n) < 0.2))
    wrong = {(f.board, f.triangle) for f in watched.watch.faults if f.kind == "triangle_loose"}
    loose = {(t.board, t.triangle) for t, m in zip(LAYOUT.triangles, watched.watch.masked, strict=True) if m.all()}
    boards = {f.board for f in watched.watch.faults if f.kind in ("board_rezeroed", "board_address_clash")}
    assert loose == wrong | {(t.board, t.triangle) for t in LAYOUT.triangles if t.board in boards}


@pytest.mark.parametrize("seed", [7, 10])
def test_frames_of_a_walk_that_come_late_in_one_batch_show_no_rezero(seed: int) -> None:
    """By these two a board was taken for re-zeroed: its heel had risen while nothing came from any board."""
    frames = Emulator(CONFIG, LAYOUTS[:1], Walk(LAYOUTS[:1], seed=seed), seed=seed).frames(START_NS, 20)
    rng = np.random.default_rng(seed)
    received_ns, end_ns = frames.t_mono_ns.copy(), START_NS + 5_000_000_000
    for _ in range(20):
        begin_ns = end_ns + int(rng.uniform(0, 600e6))
        end_ns = begin_ns + int(rng.uniform(60e6, 250e6))
        held = (frames.t_mono_ns >= begin_ns) & (frames.t_mono_ns < end_ns)
        received_ns[held] = end_ns + np.arange(held.sum()) * 20_000
    received_ns = np.maximum.accumulate(received_ns)
    (closed,) = SkinReader([LAYOUT], period_ns=20_000_000, slack_ns=5_000_000).feed(
        replace(frames, t_ns=received_ns, t_mono_ns=received_ns)
    )
    watched = watch(Cycles.concatenate(closed, len(LAYOUT)))
    assert "board_rezeroed" not in {change.event for _, change in watched.changes}
