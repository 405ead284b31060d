"""The boards on one bus: bit times, arbitration, rates, and playing in real time."""

import threading
import time

import numpy as np
import pytest

from insole_daemon import config
from insole_daemon.bus.frames import FRAME_TIME_NS, FrameBatch
from insole_daemon.simulation.bus_time import BusTime, Offer, frame_bits
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Walk
from insole_daemon.simulation.load import Unloaded
from insole_daemon.simulation.reference_insole import reference_insole
from insole_daemon.skin import layout
from tests.conftest import PATIENCE_S

ADDRESSES = {"left": (5, 6, 7), "right": (8, 9, 10)}
LAYOUTS = [layout.builtin(foot, addresses) for foot, addresses in ADDRESSES.items()]
WALK = Walk(LAYOUTS)
START_NS = 1_700_000_000_000_000_000
SECOND = 1_000_000_000


def emulator(load=WALK, layouts=LAYOUTS, boards=None, **more):
    settings = config.Config()
    if boards is not None:
        settings = config.Config(
            insoles=tuple(
                config.Insole(
                    foot=foot,
                    boards=tuple(config.Board(address=a, interface="can0", **boards) for a in addresses),
                )
                for foot, addresses in ADDRESSES.items()
            )
        )
    return Emulator(settings, layouts, load, **more)


def offer(ready_ns, address, n, first_triangle=0):
    triangles = first_triangle + np.arange(n, dtype=np.uint32) // 2
    data = np.full((n, 8), 0x55, np.uint8)
    data[:, 0] = np.where(np.arange(n) % 2, 0xC0, 0x40)
    can_id = (np.uint32(0x400 | address << 4) + triangles).astype(np.uint32)
    return Offer(ready_ns, address, can_id, np.full(n, 8, np.uint8), data)


def commands(*frames):
    n = len(frames)
    data = np.zeros((n, 8), np.uint8)
    for row, (_, payload) in enumerate(frames):
        data[row, : len(payload)] = list(payload)
    ids = np.array([can_id for can_id, _ in frames], np.uint32)
    dlc = np.array([len(payload) for _, payload in frames], np.uint8)
    return FrameBatch(
        np.zeros(n, np.int64),
        np.zeros(n, np.int64),
        np.zeros(n, np.uint8),
        ids,
        dlc,
        data,
        np.zeros(n, np.uint8),
    )


@pytest.fixture(scope="module")
def ten_seconds():
    return emulator().frames(START_NS, 10)


# The length of a frame


def bits_one_by_one(can_id, payload):
    bits = [0, *(can_id >> i & 1 for i in reversed(range(11))), 0, 0, 0]
    bits += [len(payload) >> i & 1 for i in reversed(range(4))]
    bits += [byte >> i & 1 for byte in payload for i in reversed(range(8))]
    crc = 0
    for bit in bits:
        crc = (crc << 1 & 0x7FFF) ^ (0x4599 if bit ^ crc >> 14 else 0)
    bits += [crc >> i & 1 for i in reversed(range(15))]
    stuffed = []
    for bit in bits:
        stuffed.append(bit)
        if stuffed[-5:] in ([0] * 5, [1] * 5) and run_of_stuffed(stuffed) == 5:
            stuffed.append(1 - bit)
    return len(stuffed) + 1 + 2 + 7 + 3


def run_of_stuffed(bits):
    length = 1
    while length < len(bits) and bits[-1 - length] == bits[-1]:
        length += 1
    return length


def test_frame_bits_equal_bit_by_bit_stuffing():
    draw = np.random.default_rng(1)
    n = 300
    can_id = draw.integers(0, 2048, n).astype(np.uint32)
    dlc = draw.integers(0, 9, n).astype(np.uint8)
    data = draw.choice(np.array([0x00, 0xFF, 0xF0, 0x0F, 0x78, 0xC3, 0x55], np.uint8), (n, 8))
    data[np.arange(8) >= dlc[:, None]] = 0
    expected = [bits_one_by_one(int(i), p[:k].tolist()) for i, k, p in zip(can_id, dlc, data, strict=True)]
    assert frame_bits(can_id, dlc, data).tolist() == expected
    eight = np.full(n, 8, np.uint8)
    expected = [bits_one_by_one(int(i), p.tolist()) for i, p in zip(can_id, data, strict=True)]
    assert frame_bits(can_id, eight, data).tolist() == expected
    assert min(expected) >= 111
    assert max(expected) <= 135


# The bus


def test_the_lowest_identifier_is_sent_next_without_interruption():
    sent = BusTime(0).carry([offer(0, 9, 4), offer(150_000, 5, 4)], SECOND)
    # The second frame of board 9 has begun at some 115 µs; board 5 overtakes the rest.
    assert (sent.can_id >> 4 & 0xF).tolist() == [9, 9, 5, 5, 5, 5, 9, 9]
    assert (np.diff(sent.t_ns) < 136_000).all()


def test_an_idle_bus_waits_for_the_next_offer():
    bus = BusTime(0)
    first = bus.carry([offer(1_000_000, 5, 2)], 2_000_000)
    second = bus.carry([offer(2_500_000, 5, 2)], 4_000_000)
    assert 1_111_000 <= first.t_ns[0] <= 1_135_000
    assert 2_611_000 <= second.t_ns[0] <= 2_635_000


def test_a_full_queue_loses_the_last_frames():
    bus = BusTime(0)
    sent = bus.carry([offer(0, 5, 40), offer(0, 5, 40, first_triangle=20)], SECOND)
    assert len(sent) == reference_insole().mtb4_queue_frames == 64
    assert bus.lost == {5: 80 - 64}


# The boards on it


def test_two_feet_send_2800_frames_per_second(ten_seconds):
    in_time = (ten_seconds.t_ns >= START_NS + SECOND) & (ten_seconds.t_ns < START_NS + 9 * SECOND)
    assert in_time.sum() / 8 == pytest.approx(5600, abs=10)
    assert len(np.unique(ten_seconds.can_id)) == 56


def test_bus_time_is_respected(ten_seconds):
    apart = np.diff(ten_seconds.t_ns)
    assert apart.min() >= FRAME_TIME_NS
    bits = frame_bits(ten_seconds.can_id, ten_seconds.dlc, ten_seconds.data)
    assert (apart >= bits[1:] * 1000).all()
    assert ten_seconds.t_ns[0] > START_NS
    assert ten_seconds.t_ns[-1] < START_NS + 10 * SECOND + 135_000


@pytest.mark.parametrize("address", [5, 6, 7, 8, 9, 10])
def test_every_tick_of_a_board_ascends_with_a_before_b(ten_seconds, address):
    mine = ten_seconds[ten_seconds.can_id >> np.uint32(4) == 0x40 | address]
    triangles = sorted(t for board, t in {**LAYOUTS[0].rows, **LAYOUTS[1].rows} if board == address)
    size = 2 * len(triangles)
    whole = len(mine) // size * size
    assert whole >= 499 * size
    assert (mine.can_id[:whole].reshape(-1, size) & 0xF == np.repeat(triangles, 2)).all()
    assert (mine.data[:whole, 0].reshape(-1, 2) == [0x40, 0xC0]).all()
    assert not mine.data[1:whole:2, 6:].any()


def test_boards_tick_at_their_period_each_with_its_own_phase(ten_seconds):
    first = {}
    for address in range(5, 11):
        triangle = min(t for board, t in {**LAYOUTS[0].rows, **LAYOUTS[1].rows} if board == address)
        mine = ten_seconds.t_ns[(ten_seconds.can_id == 0x400 | address << 4 | triangle)][::2] - START_NS
        period_ns = np.polyfit(np.arange(len(mine)), mine, 1)[0]
        assert period_ns == pytest.approx(20e6, rel=2e-4)
        first[address] = int(mine[0])
    assert np.diff(sorted(first.values())).min() > 100_000


def test_counts_reproduce_the_force(ten_seconds):
    left = LAYOUTS[0]
    total = np.zeros(400)
    for (board, triangle), _row in left.rows.items():
        mine = ten_seconds[ten_seconds.can_id == 0x400 | board << 4 | triangle]
        half_a, half_b = mine.data[::2][:400], mine.data[1::2][:400]
        counts = np.concatenate([half_a[:, 1:7], half_b[:, 1:4], half_b[:, 5:6]], axis=1).astype(float)
        total += ((240.4375 - counts) * reference_insole().pa_per_count * left.taxel_area_m2).sum(axis=1)
    expected = WALK.force_n("left", np.arange(400) * 0.02)
    assert np.corrcoef(total, expected)[0, 1] > 0.98
    assert total.mean() == pytest.approx(expected.mean(), rel=0.05)


def test_the_same_seed_gives_the_same_bytes():
    one, two, other = (emulator(seed=seed).frames(START_NS, 0.5) for seed in (7, 7, 8))
    for name in FrameBatch.__slots__:
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()
    assert one.data.tobytes() != other.data.tobytes()


def test_a_run_in_small_steps_has_the_same_frames(ten_seconds):
    run = emulator().run(START_NS)
    parts = [run.advance(START_NS + step * 7_000_000) for step in range(1, 101)]
    whole = FrameBatch.concatenate(parts)
    assert (whole.t_ns == ten_seconds.t_ns[: len(whole)]).all()
    assert (whole.can_id == ten_seconds.can_id[: len(whole)]).all()
    assert (whole.data == ten_seconds.data[: len(whole)]).all()


def test_a_period_of_50_ms_and_missing_boards_are_applied():
    batch = emulator(boards={"period_ms": 50}, left_out=[6, 9]).frames(START_NS, 2)
    boards, frames = np.unique(batch.can_id >> np.uint32(4) & 0xF, return_counts=True)
    assert boards.tolist() == [5, 7, 8, 10]
    assert frames[0] == 2 * 20 * 2 * 12
    assert len(emulator(layouts=LAYOUTS[:1]).frames(START_NS, 1)) == pytest.approx(2800, abs=40)


def test_no_bus_carries_more_than_its_bit_rate():
    run = emulator(Unloaded(LAYOUTS), boards={"period_ms": 8}).run(START_NS)
    batch = run.advance(START_NS + SECOND)
    assert 7400 < len(batch) < 9010
    assert np.diff(batch.t_ns).min() >= FRAME_TIME_NS
    assert set(run.bus.lost) == {8, 9, 10}  # the highest identifiers starve


def test_silent_boards_are_discovered_configured_and_started():
    run = emulator(Unloaded(LAYOUTS), streaming=False).run(START_NS)
    assert not len(run.advance(START_NS + SECOND))
    run.obey(commands((0x70F, b"\xff")))
    answers = run.advance(run.now_ns + 20_000_000)
    assert answers.can_id.tolist() == [0x700 | address << 4 for address in range(5, 11)]
    assert (answers.dlc == 5).all()
    run.obey(
        commands(
            (0x205, bytes([0x4D, 0, 20, 230])),
            (0x205, bytes([0x50, 4, 4, 3, 1, 0, 0x22])),
            (0x205, bytes([0x07, 0])),
        )
    )
    stream = run.advance(run.now_ns + SECOND)
    assert set(stream.can_id.tolist()) == {0x454}
    assert len(stream) == pytest.approx(100, abs=2)
    assert np.median(stream.data[::2, 1:]) in (230, 231)


# In real time


def test_played_in_real_time_and_in_order():
    sent, late_ns = [], []

    def send(batch):
        late_ns.append(time.time_ns() - int(batch.t_ns[0]))
        sent.append(batch)

    began = time.monotonic()
    count = emulator().play(send, threading.Event(), seconds=0.6)
    took = time.monotonic() - began
    batch = FrameBatch.concatenate(sent)
    assert count == len(batch)
    assert took >= 0.6
    assert np.diff(batch.t_ns).min() >= FRAME_TIME_NS
    assert min(late_ns) >= 0  # never before its time
    assert 5600 * 0.6 - 200 < count <= 5600 * 0.6


def test_play_stops_on_the_event():
    stop = threading.Event()
    player = threading.Thread(target=emulator().play, args=(lambda batch: None, stop))
    player.start()
    time.sleep(0.05)
    stop.set()
    player.join(PATIENCE_S)
    assert not player.is_alive()


def test_a_run_reports_commands_to_its_boards():
    run = emulator().run(0)
    assert run.obey(commands((0x205, [0x07, 1])))
    assert not run.obey(run.advance(100_000_000)), "their own stream, which a bus may echo, is no talk"
    assert not run.obey(FrameBatch.empty())


def test_play_obeys_received_commands():
    sent = []
    inbox = [commands((0x70F, b"\xff"))]
    player = emulator(streaming=False)
    player.play(sent.append, threading.Event(), 0.2, lambda: inbox.pop() if inbox else FrameBatch.empty())
    assert FrameBatch.concatenate(sent).can_id.tolist() == [0x700 | address << 4 for address in range(5, 11)]
