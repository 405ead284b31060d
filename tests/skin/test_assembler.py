"""The assembler against a reader that takes one frame at a time, on streams as boards really send them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insole_daemon.skin import assembler as module
from insole_daemon.skin.assembler import PATIENCE, TWICE_NS, CycleAssembler
from insole_daemon.skin.cycles import Cycles

from ..implementations import numpy_and_compiled

MS = 1_000_000
PERIOD, SLACK = 20 * MS, 5 * MS
START = 1_000 * MS

implementation = numpy_and_compiled(module)


@dataclass
class OneAtATime:
    """The rules of the module's docstring, a frame at a time, with nothing shared with it."""

    boards: list[int]  # of each triangle
    out: list[dict] = field(default_factory=list)
    due: int | None = None

    def __post_init__(self) -> None:
        self.n_triangles = len(self.boards)
        n = 2 * self.n_triangles
        self.half = [None] * n  # (payload, t_ns, t_mono_ns)
        self.newest_of = {}  # slot, by board
        self.seen, self.expected, self.misses, self.back = set(), set(range(n)), [0] * n, set()
        self.arrivals = [0] * self.n_triangles
        self.superseded, self.skipped, self.newest, self.fresh = 0, 0, 0, False
        self.changes, self.missed = [0] * n, [0] * n

    def frame(self, slot: int, payload: bytes, t_ns: int, t_mono_ns: int) -> None:
        if self.due is None:
            self.due = t_mono_ns + PERIOD + SLACK
        self.until(t_mono_ns)
        before, board = self.half[slot], self.boards[slot // 2]
        twice = before is not None and t_mono_ns - before[2] < TWICE_NS and self.newest_of[board] == slot
        if before is not None and not twice and t_mono_ns - before[2] <= PERIOD + SLACK:
            self.misses[slot] = 0
            self.back.add(slot)
        self.changes[slot] += (before[0] if before else bytes(8)) != payload
        self.superseded += twice or slot in self.seen
        self.arrivals[slot // 2] += 1
        self.half[slot] = (payload, t_ns, t_mono_ns)
        self.newest_of[board] = slot
        if not twice:
            self.seen.add(slot)
            self.fresh = True
        self.newest = t_ns
        if self.expected and self.expected <= self.seen:
            self.close(t_mono_ns, late=False)

    def until(self, t_mono_ns: int) -> None:
        while self.due is not None and t_mono_ns > self.due:
            if t_mono_ns - self.due > module.GAP_NS and not self.fresh:
                periods = (t_mono_ns - self.due) // PERIOD
                self.skipped += periods
                self.due += periods * PERIOD
            self.close_by_time()

    def close_by_time(self) -> None:
        absent = self.expected - self.seen
        for slot in absent:
            self.misses[slot] += 1
            self.missed[slot] += 1
        late, due = bool(self.expected), self.due
        self.close(due, late)
        self.expected -= {slot for slot in self.expected if self.misses[slot] >= PATIENCE}
        self.due = due + (PERIOD + SLACK if self.expected else PERIOD)

    def close(self, t: int, late: bool) -> None:
        counts, ages, stamps, status = [], [], [], []
        for i in range(self.n_triangles):
            a, b = self.half[2 * i], self.half[2 * i + 1]
            pa, pb = (a[0] if a else bytes(8)), (b[0] if b else bytes(8))
            counts.append([*pa[1:8], *pb[1:6]])
            status.append(pb[6] << 8 | pb[7])
            ages.append(t - min(a[2], b[2]) if a and b else -1)
            stamps.append((a if a[2] <= b[2] else b)[1] if a and b else 0)
        missing = [bool({2 * i, 2 * i + 1} & (self.expected - self.seen)) for i in range(self.n_triangles)]
        self.out.append(
            {
                "t_mono_ns": t, "t_ns": self.newest, "counts": counts, "status": status, "age_ns": ages,
                "triangle_t_ns": stamps, "arrivals": list(self.arrivals),
                "missing": missing, "late": late, "repeated": not self.fresh,
            }
        )  # fmt: skip
        self.expected |= self.back
        self.back, self.seen, self.fresh = set(), set(), False
        self.due = t + (PERIOD + SLACK if self.expected else PERIOD)


def stream(rng: np.random.Generator, n_triangles: int, seconds: float, faults: float) -> tuple:
    """Frames of boards of four triangles, some at 50 ms, with losses, doubles, silences and shuffled orders."""
    rows = []
    for first in range(0, n_triangles, 4):
        slots = np.arange(2 * first, min(2 * n_triangles, 2 * first + 8))
        period = 50 * MS if faults and rng.random() < 0.2 else 20 * MS
        phase = int(rng.integers(0, period))
        silence = sorted(rng.integers(0, int(seconds * 1e9), 2)) if rng.random() < faults else (0, 0)
        shuffled = rng.random() < 0.5
        for tick in range(int(seconds * 1e9 // period)):
            t = phase + tick * period + int(rng.normal(0, 0.2 * MS))
            if silence[0] < t < silence[1]:
                continue
            for k, slot in enumerate(rng.permutation(slots) if shuffled else slots):
                if rng.random() < 0.002 * faults:
                    continue
                for again in range(1 + rng.geometric(0.5) * (rng.random() < 0.01 * faults)):
                    later = again * int(rng.choice([0, 130_000, TWICE_NS - 1, TWICE_NS, 900_000]))
                    rows.append((t + 120_000 * k + later, slot, rng.integers(0, 256, 8) * (rng.random() < 0.8)))
    rows.sort(key=lambda row: row[0])
    t = START + np.maximum.accumulate(np.array([max(0, row[0]) for row in rows], np.int64))
    return np.array([r[1] for r in rows], np.int16), np.array([r[2] for r in rows], np.uint8), t + 7_000 * MS, t


def of_four(n_triangles: int) -> list[int]:
    """The board of each triangle."""
    return [row // 4 for row in range(n_triangles)]


def assembling(boards: list[int]) -> CycleAssembler:
    return CycleAssembler(np.array(boards, np.uint8), PERIOD, SLACK)


def run(assembler: CycleAssembler, frames: tuple, cuts: list[int]) -> Cycles:
    slots, data, t_ns, t_mono_ns = frames
    closed = []
    for a, b in zip([0, *cuts], [*cuts, len(slots)], strict=True):
        closed += assembler.feed(slots[a:b], data[a:b], t_ns[a:b], t_mono_ns[a:b])
    return Cycles.concatenate(closed, assembler.n_triangles)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([1, 4, 9]), st.sampled_from([0.0, 0.3, 1.0]), st.data())
def test_same_cycles_as_one_frame_at_a_time_however_the_stream_is_cut(seed, n_triangles, faults, data):
    rng = np.random.default_rng(seed)
    frames = stream(rng, n_triangles, 1.5, faults)
    n = len(frames[0])
    cuts = sorted(data.draw(st.lists(st.integers(0, n), max_size=12)))
    assembler, oracle = assembling(of_four(n_triangles)), OneAtATime(of_four(n_triangles))
    cycles = run(assembler, frames, cuts)
    for slot, payload, t_ns, t_mono_ns in zip(*frames, strict=True):
        oracle.frame(int(slot), payload.tobytes(), int(t_ns), int(t_mono_ns))
    compare(assembler, cycles, oracle)
    assert int(assembler.arrivals.sum()) == n


def compare(assembler: CycleAssembler, cycles: Cycles, oracle: OneAtATime) -> None:
    assembler.settle()
    assert len(cycles) == len(oracle.out)
    for name in oracle.out[0] if oracle.out else ():
        expected = np.array([cycle[name] for cycle in oracle.out])
        np.testing.assert_array_equal(getattr(cycles, name), expected, err_msg=name)
    assert assembler.superseded == oracle.superseded
    assert assembler.skipped == oracle.skipped
    assert assembler.due_ns == oracle.due
    assert assembler.changes.tolist() == oracle.changes
    assert assembler.missed.tolist() == oracle.missed
    assert np.flatnonzero(assembler.expected).tolist() == sorted(oracle.expected)
    assert assembler.outstanding == len(oracle.expected - oracle.seen)


DUE, SHORT_GAP, SECOND = PERIOD + SLACK, 100 * MS, 1000 * MS
ALL = -1  # halves, one after the other; else a slot
ACTS = st.tuples(
    st.sampled_from(["frame", "frame", "frame", "read what came", "look at the clock"]),
    st.sampled_from([ALL, ALL, 0, 1, 2, 3]),
    # From the act before: such that frames and looks fall on the very moment at which something ends.
    st.sampled_from(
        [0, TWICE_NS - 1, TWICE_NS, SLACK, PERIOD, DUE, 75 * MS, DUE + SHORT_GAP, DUE + SHORT_GAP + 1, SECOND]
    ),
)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from([[5], [5, 5], [5, 6]]), st.lists(ACTS, min_size=1, max_size=40))
def test_frames_at_exactly_a_deadline_follow_the_rules(boards, acts):
    oracle, n_triangles = OneAtATime(boards), len(boards)
    closed, waiting, t = [], [], START

    def read() -> None:
        if waiting:
            slots, data, t_ns = zip(*waiting, strict=True)
            stamps = np.array(t_ns, np.int64)
            closed.extend(assembler.feed(np.array(slots, np.int16), np.array(data, np.uint8), stamps, stamps))
            waiting.clear()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "GAP_NS", SHORT_GAP)
        assembler = assembling(boards)  # the kernel takes the numbers of the rules when it is made
        for number, (act, which, later) in enumerate(acts):
            t += later
            if act == "frame":
                for slot in range(2 * n_triangles) if which == ALL else [which % (2 * n_triangles)]:
                    payload = np.full(8, number, np.uint8)
                    waiting.append((slot, payload, t))
                    oracle.frame(slot, payload.tobytes(), t, t)
            else:
                read()
                if act == "look at the clock":
                    closed += assembler.advance(t)
                    oracle.until(t)
        read()
    compare(assembler, Cycles.concatenate(closed, n_triangles), oracle)


def regular(n_triangles: int, cycles: int, period: int = PERIOD, start: int = START) -> tuple:
    slots = np.tile(np.arange(2 * n_triangles, dtype=np.int16), cycles)
    tick = np.repeat(np.arange(cycles), 2 * n_triangles)
    t = start + tick * period + slots.astype(np.int64) * 120_000
    data = np.zeros((len(slots), 8), np.uint8)
    data[:, 1:] = (tick % 250)[:, None]
    return slots, data, t, t


def test_a_complete_cycle_closes_with_its_last_half():
    slots, data, t_ns, t_mono_ns = regular(3, 5)
    cycles = run(assembling(of_four(3)), (slots, data, t_ns, t_mono_ns), [])
    assert len(cycles) == 5
    np.testing.assert_array_equal(cycles.t_mono_ns, t_mono_ns[5::6])
    assert (cycles.counts == np.arange(5)[:, None, None]).all()
    assert not cycles.late.any()
    assert not cycles.missing.any()
    np.testing.assert_array_equal(cycles.age_ns[0], (np.array([5, 3, 1]) * 120_000))


def test_an_assembler_uses_only_the_slots_of_its_foot():
    left, right = regular(2, 10), regular(3, 10, start=START + 7 * MS)
    both = [np.concatenate(pair) for pair in zip(left, (right[0] + 4, *right[1:]), strict=True)]
    both[0] = np.append(both[0], [-1, 10]).astype(np.int16)  # no half, and one of a third foot
    both[1:] = [np.append(column, column[-2:], axis=0) for column in both[1:]]
    order = np.argsort(both[3], kind="stable")
    frames = tuple(column[order] for column in both)
    for first_slot, own in ((0, left), (4, right)):
        boards = np.array(of_four(len(np.unique(own[0])) // 2), np.uint8)
        cycles = run(CycleAssembler(boards, PERIOD, SLACK, first_slot), frames, [])
        alone = run(CycleAssembler(boards, PERIOD, SLACK), own, [])
        np.testing.assert_array_equal(cycles.t_mono_ns, alone.t_mono_ns)
        np.testing.assert_array_equal(cycles.arrivals, alone.arrivals)


def test_a_missing_half_delays_a_cycle_by_the_slack_and_no_more():
    slots, data, t_ns, t_mono_ns = regular(3, 10)
    lost = np.ones(60, bool)
    lost[4 * 6 + 2] = False
    cycles = run(assembling(of_four(3)), (slots[lost], data[lost], t_ns[lost], t_mono_ns[lost]), [])
    late = np.flatnonzero(cycles.late)
    assert late.tolist() == [4]
    assert cycles.t_mono_ns[4] == cycles.t_mono_ns[3] + PERIOD + SLACK
    assert cycles.missing[4].tolist() == [False, True, False]


@pytest.mark.parametrize("which", range(6))
def test_a_half_that_its_controller_sent_twice_moves_no_cycle(which):
    frames = regular(3, 20)
    row = 7 * 6 + which
    twice = tuple(np.insert(column, row + 1, column[row], axis=0) for column in frames)
    twice[3][row + 1] += 130_000 * (which == 5)  # before the next one; after the last there is time
    assembler = assembling(of_four(3))
    cycles, undisturbed = run(assembler, twice, []), run(assembling(of_four(3)), frames, [])
    np.testing.assert_array_equal(cycles.t_mono_ns, undisturbed.t_mono_ns)
    np.testing.assert_array_equal(cycles.counts, undisturbed.counts)
    assert cycles.age_ns.max() < 6 * 120_000
    assert assembler.superseded == 1


def test_frames_that_an_adapter_delivers_in_one_batch_lose_no_cycle():
    slots, data, t_ns, t_mono_ns = regular(2, 30)
    tick = np.arange(len(slots)) // 4
    held_up = (tick >= 10) & (tick < 13)
    t_mono_ns[held_up] = t_mono_ns[tick == 12].max() + np.arange(held_up.sum()) * 10_000
    for cuts in ([], [11 * 4]):
        cycles = run(assembling(of_four(2)), (slots, data, t_ns, t_mono_ns), cuts)
        assert sorted(set(cycles.counts[:, 0, 0].tolist())) == list(range(30))


def test_a_silent_half_that_is_sent_twice_is_not_waited_for():
    slots, data, t_ns, t_mono_ns = regular(3, 60)
    tick = np.arange(len(slots)) // 6
    keep = (slots != 4) | (tick < 5) | (tick == 40)
    assembler = assembling(of_four(3))
    once = [column[keep] for column in (slots, data, t_ns, t_mono_ns)]
    again = int(np.flatnonzero((once[0] == 4) & (once[3] > START + 20 * PERIOD))[0])
    cycles = run(assembler, tuple(np.insert(column, again + 1, column[again], axis=0) for column in once), [])
    assert not assembler.expected[4]
    assert cycles.late.sum() == PATIENCE


def test_a_half_received_once_between_misses_does_not_prolong_the_wait():
    assembler, late = assembling(of_four(2)), 0
    for tick in range(20):
        frames = regular(2, 1, start=START + tick * PERIOD)
        there = (frames[0] != 3) | (tick < 5) | (tick == 4 + PATIENCE)
        closed = assembler.feed(*(column[there] for column in frames))
        closed += assembler.advance(START + (tick + 1) * PERIOD - 1)  # as the live path does
        late += sum(cycles.late.sum() for cycles in closed)
    assert late == PATIENCE
    assert not assembler.expected[3]


def test_boards_at_50_ms_are_repeated_on_a_steady_grid_with_their_true_age():
    assembler = assembling(of_four(2))
    cycles = run(assembler, regular(2, 40, period=50 * MS), [])
    assert assembler.outstanding == 0
    settled = cycles.t_mono_ns > START + 300 * MS
    assert (np.diff(cycles.t_mono_ns[settled]) == PERIOD).all()
    assert not cycles.missing[settled].any()
    assert cycles.age_ns[settled].min() >= 0
    assert 30 * MS < cycles.age_ns[settled].max() <= 50 * MS + 4 * 120_000
    assert 0.5 < cycles.repeated[settled].mean() < 0.7  # 30 of 50


def test_a_silent_board_is_given_up_and_taken_back():
    n = 4
    slots, data, t_ns, t_mono_ns = regular(n, 200)
    tick = np.arange(len(slots)) // (2 * n)
    silent = (slots >= 4) & (tick >= 50) & (tick < 100)
    keep = ~silent
    assembler = assembling(of_four(n))
    cycles = run(assembler, (slots[keep], data[keep], t_ns[keep], t_mono_ns[keep]), [])
    assert cycles.late.sum() == PATIENCE
    during = (cycles.t_mono_ns > START + 55 * PERIOD) & (cycles.t_mono_ns < START + 100 * PERIOD)
    assert (np.diff(cycles.t_mono_ns[during]) == PERIOD).all(), "50 Hz goes on with the boards that are there"
    assert cycles.age_ns[during][:, 2:].max() > 900 * MS
    assert cycles.age_ns[-1].max() < PERIOD
    assert assembler.expected.all()


def test_a_long_silence_is_skipped_not_filled():
    first, second = regular(1, 5), regular(1, 5, start=START + module.GAP_NS * 100)
    frames = tuple(np.concatenate(pair) for pair in zip(first, second, strict=True))
    assembler = assembling(of_four(1))
    cycles = run(assembler, frames, [])
    assert len(cycles) < 20
    assert assembler.skipped == pytest.approx(module.GAP_NS * 100 // PERIOD, rel=1e-3)


def test_time_alone_closes_a_due_cycle():
    slots, data, t_ns, t_mono_ns = regular(2, 3)
    assembler = assembling(of_four(2))
    assert assembler.advance(START) == []
    run(assembler, (slots, data, t_ns, t_mono_ns), [])
    due = assembler.due_ns
    assert due == t_mono_ns[-1] + PERIOD + SLACK
    assert assembler.advance(due) == []
    (late,) = assembler.advance(due + 1)
    assert late.late.tolist() == [True]
    assert late.missing.all()
    assert late.repeated.tolist() == [True]


def test_never_received_is_never_zero_age():
    slots, data, t_ns, t_mono_ns = regular(2, 3)
    keep = slots < 3
    assembler = assembling(of_four(2))
    cycles = run(assembler, (slots[keep], data[keep], t_ns[keep], t_mono_ns[keep]), [])
    assert (cycles.age_ns[:, 1] == -1).all()
    assert (cycles.triangle_t_ns[:, 1] == 0).all()


def test_no_cycles_have_the_shapes_and_types_of_cycles():
    some = run(assembling(of_four(3)), regular(3, 5), [4])  # one the careful way, four at once
    careful = assembling(of_four(3)).feed(*(column[:7] for column in regular(3, 2, PERIOD + 2 * SLACK)))[0]
    none = Cycles.concatenate([], 3)
    assert len(none) == 0
    assert (some.counts.dtype, some.status.dtype, some.missing.dtype, some.late.dtype) == (
        np.uint8, np.uint16, np.bool_, np.bool_
    )  # fmt: skip
    for name in Cycles.__slots__:
        one = getattr(some, name)
        assert getattr(none, name).shape == one[:0].shape, name
        assert {getattr(none, name).dtype, getattr(careful, name).dtype} == {one.dtype}, name


def test_the_end_of_a_cycle_is_promised_while_the_boards_keep_their_rhythm():
    slots, data, t_ns, t_mono_ns = regular(2, 8)
    keep = np.ones(len(slots), bool)
    keep[4 * 4 + 3] = False  # the last half of the fifth cycle, which is late then
    assembler, promises = assembling(of_four(2)), []
    for row in np.flatnonzero(keep):
        at = slice(row, row + 1)
        if assembler.feed(slots[at], data[at], t_ns[at], t_mono_ns[at]):
            promises.append(None if assembler.promised_ns is None else assembler.promised_ns - int(t_mono_ns[row]))
    assert promises == [None, PERIOD, PERIOD, PERIOD, None, None, PERIOD, PERIOD]


def test_one_late_half_moves_the_promise_by_an_eighth_more_than_itself():
    slots, data, t_ns, t_mono_ns = regular(2, 5)
    t_mono_ns[4 * 4 + 3] += 400_000  # the last half of the fifth cycle
    assembler = assembling(of_four(2))
    for cycle in range(5):
        at = slice(4 * cycle, 4 * cycle + 4)
        assembler.feed(slots[at], data[at], t_ns[at], t_mono_ns[at])
    assert assembler.promised_ns == int(t_mono_ns[-1]) + PERIOD + 50_000
