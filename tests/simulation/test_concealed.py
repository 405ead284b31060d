"""Trials with a concealed effect."""

from __future__ import annotations

import pytest

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.physics.draws import Drawn, Draws
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.concealed import NOTHING, conceal, draw_effect, list_words

CONFIG = Config()
LAYOUT = load_layout(CONFIG.insoles[0])


@pytest.mark.parametrize("word", ["hysteresis", NOTHING])
def test_the_recording_does_not_name_the_concealed_effect(tmp_path, word):
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


@pytest.mark.parametrize("word", [word for word in list_words() if word != NOTHING])
def test_every_concealed_effect_is_a_known_law(word):
    effects = [draw_effect(word, LAYOUT, Draws(seed, Drawn.CONCEALED)) for seed in range(12)]
    assert {effect.law.word for effect in effects} == {word}
    assert len({effect.where for effect in effects}) in (1, 3)  # all of it, or one of three boards
