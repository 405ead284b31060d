"""Terms that are removed because they may describe the residual of the whole set."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.backward_elimination import insignificant_word, term_with_gains_elsewhere
from insole_daemon.diagnosis.load_estimate import KnownLoad
from insole_daemon.diagnosis.model.blocks import BlockDesign, block_design
from insole_daemon.diagnosis.model.refine import refine
from insole_daemon.diagnosis.observing import observed

from .chamber import write

MEMORY, DRIFT = "viscoelasticity", "drift"
MEMORY_SHARE = 0.3


@pytest.fixture(scope="module")
def design(tmp_path_factory) -> BlockDesign:
    recording = insole_daemon.load(write(tmp_path_factory.mktemp("chamber") / "bag", seconds=60.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    return block_design(KnownLoad(seen), seen.weight_variance**-0.5)


def doubtful(design: BlockDesign, drift: float, misfit: float) -> str | None:
    """Return the word left out of {memory, drift} where rows have both, and a ripple of 3 Hz that neither describes.

    `drift` and `misfit`: root mean square of the drift and of the ripple, in standard deviations of the rows' noise.
    """
    numbers = {
        word: max(k for k, c in enumerate(design.candidates) if c.word == word and c.where.scope == "insole")
        for word in (MEMORY, DRIFT)
    }
    columns = {word: design.rows_of(design.candidates[k].columns[-1:])[:, 0] for word, k in numbers.items()}
    y = np.random.default_rng(1).normal(size=design.y.shape) * (design.weights.T > 0)
    y += MEMORY_SHARE * columns[MEMORY] + drift * columns[DRIFT] / np.sqrt(np.mean(columns[DRIFT] ** 2))
    y += misfit * np.sqrt(2.0) * np.sin(2 * np.pi * 3.0 * design.seen.t_s)
    rows = replace(design, y=y)
    return insignificant_word(rows, refine(rows, tuple(sorted(numbers.values()))))


def words_that_stay(design: BlockDesign, elsewhere: float) -> list[str]:
    """Return the words that stay of {memory, drift of one triangle}; its own drift is four standard deviations.

    `elsewhere`: root mean square of the drift in all other triangles, in standard deviations of the rows' noise.
    """
    memory = max(k for k, c in enumerate(design.candidates) if c.word == MEMORY and c.where.scope == "insole")
    drift = next(k for k, c in enumerate(design.candidates) if c.word == DRIFT and c.where.scope == "triangle")
    own = design.mask[design.candidates[drift].columns[0]]
    shape = design.rows_of(design.candidates[memory].columns[-1:])[:, 0]
    slope = np.linspace(-1.0, 1.0, design.y.shape[1]) * np.sqrt(3.0)
    y = np.random.default_rng(1).normal(size=design.y.shape) * (design.weights.T > 0)
    y += MEMORY_SHARE * shape + np.where(own, 4.0, elsewhere)[:, None] * slope * (design.weights.T > 0)
    refined = refine(replace(design, y=y), tuple(sorted((memory, drift))))
    place = term_with_gains_elsewhere(refined)
    return [term.word for i, term in enumerate(refined.design.candidates) if i != place]


def test_a_drift_of_one_triangle_that_others_have_too_is_removed(design):
    assert words_that_stay(design, elsewhere=1.5) == [MEMORY]


def test_a_drift_of_one_triangle_alone_is_kept(design):
    assert sorted(words_that_stay(design, elsewhere=0.0)) == [DRIFT, MEMORY]


def test_a_gain_of_one_triangle_alone_is_kept_at_its_fitted_size(design):
    """The fit computes the column of the gain again at its size; the comparison needs it in all other triangles."""
    numbers = [k for k, c in enumerate(design.candidates) if c.word == "gain" and c.where.scope == "triangle"]
    column = design.rows_of(design.candidates[numbers[3]].columns)[:, 0]
    y = np.random.default_rng(1).normal(size=design.y.shape) * (design.weights.T > 0) - 0.3 * column
    refined = refine(replace(design, y=y), (numbers[3],))
    assert refined.design.candidates[0].settings[0]["more"] != 0.0
    assert term_with_gains_elsewhere(refined) is None


def test_the_gains_elsewhere_do_not_follow_the_noise_of_the_readings(design):
    """The residual contains that noise: a regressor that contains it, too, seems to have a gain in every triangle."""
    number = next(k for k, c in enumerate(design.candidates) if c.word == "gain" and c.where.scope == "triangle")
    candidate = design.candidates[number]
    column, elsewhere = design.rows_of(candidate.columns)[:, 0], ~design.mask[candidate.columns[0]]
    refined = refine(replace(design, y=design.y - 0.02 * column), (number,))
    whole = refined.design.everywhere(0, refined.shares)

    def products(of: BlockDesign, k: int) -> np.ndarray:
        return of.residual_cross([], [])[elsewhere, of.atom[of.candidates[k].columns[0]]]

    of_load = products(replace(design, y=refined.design.y), number)
    n_rows = np.count_nonzero(design.weights[:, elsewhere])
    assert abs(np.sum(products(whole, 0) - of_load)) < 0.05 * n_rows


def test_a_term_that_explains_less_than_is_left_is_doubtful(design):
    assert doubtful(design, drift=1.0, misfit=2.0) == DRIFT


def test_a_term_that_explains_more_than_the_lack_of_fit_is_kept(design):
    assert doubtful(design, drift=4.0, misfit=2.0) is None


def test_a_small_term_beside_a_good_fit_is_kept(design):
    assert doubtful(design, drift=0.5, misfit=0.0) is None
