"""All randomness comes from independent streams with the stated distributions."""

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from insole_daemon.physics import draws
from insole_daemon.physics.draws import Drawn, Draws

PACKAGE = Path(draws.__file__).parents[1]
CODE = {path: path.read_text() for room in ("physics", "simulation") for path in (PACKAGE / room).rglob("*.py")}


def test_normal_numbers_are_normal_and_independent():
    numbers = Draws(1, Drawn.NOISE, 5, 0).normal(400_000)
    assert stats.kstest(numbers, "norm").pvalue > 0.01
    assert np.abs(numbers).max() > 4.3, "tails"
    assert abs(np.corrcoef(numbers[:-1], numbers[1:])[0, 1]) < 0.005
    assert abs(np.corrcoef(numbers[:-2048], numbers[2048:])[0, 1]) < 0.005, "sine and cosine of one angle"
    assert abs(np.corrcoef(numbers[:-2048] ** 2, numbers[2048:] ** 2)[0, 1]) < 0.006


def test_uniform_numbers_are_uniform():
    numbers = Draws(1, Drawn.FAULT, 5, 0).uniform(100_000)
    assert stats.kstest(numbers, "uniform").pvalue > 0.01
    assert (numbers >= 0).all()
    assert (numbers < 1).all()


def test_the_size_of_requests_does_not_change_the_numbers():
    whole = Draws(3, Drawn.NOISE, 5, 0).normal(9000)
    parts = Draws(3, Drawn.NOISE, 5, 0)
    sizes = [1, 0, 4095, 1, 1, 4097, 805]
    assert (np.concatenate([parts.normal(n) for n in sizes]) == whole).all()
    assert (Draws(3, Drawn.NOISE, 5, 0).normal(3, 5) == whole[:15].reshape(3, 5)).all()


def test_every_stream_key_and_seed_gives_other_numbers():
    keys = [(0, stream, board) for stream in Drawn for board in (5, 6)]
    keys += [(0, Drawn.NOISE, 5, 0), (0, Drawn.NOISE, 5, 1), (1, Drawn.NOISE, 5), (2**32, Drawn.NOISE, 5)]
    assert len({Draws(seed, stream, *key).uniform(1)[0] for seed, stream, *key in keys}) == len(keys)


def test_numbers_are_the_same_on_every_machine():
    """numpy guarantees PCG64 and SeedSequence; IEEE 754 guarantees what is computed from their bits."""
    numbers = Draws(7, Drawn.NOISE, 5, 0).normal(10_000)
    assert hashlib.sha256(numbers.astype("<f8").tobytes()).hexdigest()[:16] == "c331636f7c659265"


def test_no_other_module_draws_random_numbers():
    """Only `random_faults`, for tests, takes a generator."""
    for path, text in CODE.items():
        if path.name not in ("draws.py", "random_faults.py"):
            assert not re.search(r"np\.random|import random|default_rng", text), path.name


@pytest.mark.parametrize("stream", Drawn)
def test_every_stream_is_documented_and_used(stream):
    assert f"    {stream.name} " in draws.__doc__
    assert any(f"Drawn.{stream.name}" in text for path, text in CODE.items() if path.name != "draws.py")
