"""Two feet on one bus: each closes its own cycles, and what is waited for is what comes first of either."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.bus.frames import FrameBatch, ReceivedFrames
from insole_daemon.compiled import kernel
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.assembler import PATIENCE, TWICE_NS
from insole_daemon.skin.identifiers import TAG_A, TAG_B, skin_id
from insole_daemon.skin.layout import Foot, Layout, Triangle
from insole_daemon.skin.reader import JITTER_NS, SkinReader

MS = 1_000_000
PERIOD_NS, SLACK_NS = 20 * MS, 5 * MS
LIMIT_NS = PERIOD_NS + SLACK_NS
START_NS = 1_000 * MS  # monotonic
WALL_NS = 7_000 * MS  # ahead of the monotonic clock

Half = tuple[int, int, int]  # board, triangle, tag


def layout(foot: Foot, *identities: tuple[int, int]) -> Layout:
    return layouts.of(foot, 1e-5, None, tuple(
        Triangle(board=board, triangle=triangle, patch="", x_mm=100.0 * at, y_mm=0.0, rotation_deg=0.0)
        for at, (board, triangle) in enumerate(identities)
    ))  # fmt: skip


LEFT, RIGHT = layout("left", (7, 1), (5, 1), (5, 0)), layout("right", (8, 4))


def halves(of: Layout) -> list[Half]:
    return [(t.board, t.triangle, tag) for t in of.triangles for tag in (TAG_A, TAG_B)]


def frames(*rows: tuple[int, Half]) -> FrameBatch:
    """Rows of (ns after the start, half); every count is ten times the board and the triangle's number."""
    n = len(rows)
    t_mono_ns = START_NS + np.array([t_ns for t_ns, _ in rows], np.int64)
    data = [[tag, *[10 * board + triangle] * 5, 0, 0] for _, (board, triangle, tag) in rows]
    return FrameBatch(
        t_mono_ns + WALL_NS, t_mono_ns, np.zeros(n, np.uint8),
        np.array([skin_id(board, triangle) for _, (board, triangle, _) in rows], np.uint32),
        np.full(n, 8, np.uint8), np.array(data, np.uint8).reshape(n, 8), np.zeros(n, np.uint8),
    )  # fmt: skip


def complete(reader: SkinReader, of: Layout, *times_ns: int) -> None:
    """All halves of a foot arrive at each of these times."""
    for t_ns in times_ns:
        (closed,) = (cycles for cycles in reader.feed(frames(*((t_ns, half) for half in halves(of)))) if cycles)
        assert [len(cycles) for cycles in closed] == [1]


def give_up(reader: SkinReader, of: Layout) -> None:
    """A single half of a foot, and then none for so long that no more is waited for."""
    reader.feed(frames((0, halves(of)[0])))
    reader.advance(START_NS + (PATIENCE + 1) * LIMIT_NS + 1)


@pytest.fixture
def reader() -> SkinReader:
    return SkinReader([LEFT, RIGHT], PERIOD_NS, SLACK_NS)


@pytest.mark.parametrize("order", [[LEFT, RIGHT], [RIGHT, LEFT]], ids=["left first", "right first"])
def test_each_foot_closes_its_own_cycle_when_it_is_complete(order: list[Layout]) -> None:
    reader = SkinReader(order, PERIOD_NS, SLACK_NS)
    *rest, last = [(at * MS, half) for at, half in enumerate(halves(LEFT))]
    left, right = order.index(LEFT), order.index(RIGHT)
    assert reader.feed(frames(*rest, (6 * MS, halves(RIGHT)[1]))) == [[], []]

    closed = reader.feed(frames((7 * MS, last[1])))
    assert closed[right] == []
    (cycle,) = closed[left]
    assert cycle.t_mono_ns.tolist() == [START_NS + 7 * MS]
    assert cycle.t_ns.tolist() == [START_NS + 7 * MS + WALL_NS]
    assert cycle.counts[0, :, 0].tolist() == [71, 51, 50]
    assert cycle.age_ns.tolist() == [[7 * MS, 5 * MS, 3 * MS]]

    closed = reader.feed(frames((8 * MS, halves(RIGHT)[0])))
    assert closed[left] == []
    (cycle,) = closed[right]
    assert cycle.t_mono_ns.tolist() == [START_NS + 8 * MS]
    assert cycle.counts[0, :, 0].tolist() == [84]
    assert not cycle.late.any()


@pytest.mark.parametrize(
    ("between", "closes"), [((7, 1, TAG_A), False), ((5, 0, TAG_A), True)], ids=["another board", "the same board"]
)
def test_a_repeated_half_is_recognised_by_the_frames_between(reader: SkinReader, between: Half, closes: bool) -> None:
    again = (5, 1, TAG_B)
    reader.feed(frames(*((0, half) for half in halves(LEFT) if half != again), (0, again)))
    reader.feed(frames((TWICE_NS // 3, between), (TWICE_NS // 2, again)))
    others = [half for half in halves(LEFT) if half not in (again, between)]
    closed, _ = reader.feed(frames(*((10 * MS, half) for half in others)))
    assert [len(cycles) for cycles in closed] == [1] * closes


def test_frames_of_unknown_boards_close_no_cycle_and_are_counted(reader: SkinReader) -> None:
    assert reader.feed(frames((0, (9, 0, TAG_A)), (0, (8, 5, TAG_A)))) == [[], []]
    assert reader.streams.refused.unconfigured_board == {9: 1}
    assert reader.streams.refused.unconfigured_triangle == 1
    assert reader.expected().due_ns is None


def test_no_frames_close_nothing(reader: SkinReader) -> None:
    assert reader.feed(FrameBatch.empty()) == [[], []]


def test_nothing_is_due_or_promised_before_the_first_frame(reader: SkinReader) -> None:
    assert reader.expected().due_ns is None
    assert reader.expected().promised_ns is None
    assert reader.advance(START_NS + 1_000 * LIMIT_NS) == [[], []]


@pytest.mark.parametrize("first", [LEFT, RIGHT], ids=["left", "right"])
def test_time_closes_the_cycle_of_the_foot_that_is_due_first(reader: SkinReader, first: Layout) -> None:
    second = RIGHT if first is LEFT else LEFT
    reader.feed(frames((0, halves(first)[0])))
    assert reader.expected().due_ns == START_NS + LIMIT_NS
    reader.feed(frames((3 * MS, halves(second)[0])))
    assert reader.expected().due_ns == START_NS + LIMIT_NS
    assert reader.advance(START_NS + LIMIT_NS) == [[], []]
    closed = reader.advance(START_NS + LIMIT_NS + 1)
    assert [[len(cycles) for cycles in of_feet] for of_feet in closed] == ([[1], []] if first is LEFT else [[], [1]])
    (cycle,) = closed[0] + closed[1]
    assert cycle.late.all()
    assert reader.expected().due_ns == START_NS + LIMIT_NS + 3 * MS


def test_outstanding_are_the_halves_of_the_foot_that_lacks_least(reader: SkinReader) -> None:
    outstanding = [reader.expected().outstanding]
    for half in halves(LEFT)[:-1]:
        reader.feed(frames((0, half)))
        outstanding.append(reader.expected().outstanding)
    assert outstanding == [2, 2, 2, 2, 2, 1], "six of the left foot and two of the right"
    reader.feed(frames((0, halves(LEFT)[-1])))
    assert reader.expected().outstanding == 2


def test_a_foot_that_waits_for_none_has_nothing_outstanding(reader: SkinReader) -> None:
    give_up(reader, RIGHT)
    assert reader.expected().outstanding == 6
    give_up(reader, LEFT)
    assert reader.expected().outstanding is None


def test_the_next_cycle_is_promised_by_the_rhythm_of_the_foot_that_comes_first(reader: SkinReader) -> None:
    complete(reader, LEFT, 0, 20 * MS)
    assert reader.expected().promised_ns is None, "the right foot is waited for and has no rhythm"
    complete(reader, RIGHT, 23 * MS)
    assert reader.expected().promised_ns is None
    complete(reader, LEFT, 40 * MS)
    complete(reader, RIGHT, 44 * MS)
    assert reader.expected().promised_ns == START_NS + 60 * MS
    complete(reader, LEFT, 60 * MS)
    assert reader.expected().promised_ns == START_NS + 65 * MS


def test_a_foot_that_waits_for_none_promises_nothing(reader: SkinReader) -> None:
    give_up(reader, LEFT)
    assert reader.expected().promised_ns is None
    complete(reader, RIGHT, 200 * MS, 221 * MS)
    assert reader.expected().promised_ns == START_NS + 242 * MS
    reader.advance(START_NS + 1_000 * MS)
    assert reader.expected().outstanding is None
    assert reader.expected().promised_ns is None


@pytest.mark.parametrize(
    ("right_ms", "from_ms", "look_ms"),
    [(3, 50, 63), (3, 63, 63), (3, 64, 83), (15, 50, 60), (15, 61, 80), (0, 50, 60), (3, 10_000, 10_003)],
)
def test_the_best_look_is_when_the_foot_that_follows_the_other_is_complete(
    reader: SkinReader, right_ms: int, from_ms: int, look_ms: int
) -> None:
    for at_ms in (0, 20):
        complete(reader, LEFT, at_ms * MS)
        complete(reader, RIGHT, (at_ms + right_ms) * MS)
    assert reader.best_poll_ns(START_NS + JITTER_NS + from_ms * MS) == START_NS + JITTER_NS + look_ms * MS


def test_the_best_look_follows_the_foot_that_is_waited_for(reader: SkinReader) -> None:
    assert reader.best_poll_ns(START_NS) == START_NS, "nothing has come"
    give_up(reader, LEFT)
    complete(reader, RIGHT, 200 * MS)
    assert reader.best_poll_ns(START_NS + 300 * MS) == START_NS + 300 * MS, "it has no rhythm"
    complete(reader, RIGHT, 221 * MS)
    assert reader.best_poll_ns(START_NS + 300 * MS) == START_NS + 302 * MS + JITTER_NS
    reader.advance(START_NS + 1_000 * MS)
    assert reader.best_poll_ns(START_NS + 300 * MS) == START_NS + 300 * MS, "none is waited for"


@pytest.mark.skipif(kernel is None, reason="no kernel, see tests/test_compiled.py; 'python hatch_build.py' builds it")
@pytest.mark.parametrize("size", [1, 17, 56, 500, 5000])
def test_a_block_of_frames_is_read_as_its_arrays_are(size: int) -> None:
    rng = np.random.default_rng(size)
    n = 5000
    ids = np.array([0x400 | board << 4 | triangle for board in (5, 6, 7, 8, 9, 10, 11) for triangle in range(16)])
    ids = np.append(ids, [0x123, 0x7A5, 0x600 | 8 << 4])
    can_id = rng.choice(ids, n).astype(np.uint32)
    t_ns = np.cumsum(rng.integers(0, 300_000, n)) + (np.arange(n) > 4000) * 400 * MS
    data = rng.integers(0, 256, (n, 8), np.uint8)
    data[:, 0] = rng.choice([TAG_A, TAG_B, 0], n, p=[0.49, 0.49, 0.02])
    eight, zero = np.full(n, 8, np.uint8), np.zeros(n, np.uint8)
    arrays = FrameBatch(t_ns, t_ns + 7, zero, can_id, eight, data, zero)
    readers = [SkinReader([LEFT, RIGHT], PERIOD_NS, SLACK_NS) for _ in range(2)]
    n_closed = 0
    for first in range(0, n, size):
        part = arrays[first : first + size]
        raw = np.zeros((len(part), 16), np.uint8)
        raw.view(np.uint32)[:, 0], raw[:, 4], raw[:, 8:] = part.can_id, 8, part.data
        block = ReceivedFrames(b"".join((part.t_ns, part.t_mono_ns, raw, part.interface)))
        for name in FrameBatch.__slots__:
            assert np.array_equal(getattr(block, name), getattr(part, name)), name
        expected, of_block = readers[0].closed_cycles(part), readers[1].closed_cycles(block)
        assert of_block == expected
        assert readers[1].expected() == readers[0].expected()
        n_closed += len(of_block[0]) + len(of_block[1])
    assert n_closed > 40
    assert readers[1].streams.refused == readers[0].streams.refused
    assert readers[1].streams.refused.unconfigured_board
