"""Trials with a concealed effect."""

from __future__ import annotations

import numpy as np
import pytest

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.errors import SimulationError
from insole_daemon.physics.draws import Drawn, Draws
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.concealed import NOTHING, TRIALS, conceal, draw_effect, list_words, trials_that_show

CONFIG = Config()
LAYOUT = load_layout(CONFIG.insoles[0])
# Of formats.md, but for `unknown`, which is what none of them is.
VOCABULARY = {
    "map_transform", "swapped_triangles", "preload", "crosstalk", "hysteresis", "snap", "viscoelasticity", "creep",
    "lag", "stiffening", "gain", "baseline", "temperature", "drift", "rezero", "bit_shift", "delay", "clock",
    "dead_taxels", "open_triangle", "noise_burst", "frame_loss", "reference_fault",
}  # fmt: skip


@pytest.mark.parametrize(
    ("word", "trial"),
    [("hysteresis", "chamber"), (NOTHING, "chamber"), ("preload", "walk"), ("dead_taxels", "walk")],
)
def test_folder_contains_no_trace_of_the_concealed_effect(tmp_path, word, trial):
    shares: list[float] = []
    hidden = conceal(word, tmp_path / "trial", CONFIG, LAYOUT, 5, shares.append, trial=trial)
    assert str(hidden).startswith(word)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1, abs=0.01)
    for path in (tmp_path / "trial").iterdir():
        assert word.encode() not in path.read_bytes()
    recording = insole_daemon.load(tmp_path / "trial")
    assert recording.kind == ("chamber" if trial == "chamber" else "shoe")
    assert recording["left"].calibration.effects == ()


def test_every_word_of_the_vocabulary_can_be_concealed_somewhere():
    assert {word for trial in TRIALS for word in list_words(trial)} == VOCABULARY | {NOTHING}
    assert set(list_words("walk")) == VOCABULARY | {NOTHING}
    assert trials_that_show("gain") == ("chamber", "walk")
    assert trials_that_show("preload") == ("walk",)


@pytest.mark.parametrize("trial", TRIALS)
def test_every_word_is_an_effect_that_the_physics_knows_or_a_fault_at_a_drawn_place(trial):
    for word in list_words(trial):
        drawn = [draw_effect(word, LAYOUT, Draws(seed, Drawn.CONCEALED), trial) for seed in range(12)]
        assert {concealed.word for concealed in drawn} == {word}
        assert len({str(concealed) for concealed in drawn}) > 1 or word in (NOTHING, "bit_shift")
        boards = {concealed.effect.where for concealed in drawn if concealed.effect is not None}
        assert len(boards) in (0, 1, 3) or word == "swapped_triangles"  # all of it, or one of three boards


def test_a_reference_that_is_off_steps_in_the_middle_of_the_trial(tmp_path):
    sound, off = (
        conceal(word, tmp_path / word, CONFIG, LAYOUT, 5, trial="walk") for word in (NOTHING, "reference_fault")
    )
    values = [insole_daemon.load(tmp_path / concealed.word)["left"].reference["fz_n"] for concealed in (sound, off)]
    step = values[1] - values[0]
    half = len(step) // 2
    assert np.abs(step[:half]).max() == 0.0
    np.testing.assert_allclose(step[half:], off.step[1])


def test_another_take_is_the_same_insole_with_other_noise(tmp_path):
    one, other = (conceal("gain", tmp_path / str(take), CONFIG, LAYOUT, 5, trial="walk", take=take) for take in (0, 1))
    assert str(one) == str(other)
    first, second = (insole_daemon.load(tmp_path / str(take))["left"] for take in (0, 1))
    assert not np.array_equal(first.counts, second.counts)
    assert np.abs(first.counts.astype(float) - second.counts)[:500].mean() < 3.0


def test_a_word_that_such_a_trial_cannot_show_is_refused_with_the_trial_that_can(tmp_path):
    with pytest.raises(SimulationError, match="a chamber can show .* found 'preload'; conceal it in a walk"):
        conceal("preload", tmp_path / "trial", CONFIG, LAYOUT, 5)
    assert not (tmp_path / "trial").exists()
