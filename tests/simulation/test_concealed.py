"""Trials in which something is concealed."""

from __future__ import annotations

import pytest

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.physics.draws import Drawn, Draws
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.concealed import NOTHING, choices, conceal, drawn

CONFIG = Config()
LAYOUT = load_layout(CONFIG.insoles[0])


@pytest.mark.parametrize("word", ["hysteresis", NOTHING])
def test_the_folder_does_not_tell_what_is_concealed_in_it(tmp_path, word):
    shares: list[float] = []
    hidden = conceal(word, tmp_path / "trial", CONFIG, LAYOUT, 5, shares.append)
    assert str(hidden).startswith(word)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1, abs=0.01)
    for path in (tmp_path / "trial").iterdir():
        assert word.encode() not in path.read_bytes()
    recording = insole_daemon.load(tmp_path / "trial")
    assert recording.kind == "chamber"
    assert recording["left"].calibration.effects == ()


@pytest.mark.parametrize("word", [word for word in choices() if word != NOTHING])
def test_every_effect_is_one_that_the_physics_knows(word):
    found = [drawn(word, LAYOUT, Draws(seed, Drawn.CONCEALED)) for seed in range(12)]
    assert {each.law.word for each in found} == {word}
    assert len({each.where for each in found}) in (1, 3)  # all of it, or one of three boards
