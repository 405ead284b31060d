"""Repeated readings of a slow converter, which are regular, and repeated frames, which are not."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import insole_daemon
from benchmarks.diagnosis.mutated_recordings import simulate
from insole_daemon.diagnosis.observations.grid_readings import read_rows
from insole_daemon.diagnosis.observations.readings import TriangleReadings, _without_repeats, read_triangles
from insole_daemon.errors import DiagnosisError

SENT_S = 0.02


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate(tmp_path_factory.mktemp("simulated"))[1] / "recording"


@pytest.fixture
def folder(simulated: Path, tmp_path: Path) -> Path:
    """A simulated recording of which the test may change the log."""
    return shutil.copytree(simulated, tmp_path / "recording")


def held(number: np.ndarray) -> TriangleReadings:
    """Return readings sent every 20 ms; those with the same `number` (k,) are equal."""
    rng = np.random.default_rng(1)
    t_s = np.arange(len(number)) * SENT_S
    load = 40.0 * np.sin(2.0 * t_s[np.searchsorted(number, number)])[:, None]
    counts = np.rint(200.0 + load + rng.normal(0.0, 1.0, (number.max() + 1, 12))[number])
    return TriangleReadings(t_s, counts, np.ones(counts.shape, bool), SENT_S)


@pytest.mark.parametrize("conversion_s", [0.03, 0.037, 0.05])
def test_conversions_of_a_slow_converter_get_regular_times(conversion_s):
    number = np.floor(np.arange(3000) * SENT_S / conversion_s).astype(int)
    found = _without_repeats(held(number))
    assert found.is_converter_slow
    assert found.period_s == pytest.approx(conversion_s, rel=0.02)
    converted_s = np.round(found.t_s / conversion_s) * conversion_s
    late_s = found.t_s - converted_s
    assert np.std(late_s[60:-60]) < 0.002


def test_taxels_at_the_end_of_their_range_do_not_hide_repeats():
    number = np.floor(np.arange(3000) * SENT_S / 0.037).astype(int)
    readings = held(number)
    readings.counts[:, :2] = np.maximum(readings.counts[:, :2] - 230.0, 0.0)  # at 0 for a part of the time
    readings.counts[500:600] = 0.0  # all of them
    found = _without_repeats(readings)
    converted_s = np.round(found.t_s / 0.037) * 0.037
    assert np.std((found.t_s - converted_s)[60:-60]) < 0.002


def test_repeated_frames_are_no_slow_converter():
    repeats = np.random.default_rng(2).random(3000) < 0.3
    found = _without_repeats(held(np.cumsum(~repeats)))
    assert not found.is_converter_slow
    assert found.held_fraction == pytest.approx(0.3, abs=0.03)
    assert np.allclose(found.t_s / SENT_S, np.round(found.t_s / SENT_S))


def test_two_of_few_readings_that_are_equal_by_chance_are_no_repeats():
    """While the load changes for a second, two equal readings are three per cent of them."""
    number = np.arange(3000)
    readings = held(number)
    moves = (readings.t_s > 20.0) & (readings.t_s < 21.0)
    rng = np.random.default_rng(3)
    noise = rng.normal(0.0, np.where(moves, 2.0, 0.5)[:, None], readings.counts.shape)
    load = np.where(moves, 15.0 * np.sin(2.0 * np.pi * readings.t_s), 0.0)[:, None]
    counts = np.rint(200.3 + load + noise)
    first = int(np.argmax(moves))
    for equal in (first + 12, first + 37):
        counts[equal] = counts[equal - 1]
    assert len(_without_repeats(replace(readings, counts=counts)).t_s) == len(number)


@pytest.mark.parametrize("n", range(1, 8))
def test_a_triangle_that_sent_a_few_readings_keeps_them(n):
    found = _without_repeats(held(np.arange(n)))
    assert len(found.t_s) == n


def test_a_log_that_was_joined_from_those_of_two_interfaces_gives_the_same_readings(folder: Path) -> None:
    log = folder / "can.log"
    lines = log.read_text().splitlines(keepends=True)

    def readings() -> list[TriangleReadings]:
        recording = insole_daemon.load(folder)
        return read_triangles(recording, recording.feet[0])

    in_order = readings()
    middle = sorted(lines[100:-100], key=lambda line: line.split()[2].startswith("45"))  # board 5 after the others
    assert middle != lines[100:-100]
    log.write_text("".join([*lines[:100], *middle, *lines[-100:]]))
    for one, other in zip(in_order, readings(), strict=True):
        assert np.array_equal(one.t_s, other.t_s)
        assert np.array_equal(one.counts, other.counts)


def test_conversions_at_a_multiple_of_the_boards_period_may_be_a_period_older():
    found = _without_repeats(held(np.arange(3000) // 2))
    assert found.is_converter_slow
    assert np.allclose(found.t_s, np.arange(1500) * 2 * SENT_S, atol=1e-3)
    assert found.latest_s == pytest.approx(SENT_S, rel=0.01)


def test_the_age_of_conversions_is_known_if_their_waiting_times_vary():
    number = np.floor(np.arange(3000) * SENT_S / 0.037).astype(int)
    assert _without_repeats(held(number)).latest_s < 0.1 * SENT_S


@pytest.mark.parametrize(("n_frames", "said"), [(1, "no triangle of the left foot"), (1000, "cover 0.1")])
def test_a_log_with_hardly_a_reading_is_refused(folder: Path, n_frames: int, said: str) -> None:
    log = folder / "can.log"
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:n_frames]))
    recording = insole_daemon.load(folder)
    foot = recording.feet[0]
    assert foot.calibration is not None
    with pytest.raises(DiagnosisError, match=said):
        read_rows(recording, foot, foot.calibration, np.median)


def test_a_log_whose_times_are_not_in_seconds_is_refused(folder: Path) -> None:
    log = folder / "can.log"
    lines = [line.partition(") ") for line in log.read_text().splitlines()]
    began_s = float(lines[0][0][1:])
    log.write_text("".join(f"({began_s + 1e3 * (float(t[1:]) - began_s):.6f}) {frame}\n" for t, _, frame in lines))
    recording = insole_daemon.load(folder)
    foot = recording.feet[0]
    assert foot.calibration is not None
    with pytest.raises(DiagnosisError, match="every 20 s"):
        read_rows(recording, foot, foot.calibration, np.median)
