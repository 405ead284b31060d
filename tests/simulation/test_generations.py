"""MTB3 compared with MTB4: arithmetic, queues, commands. Numbers are computed by hand from mtb3/main_V3.c and
theSkin.cpp.
"""

import ctypes

import numpy as np
import pytest

from insole_daemon.physics.digitiser import GAINS_TYPE_0, GAINS_TYPE_8, compensation_codes, digitise
from insole_daemon.simulation.board import EmulatedBoard
from insole_daemon.simulation.bus_time import STACK_FRAMES, BusTime, Offer
from insole_daemon.simulation.commands import obey
from insole_daemon.simulation.generation import MTB3, MTB4

TRIANGLES = (0, 3, 7)
NOTHING = np.zeros((3, 12))
SECOND = 1_000_000_000
MS = 1_000_000


def made(generation, **settings):
    board = EmulatedBoard(
        5, TRIANGLES, **{"period_ms": 20, "shift": 3, "no_load": 240, "generation": generation, **settings}
    )
    board.power_up(0)
    return board


def tell(board, *payloads, t_ns=0, load=NOTHING, to=0x205):
    answers = [obey(board, to, bytes.fromhex(payload), t_ns, load) for payload in payloads]
    return answers[-1]


def sent(board, until_ns, load=NOTHING):
    """Return the ticks at which it sends before `until_ns`, and counts (n, n_enabled, 12)."""
    ticks = board.ticks(until_ns)
    ticks, payloads = board.send_ticks(ticks, np.broadcast_to(load, (len(ticks), 3, 12)))
    pairs = payloads.reshape(len(ticks), len(board.can_ids) // 2, 2, 8)
    return ticks, np.concatenate([pairs[..., 0, 1:8], pairs[..., 1, 1:6]], axis=-1)


# ---- arithmetic

# dT, then drift of taxel 0 (gain 70), 3 (38) and 9 (164); |dT| >> 2, times the gain, >> 5.
COMPENSATION = [
    (0, (0, 0, 0), (0, 0, 0)),
    (3, (0, 0, 0), (0, 0, 0)),
    (100, (54, 29, 128), (54, 29, 128)),  # 1750, 950, 4100
    (-100, (-55, -30, -129), (-54, -29, -128)),
    (-1, (0, 0, 0), (0, 0, 0)),
    (128, (70, 38, 164), (70, 38, 164)),  # nothing to round
    (-128, (-70, -38, -164), (-70, -38, -164)),
    (1600, (875, 475, 2050), (875, 475, 2)),  # 400 · 164 = 65600 wraps to 64 on 16 bits
    (-1600, (-875, -475, -2050), (-875, -475, -2)),
]


@pytest.mark.parametrize(("change", "mtb4", "mtb3"), COMPENSATION)
def test_compensation_of_type_0_equals_hand_computed_values(change, mtb4, mtb3):
    baseline16 = np.full((1, 12), 30_000)
    raw16 = baseline16.copy()
    raw16[0, 6] += change
    raw16[0, 10] += 500  # the other pad is never used
    for narrow, expected in ((False, mtb4), (True, mtb3)):
        codes = compensation_codes(raw16, baseline16, GAINS_TYPE_0, narrow)[0]
        assert tuple(codes[[0, 3, 9]]) == expected
        assert not codes[[6, 10]].any()


def test_compensation_of_type_8_equals_the_gains():
    baseline16 = np.full((1, 12), 30_000)
    raw16 = baseline16 + 128 * (np.arange(12) == 6)
    assert compensation_codes(raw16, baseline16, GAINS_TYPE_8)[0].tolist() == list(GAINS_TYPE_8)


def as_c_does(raw, base, no_load, shift, gains, narrow):
    """Compute one triangle, one number at a time, as the C code does."""
    signed = (lambda v: ctypes.c_int16(v).value) if narrow else (lambda v: v)
    unsigned = (lambda v: v & 0xFFFF) if narrow else (lambda v: v)
    up, bot = signed((255 - no_load) << shift), signed(no_load << shift)
    counts, flags = [], 0
    for k in range(12):
        by = 0
        if gains:
            if raw[6] > base[6]:
                by = unsigned((raw[6] - base[6] >> 2) * gains[k]) >> 5
            elif narrow:
                by = -(unsigned((base[6] - raw[6] >> 2) * gains[k]) >> 5)
            else:
                by = -((base[6] - raw[6] >> 2) * gains[k]) >> 5
        value = signed(raw[k] - base[k] - by)
        count = None
        if value <= signed(-up):
            count = 255
        if value >= bot:
            count = 0
        if count is None:
            count = no_load - (value >> shift) & 0xFF
        counts.append(count)
        flags |= (value <= signed(-signed(up << 1)) or value >= signed(bot << 1)) << k
    return counts, flags


@pytest.mark.parametrize("narrow", [False, True])
@pytest.mark.parametrize("gains", [None, GAINS_TYPE_0, GAINS_TYPE_8])
def test_digitised_words_equal_the_c_arithmetic(narrow, gains):
    draw = np.random.default_rng(5)
    for shift in (0, 2, 3, 6) if narrow else (0, 2, 3, 7):
        for no_load in (200, 240, 245):
            raw16 = draw.integers(0, 0x10000, (40, 12))
            near = draw.integers(-3000, 3000, (40, 12))
            baseline16 = np.where(draw.random((40, 1)) < 0.7, np.clip(raw16 + near, 1, 0xFFFF), 31_000)
            counts, status = digitise(raw16, baseline16, no_load, np.full((40, 1), shift), gains, narrow)
            for row in range(40):
                expected = as_c_does(raw16[row].tolist(), baseline16[row].tolist(), no_load, shift, gains, narrow)
                assert (counts[row].tolist(), int(status[row]) >> 4) == expected


def test_flags_of_an_mtb3_are_meaningless_at_shift_7():
    rest = np.full((1, 12), 30_000)
    for narrow, flags in ((False, 0), (True, 0xFFF0)):  # 2 · (240 << 7) wraps to −4096
        counts, status = digitise(rest, rest, 240, np.array([[7]]), None, narrow)
        assert (counts == 240).all()
        assert status[0] == flags


# ---- the queue of an MTB3


def offer(ready_ns, tags, triangle=0):
    n = len(tags)
    data = np.full((n, 8), 0x55, np.uint8)
    data[:, 0] = tags
    return Offer(ready_ns, 5, np.full(n, 0x450 + triangle, np.uint32), np.full(n, 8, np.uint8), data)


def test_the_last_queued_frame_follows_the_register():
    # The first goes straight into the register; while it is sent, the others pile up.
    bus = BusTime(0, stacks=[5])
    batch = bus.carry([offer(0, [1, 2]), offer(10_000, [3]), offer(20_000, [4])], SECOND)
    assert batch.data[:, 0].tolist() == [1, 4, 3, 2]


def test_the_register_keeps_its_frame_on_a_busy_bus():
    bus = BusTime(0, stacks=[5])
    first = offer(0, [9, 9])
    busy = Offer(0, 4, first.can_id - 0x10, first.dlc, first.data)
    batch = bus.carry([busy, offer(1000, [1]), offer(2000, [2]), offer(3000, [3])], SECOND)
    assert batch.data[:, 0].tolist() == [9, 9, 1, 3, 2]


def test_a_queue_in_pieces_equals_the_whole_queue():
    offers = [offer(at * 60_000, [at]) for at in range(30)]
    whole = BusTime(0, stacks=[5]).carry(offers, SECOND)
    bus = BusTime(0, stacks=[5])
    parts = [
        bus.carry([o for o in offers if at <= o.ready_ns < at + 100_000], at + 100_000)
        for at in range(0, 6_000_000, 100_000)
    ]
    assert [tag for part in parts for tag in part.data[:, 0]] == whole.data[:, 0].tolist()


def test_a_full_stack_is_discarded_and_reported_by_an_empty_frame():
    bus = BusTime(0, stacks=[5])
    tags = list(range(1, STACK_FRAMES + 2))
    full = bus.carry([offer(0, tags)], SECOND)  # one in the register, 20 behind it
    assert len(full) == STACK_FRAMES + 1
    bus = BusTime(0, stacks=[5])
    batch = bus.carry([offer(0, [*tags, 77]), offer(1000, [88])], SECOND)
    assert bus.lost == {5: STACK_FRAMES + 1}
    assert batch.data[:, 0].tolist() == [1, 88, 0]  # what was in the register, what came after, the report
    assert (batch.can_id[-1], batch.dlc[-1]) == (0x755, 0)


# ---- commands


@pytest.mark.parametrize("generation", [MTB3, MTB4])
def test_silent_after_power_up(generation):
    board = made(generation, streaming=False)
    assert not len(board.ticks(10 * SECOND))


def test_boards_answer_discovery_with_their_type():
    assert tell(made(MTB3), "ff", to=0x70F) == (0x750, bytes([0xFF, 5, 2, 17, 0]))
    assert tell(made(MTB3), "1c0100") == (0x250, bytes([0x1C, 5, 2, 17, 0, 1, 0, 1]))
    assert tell(made(MTB3), "1c0101")[1][-1] == 0
    assert tell(made(MTB3), "1c0200")[1][-1] == 0
    assert tell(made(MTB4), "ff", to=0x70F) == (0x750, bytes([0xFF, 11, 1, 25, 0]))


def test_only_an_mtb4_obeys_a_skin_command_to_all():
    for generation, no_load in ((MTB3, 240), (MTB4, 200)):
        board = made(generation)
        tell(board, "4d0032c8", to=0x20F)
        assert board.no_load == no_load


def test_only_an_mtb4_masks_the_code():
    for generation, streaming in ((MTB3, True), (MTB4, False)):
        board = made(generation)
        tell(board, "8701")
        assert board.streaming is streaming


def test_an_mtb4_stays_silent_after_a_triangle_configuration():
    board = made(MTB4)
    tell(board, "50000f03010022")
    assert not len(board.ticks(5 * SECOND))


def test_an_mtb3_calibrates_for_three_ticks_and_continues():
    load = np.full((3, 12), 100e3)
    board = made(MTB3)
    before, counts = sent(board, SECOND, load)
    assert abs(counts[:, 0, 0].mean() - 240 + 12.5) < 2
    tell(board, "50000f03010022", t_ns=SECOND, load=load)
    after, counts = sent(board, 2 * SECOND, load)
    assert after[0] - before[-1] == 4 * board.period_ns  # silent for more than two periods
    assert abs(counts[:, 0, 0].mean() - 240) < 3  # under load, all is at no-load
    assert (np.diff(after) == board.period_ns).all()


def test_a_silent_mtb3_stays_silent_after_calibration():
    board = made(MTB3, streaming=False)
    tell(board, "50000002010022")
    ticks, _ = sent(board, SECOND)
    assert not len(ticks)
    assert not board.streaming
    tell(board, "0700", t_ns=SECOND)
    assert len(sent(board, 2 * SECOND)[0]) == 19


def test_the_session_of_the_official_host_on_an_mtb3():
    board = made(MTB3, streaming=False)
    tell(board, "4d0032f5", "50000f02000022", "50000102010022")
    tell(board, "0700", t_ns=SECOND // 2)
    ticks, counts = sent(board, 2 * SECOND)
    assert board.can_ids.tolist() == [0x450, 0x450, 0x451, 0x451]
    assert ticks[0] >= SECOND // 2
    assert abs(counts[:, 0].mean() - 245.4) < 2
    assert (counts[:, 1] == 245).all()


def test_an_mtb3_streams_in_the_legacy_class_until_commanded():
    board = made(MTB3, streaming=False)
    tell(board, "4e0222f000ff000a", "4c01010100200000")
    ticks, counts = sent(board, SECOND)
    assert set(board.can_ids.tolist()) == {0x350 + t for t in range(8)}
    assert len(ticks) == pytest.approx(17, abs=1)  # 50 ms, three ticks of them calibrating
    assert abs(counts[:, 0].mean() - 240.4) < 2
    tell(board, "0700", t_ns=SECOND)
    assert set(board.can_ids.tolist()) == {0x450 + t for t in range(8)}


def test_legacy_setup_of_an_mtb4_ignores_its_arguments():
    board = made(MTB4, streaming=False)
    tell(board, "4c01010300200101")
    ticks, _ = sent(board, SECOND)
    assert len(ticks) == 24  # 40 ms, whatever was asked for
    assert len(board.can_ids) == 32
    assert board.no_load == 245
    tell(board, "4e0322800801000a", t_ns=SECOND)  # not handled
    assert board.no_load == 245


def test_an_mtb3_takes_its_first_baseline_by_itself():
    load = np.full((3, 12), 200e3)
    board = made(MTB3, streaming=False)
    assert board.next_event_ns == 2 * board.period_ns
    board.apply_next_event(load)
    tell(board, "0700", t_ns=SECOND)
    assert abs(sent(board, 2 * SECOND, load)[1][:, 0].mean() - 245) < 3  # zeroed under load


def test_periods_of_an_mtb3_wrap_beyond_209_ms():
    board = made(MTB3)
    for asked, nominal_ms in ((209, 209), (210, 4), (255, 255 - 65536 * 3.2e-3)):
        tell(board, f"4d00{asked:02x}f0")
        assert board.period_ns == pytest.approx(nominal_ms * MS, rel=2e-4)
    board = made(MTB4)
    tell(board, "4d00fff0")
    assert board.period_ns == pytest.approx(255 * MS, rel=2e-4)


def test_unknown_skin_types_of_an_mtb3_disable_compensation():
    for skin_type in (7, 8):
        plain, unknown = (made(MTB3, skin_type=t, compensated=True) for t in (2, skin_type))
        assert (sent(plain, SECOND)[1] == sent(unknown, SECOND)[1]).all()
