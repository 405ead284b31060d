"""One emulated board: its digitiser, stream and commands, compared with the firmware."""

import numpy as np
import pytest

from insole_daemon.physics.digitiser import digitise, low_bytes
from insole_daemon.simulation.board import EmulatedBoard
from insole_daemon.simulation.commands import obey
from insole_daemon.simulation.halves import halves
from insole_daemon.simulation.reference_insole import reference_insole

TRIANGLES = (0, 3, 7)
NOTHING = np.zeros((3, 12))
SECOND = 1_000_000_000


def made(**settings):
    return EmulatedBoard(5, TRIANGLES, **{"period_ms": 20, "shift": 3, "no_load": 240, **settings})


def counts_of(payloads):
    """Return (…, n_triangles, 12) counts of payloads (…, 2 · n_triangles, 8)."""
    pairs = payloads.reshape(*payloads.shape[:-2], -1, 2, 8)
    return np.concatenate([pairs[..., 0, 1:8], pairs[..., 1, 1:6]], axis=-1)


# Worked by hand from the rules in the firmware: value, no_load, shift, count, flag.
RULES = [
    (0, 240, 2, 240, False),
    (1, 240, 2, 240, False),  # a floor: less than a whole count changes nothing
    (3, 240, 2, 240, False),
    (4, 240, 2, 239, False),
    (-1, 240, 2, 241, False),  # but any code below the baseline is a count
    (-4, 240, 2, 241, False),
    (-5, 240, 2, 242, False),
    (-59, 240, 2, 255, False),  # floor(−59/4) = −15
    (-60, 240, 2, 255, False),  # −(15 << 2): pinned
    (-119, 240, 2, 255, False),
    (-120, 240, 2, 255, True),  # −2·(15 << 2)
    (956, 240, 2, 1, False),
    (959, 240, 2, 1, False),
    (960, 240, 2, 0, False),  # 240 << 2: pinned
    (1919, 240, 2, 0, False),
    (1920, 240, 2, 0, True),  # 2·(240 << 2)
    (1919, 240, 3, 1, False),
    (1920, 240, 3, 0, False),
    (-120, 240, 3, 255, False),
    (-112, 240, 3, 254, False),
    (979, 245, 2, 1, False),
    (980, 245, 2, 0, False),
    (-40, 245, 2, 255, False),
    (-36, 245, 2, 254, False),
    (31359, 245, 7, 1, False),
    (31360, 245, 7, 0, False),
    (62720, 245, 7, 0, True),
    (-1280, 245, 7, 255, False),
    (-2560, 245, 7, 255, True),
    (0, 255, 3, 255, True),  # no_load 0xFF has no room below: flagged at rest
    (1, 255, 3, 255, False),
    (8, 255, 3, 254, False),
    (2040, 255, 3, 0, False),
    (4079, 255, 3, 0, False),
    (4080, 255, 3, 0, True),
    (5, 240, 0, 235, False),
    (-1, 240, 0, 241, False),
    (240, 240, 0, 0, False),
]


@pytest.mark.parametrize(("value", "no_load", "shift", "count", "flag"), RULES)
def test_counts_equal_the_firmware_arithmetic(value, no_load, shift, count, flag):
    baseline16 = np.full((1, 12), 20_000)
    raw16 = baseline16.copy()
    raw16[0, 4] += value
    if no_load == 255:
        raw16[0, [k for k in range(12) if k != 4]] += 1  # else every taxel at rest is flagged
    counts, status = digitise(raw16, baseline16, no_load, np.array([[shift]]))
    assert counts[0, 4] == count
    assert status[0] == (1 << 8 if flag else 0)


def test_status_word_has_one_flag_per_taxel_and_the_error_code():
    baseline16 = np.full((14, 12), 20_000)
    raw16 = baseline16.copy()
    raw16[np.arange(12), np.arange(12)] += 5000
    raw16[12] = 0xFFFF
    raw16[13, 2] = 0
    counts, status = digitise(raw16, baseline16, 240, np.array([[2]]))
    assert status[:12].tolist() == [1 << 4 + k for k in range(12)]
    assert status[12] == 0xFFF2  # came loose after the baseline: reads as full load
    assert not counts[12].any()
    assert status[13] == 1 << 6 | 1


def test_halves_have_the_bytes_of_the_protocol():
    counts = np.array([[0xF0, 0xF0, 0xEE, 0xF0, 0xF1, 0xEF, 0xF0, 0xF0, 0xEF, 0xF0, 0xF0, 0xF0]], np.uint8)
    half_a, half_b = halves(counts, np.array([0xA5C2], np.uint16))[0]
    assert half_a.tobytes().hex() == "40f0f0eef0f1eff0"
    assert half_b.tobytes().hex() == "c0f0eff0f0f0a5c2"


def test_raw_test_mode_sends_the_low_bytes():
    counts, status = low_bytes(np.array([[0x1234] * 12]))
    assert (counts == 0x34).all()
    assert not status.any()
    raw = counts_of(made(skin_type=7).halves(np.zeros((100, 3, 12))))
    assert raw.std() > 30


def test_triangles_ascend_with_half_a_before_b():
    board = made()
    payloads = board.halves(np.zeros((2, 3, 12)))
    assert board.can_ids.tolist() == [0x450, 0x450, 0x453, 0x453, 0x457, 0x457]
    assert payloads.shape == (2, 6, 8)
    assert payloads[..., 0].tolist() == [[0x40, 0xC0] * 3] * 2
    assert not payloads[:, 1::2, 6:].any()


@pytest.mark.parametrize("shift", [0, 3, 6])
def test_mean_counts_follow_the_nominal_line_with_noise_and_spread(shift):
    board = made(shift=shift)
    n = 2000
    pressure_pa = np.repeat([0.0, 200e3], n)[:, None, None] * np.ones((3, 12))
    counts = counts_of(board.halves(pressure_pa)).astype(float)
    rest, loaded = counts[:n].mean(axis=0), counts[n:].mean(axis=0)
    assert rest.mean() == pytest.approx(240 + (1 - 2.0**-shift) / 2, abs=0.05)
    pressure_taxels = [0, 1, 2, 3, 4, 5, 7, 8, 9, 11]
    assert 1.0 <= counts[:n].std(axis=0)[:, pressure_taxels].mean() < 1.1, "never below that of the real insole"
    activation = (rest - loaded)[:, pressure_taxels]
    assert activation.mean() == pytest.approx(200e3 / reference_insole().pa_per_count, rel=0.08)
    assert 0.1 < activation.std() / activation.mean() < 0.22
    assert abs((rest - loaded)[:, [6, 10]]).max() < 0.2  # thermal pads


def test_the_same_seed_gives_the_same_board():
    pressure_pa = np.full((3, 3, 12), 50e3)
    assert (made(seed=1).halves(pressure_pa) == made(seed=1).halves(pressure_pa)).all()
    assert (made(seed=1).halves(pressure_pa) != made(seed=2).halves(pressure_pa)).any()


def test_a_stream_in_pieces_equals_the_whole_stream():
    pressure_pa = np.full((7, 3, 12), 50e3)
    whole, parts = made(), made()
    assert (whole.halves(pressure_pa)[3:] == [parts.halves(pressure_pa[:3]), parts.halves(pressure_pa[3:])][1]).all()


# Commands


def ticks_of(board, t_ns=0, seconds=1):
    return len(board.ticks(t_ns + seconds * SECOND))


def test_silent_after_power_up_until_started():
    board = made(streaming=False)
    board.power_up(0)
    assert ticks_of(board) == 0
    obey(board, 0x205, bytes.fromhex("4D003204"), 0, NOTHING)
    assert ticks_of(board) == 0
    obey(board, 0x205, bytes([0x07, 0]), 0, NOTHING)
    assert ticks_of(board) == 19  # the first after a whole period of 50 ms
    assert not len(board.can_ids)


def test_a_session_of_the_official_host_starts_the_stream():
    board = made(streaming=False)
    for payload in ("4D0032F5", "50000F02000022", "50000102010022", "0700"):
        assert obey(board, 0x205, bytes.fromhex(payload), 0, NOTHING) is None
    assert board.can_ids.tolist() == [0x450, 0x450, 0x451, 0x451]
    counts = counts_of(board.halves(np.zeros((500, 3, 12))))
    assert abs(counts[:, 0].mean() - 245.4) < 0.7  # of 8/4 of the noise it was made with, zeroed at one reading
    assert (counts[:, 1] == 245).all()  # no sensor there: open since before the baseline
    assert board.halves(np.zeros((1, 3, 12)))[0, 3, 7] == 2


def test_board_configuration_disables_and_sets_the_period():
    board = made()
    board.power_up(0)
    obey(board, 0x20F, bytes([0x4D, 0, 50, 200]), 0, NOTHING)
    assert board.no_load == 200
    assert not len(board.can_ids)
    assert ticks_of(board) == 19


def test_triangle_configuration_stops_and_zeroes_under_load():
    board = made()
    board.power_up(0)
    load = np.full((3, 12), 100e3)
    obey(board, 0x205, bytes([0x50, 3, 7, 4, 1, 0, 0x22]), 0, load)
    assert ticks_of(board) == 0
    obey(board, 0x205, bytes([0x07, 0]), 0, load)
    assert ticks_of(board) == 49
    # 4..6 have been enabled too, although there is nothing.
    assert sorted({can_id & 0xF for can_id in board.can_ids.tolist()}) == [0, 3, 4, 5, 6, 7]
    counts = counts_of(board.halves(np.repeat([load, NOTHING], 400, axis=0))).astype(float)
    rest = counts[:400].mean(axis=0)[[0, 1, 5]]
    unloaded = counts[400:].mean(axis=0)[[0, 1, 5]]
    assert rest.mean() == pytest.approx(240.4, abs=0.5)  # the load is the new zero, and the floor shows
    assert unloaded[0, 0] == pytest.approx(rest[0, 0] + 12.5, abs=1.2)
    assert unloaded[1, 0] == pytest.approx(rest[1, 0] + 6.25, abs=1.2)  # a count is twice as wide at shift 4


@pytest.mark.parametrize(
    "payload",
    [
        [],
        [0x50, 5, 3, 2, 1, 0, 0x22],
        [0x50, 0, 16, 2, 1, 0, 0x22],
        [0x50, 0, 15],
        [0x4D, 0, 50],
        [0x07],
        [0x33, 1],
    ],
)
def test_invalid_commands_are_ignored(payload):
    board = made()
    board.power_up(0)
    assert obey(board, 0x205, bytes(payload), 0, NOTHING) is None
    assert len(board.can_ids) == 6
    assert board.no_load == 240
    assert ticks_of(board) == 50


def test_a_stopped_stream_restarts():
    board = made()
    board.power_up(0)
    obey(board, 0x205, bytes([0x07, 1]), 0, NOTHING)
    assert ticks_of(board) == 0
    obey(board, 0x206, bytes([0x07, 0]), 0, NOTHING)  # another board's
    assert ticks_of(board) == 0
    obey(board, 0x205, bytes([0x87, 0]), SECOND, NOTHING)  # bit 7 of a command is not looked at
    assert ticks_of(board, SECOND) == 49


def test_discovery_and_version_are_answered():
    board = made(streaming=False)
    assert obey(board, 0x70F, b"\xff", 0, NOTHING) == (0x750, bytes([0xFF, 11, 1, 25, 0]))
    assert obey(board, 0x205, bytes([0x1C, 2, 0]), 0, NOTHING) == (
        0x250,
        bytes([0x1C, 11, 1, 25, 0, 2, 0, 1]),
    )
    _, wrong_major = obey(board, 0x215, bytes([0x1C, 1, 0]), 0, NOTHING)
    assert wrong_major[-1] == 0
    assert obey(board, 0x700, b"\xff", 0, NOTHING) is None
    assert not board.zeroed
