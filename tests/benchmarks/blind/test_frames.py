"""What is written is what was meant, read by the plainest program there is."""

import gzip

import numpy as np
import pytest

from benchmarks.blind.chain import chain
from benchmarks.blind.effect import conceal
from benchmarks.blind.frames import can_log, digitise, sample_times
from benchmarks.blind.geometry import PRESSURE_TAXELS, insole
from benchmarks.blind.loads import chamber
from benchmarks.blind.sensor import sensors


def test_candump_holds_the_bytes(tmp_path):
    rng = np.random.default_rng(1)
    geometry = insole("right", 8)
    seconds = sample_times(rng, geometry, 1.0)
    values = rng.integers(0, 256, (len(seconds), 28, 12), np.uint8)
    status = np.zeros((len(seconds), 28), np.uint8)
    status[3, 7] = 2
    kept = np.ones((len(seconds), 28, 2), bool)
    kept[5, 0, 1] = False
    stamps = 1_650_000_000_000_000 + np.rint(seconds * 1e6).astype(np.int64)
    can_log(tmp_path / "can.log.gz", geometry, stamps, values, status, kept)
    lines = gzip.decompress((tmp_path / "can.log.gz").read_bytes()).decode().splitlines()
    assert len(lines) == kept.sum()
    times = [float(line[1 : line.index(")")]) for line in lines]
    assert times == sorted(times)
    of_one = f"{0x400 | int(geometry.address[7]) << 4 | int(geometry.slot[7]):03X}"
    halves = [bytes.fromhex(line.split("#")[1]) for line in lines if f" {of_one}#" in line]
    a = np.array([list(h[1:8]) for h in halves if h[0] == 0x40])
    b = np.array([list(h[1:6]) for h in halves if h[0] == 0xC0])
    assert np.array_equal(np.concatenate([a, b], 1), values[:, 7])
    assert [h[7] for h in halves if h[0] == 0xC0][3] == 2


@pytest.mark.parametrize("word", ["", "bit_shift"])
def test_the_mean_is_the_mean_of_the_bytes(word):
    rng = np.random.default_rng(2)
    geometry, these, load = insole("left", 5), sensors(rng), chamber(rng, "sine", "plenum")
    effects = (conceal(rng, geometry, load, word, "board"),) if word else ()
    seconds = np.repeat(np.full(3000, 2.0)[:, None], 28, 1)
    mean = chain(load, these, effects).mean_byte(seconds)
    step = np.zeros(28, np.int64)
    for e in effects:
        step[e.place.any(1)] = e.shape["step"]
    got = digitise(rng, mean, np.ones_like(mean), these, step).mean(0)[:, PRESSURE_TAXELS]
    wanted = mean[0][:, PRESSURE_TAXELS]
    inside = (wanted > 8) & (wanted < 247)
    assert inside.sum() > 150
    assert got[inside] == pytest.approx(wanted[inside], abs=0.2)
