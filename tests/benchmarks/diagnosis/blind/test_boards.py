"""Files of the emulated boards, read back with a few lines of plain Python."""

import gzip

import numpy as np
import pytest

from benchmarks.diagnosis.blind import boards
from benchmarks.diagnosis.blind.boards import (
    Readings,
    Sent,
    Timing,
    draw_conversion_noise,
    draw_readings,
    host_rows,
    write_candump,
)
from benchmarks.diagnosis.blind.chamber import chamber
from benchmarks.diagnosis.blind.effect import conceal
from benchmarks.diagnosis.blind.geometry import PRESSURE_TAXELS, build_insole
from benchmarks.diagnosis.blind.sensor import digitise, draw_sensors
from benchmarks.diagnosis.blind.signal_path import Signal


def sent(rng, board: Readings) -> Sent:
    """Random bytes on every tick of a board, nothing lost."""
    shape = board.sent_s.shape
    values = rng.integers(0, 256, (*shape, 12), np.uint8)
    return Sent(board, values, np.zeros(shape, np.uint8), np.ones((*shape, 2), bool))


@pytest.mark.parametrize("b_first", [False, True])
def test_candump_holds_the_bytes(tmp_path, b_first):
    rng = np.random.default_rng(1)
    geometry = build_insole("right", 8)
    boards_sent = [sent(rng, board) for board in draw_readings(rng, geometry, Timing((10, 50, 20), 0.0, b_first), 2.0)]
    boards_sent[2].status[3, 7] = 2
    boards_sent[0].is_kept[5, 0, 1] = False
    write_candump(tmp_path / "can.log.gz", geometry, boards_sent, 1_650_000_000, b_first)
    lines = gzip.decompress((tmp_path / "can.log.gz").read_bytes()).decode().splitlines()
    assert len(lines) == sum(board.is_kept.sum() for board in boards_sent)
    times = [float(line[1 : line.index(")")]) for line in lines]
    assert times == sorted(times)
    triangle = boards_sent[2].readings.triangles[7]
    name = f"{0x400 | int(geometry.address[triangle]) << 4 | int(geometry.slot[triangle]):03X}"
    sent_frames = [
        (t, bytes.fromhex(line.split("#")[1])) for t, line in zip(times, lines, strict=True) if f" {name}#" in line
    ]
    halves = [h for _, h in sent_frames]
    assert (halves[0][0] == 0xC0) == b_first
    half_a = np.array([list(h[1:8]) for h in halves if h[0] == 0x40])
    half_b = np.array([list(h[1:6]) for h in halves if h[0] == 0xC0])
    assert np.array_equal(np.concatenate([half_a, half_b], 1), boards_sent[2].values[:, 7])
    assert [h[7] for h in halves if h[0] == 0xC0][3] == 2
    assert np.diff([t for t, h in sent_frames if h[0] == 0x40]) == pytest.approx(0.02, abs=5e-4)


def test_a_slow_converter_repeats_its_value_and_its_noise():
    rng = np.random.default_rng(2)
    board = draw_readings(rng, build_insole("left", 5), Timing((10, 10, 10), 0.0369, False), 5.0)[0]
    age = board.sent_s - board.converted_s
    assert age.min() >= 0
    assert age.max() < 0.0371
    noise = draw_conversion_noise(rng, board)
    same = np.diff(board.conversion, axis=0) == 0
    assert 0.6 < same.mean() < 0.8
    assert np.array_equal((np.diff(noise, axis=0) == 0).all(-1), same)


def test_rows_hold_the_newest_bytes():
    rng = np.random.default_rng(3)
    boards_sent = [
        sent(rng, board) for board in draw_readings(rng, build_insole("left", 5), Timing((50, 50, 50), 0.0, False), 3.0)
    ]
    seconds, counts = host_rows(boards_sent, 0.02, 2.5)
    board = boards_sent[1]
    for row in (3, 40, 100):
        newest = np.flatnonzero(board.readings.sent_s[:, 2] < seconds[row])[-1]
        assert np.array_equal(counts[row, board.readings.triangles[2]], board.values[newest, 2])


@pytest.mark.parametrize("word", ["", "bit_shift"])
def test_the_mean_is_the_mean_of_the_bytes(word):
    rng = np.random.default_rng(2)
    geometry, insole_sensors, trial = build_insole("left", 5), draw_sensors(rng), chamber(rng, "sine")
    effects = (conceal(rng, geometry, trial, word, "board").with_amplitude(1.0),) if word else ()
    mean = Signal(trial, geometry.taxel_mm, insole_sensors, effects, np.arange(336)).mean(np.array([2.0]))
    mean = np.repeat(mean.reshape(1, 28, 12), 3000, 0)
    step = np.zeros(28, np.int64)
    for effect in effects:
        step[effect.place.any(1)] = effect.shape["step"]
    noise = rng.standard_normal(mean.shape, np.float32) * insole_sensors.noise
    digitised = digitise(mean, noise, insole_sensors, step).mean(0)[:, PRESSURE_TAXELS]
    expected = mean[0][:, PRESSURE_TAXELS]
    is_unclipped = (expected > 8) & (expected < 247)
    assert is_unclipped.sum() > 150
    assert digitised[is_unclipped] == pytest.approx(expected[is_unclipped], abs=0.2)


def test_every_period_and_kind_of_converter_is_drawn():
    rng = np.random.default_rng(4)
    timings = [boards.draw_timing(rng, steady=False) for _ in range(300)]
    assert {p for t in timings for p in t.period_ms} == {10, 20, 37, 50}
    assert any(len(set(t.period_ms)) > 1 for t in timings)
    assert any(t.conversion_s for t in timings)
    assert not any(boards.draw_timing(rng, steady=True).conversion_s for _ in range(100))
