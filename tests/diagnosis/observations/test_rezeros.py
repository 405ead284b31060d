"""A board that is re-zeroed: on a walk with a stand, and in a chamber beside an effect of all boards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.observations.reading_faults import reading_faults
from insole_daemon.diagnosis.observations.rezeros import _is_part_of_load, _last_drop, correct_rezeros
from insole_daemon.diagnosis.observing import observed

from .. import chamber
from ..foot import shoe

BOARD = 6
STANDS_S, STANDING_COUNT = (6.0, 18.0), 12.0
ZEROED_S = (17.0, 17.5)


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Foot and observation of a walk with a stand of 12 s."""
    recording = insole_daemon.load(shoe.write(tmp_path_factory.mktemp("walk") / "walk", seconds=40.0))
    (foot,) = recording.feet
    (seen,) = observed([recording], [foot], None, lambda text: None, ())
    activation = seen.activation_count.copy()
    stands = (seen.t_s > STANDS_S[0]) & (seen.t_s < STANDS_S[1])
    activation[stands] = np.where(seen.usable, STANDING_COUNT, 0.0)
    return foot, replace(seen, activation_count=activation)


def test_rezero_under_a_standing_foot_is_detected_when_it_happened(walk):
    foot, seen = walk
    own = (seen.layout.identities[:, 0] == BOARD)[:, None] & seen.usable
    activation = seen.activation_count.copy()
    step = np.flatnonzero((seen.t_s > ZEROED_S[0]) & (seen.t_s < ZEROED_S[1]))
    at = int(step[np.argmax(activation[step][:, own].mean(axis=1))])
    activation[at:] -= np.where(own, activation[at], 0.0)
    _, findings = correct_rezeros(foot, replace(seen, activation_count=activation))
    (finding,) = findings
    assert finding.where.ids == ((BOARD,),)
    assert finding.parameters["t_s"].value == pytest.approx(seen.t_s[at], abs=0.2)


def test_rezero_of_a_person_who_goes_on_standing_is_detected_when_it_happened(walk):
    """All taxels land on the count of no load from one reading to the next. Then the foot is lifted slowly."""
    foot, seen = walk
    own = (seen.layout.identities[:, 0] == BOARD)[:, None] & seen.usable
    activation = seen.activation_count.copy()
    activation[seen.t_s > 9.0] -= np.where(own, STANDING_COUNT, 0.0)
    lifted = (seen.t_s > 10.0) & (seen.t_s < STANDS_S[1])
    activation[lifted] -= np.linspace(0.0, STANDING_COUNT, lifted.sum())[:, None, None] * own
    _, findings = correct_rezeros(foot, replace(seen, activation_count=activation))
    (finding,) = findings
    assert finding.where.ids == ((BOARD,),)
    assert finding.parameters["t_s"].value == pytest.approx(9.0, abs=0.1)


def test_a_rezero_is_not_dated_by_a_foot_that_is_lifted_at_once_from_its_plateau(walk):
    """At the end of a step all taxels fall to the count of no load within two rows, as in a re-zero of a stand."""
    foot, seen = walk
    own = (seen.layout.identities[:, 0] == BOARD)[:, None] & seen.usable
    of_step = np.concatenate([np.full(20, STANDING_COUNT), np.linspace(STANDING_COUNT, 0.0, 4), np.zeros(30)])
    level = np.resize(of_step, len(seen.t_s))
    at = int(np.argmax((seen.t_s > 26.0) & (level == STANDING_COUNT)))
    level[at:] -= STANDING_COUNT
    activation = np.where(own, level[:, None, None], seen.activation_count)
    _, findings = correct_rezeros(foot, replace(seen, activation_count=activation))
    (finding,) = findings
    assert finding.where.ids == ((BOARD,),)
    assert finding.parameters["t_s"].value == pytest.approx(seen.t_s[at], abs=1.2)


def test_a_rezero_is_not_dated_by_an_earlier_undershoot(walk):
    """Two readings below no load at an edge, long before the re-zero under a walking foot."""
    foot, seen = walk
    own = (seen.layout.identities[:, 0] == BOARD)[:, None] & seen.usable
    activation = seen.activation_count.copy()
    step = np.flatnonzero((seen.t_s > 28.0) & (seen.t_s < 29.0))
    at = int(step[np.argmax(activation[step][:, own].mean(axis=1))])
    activation[at:] -= np.where(own, activation[at], 0.0)
    edge = int(np.argmax(seen.t_s > STANDS_S[1]))
    activation[edge : edge + 2] -= np.where(own, STANDING_COUNT + 8.0, 0.0)
    _, findings = correct_rezeros(foot, replace(seen, activation_count=activation))
    (finding,) = findings
    assert finding.parameters["t_s"].value == pytest.approx(seen.t_s[at], abs=1.0)


def test_a_rezero_is_not_dated_by_an_earlier_step():
    """The foot rolls off a board that re-zeroed by less than an earlier step's end."""
    level = np.zeros(1200)
    level[200:300] = 6.0  # a step
    level[1000:] = np.maximum(-0.05 * np.arange(200), -4.0)
    assert _last_drop(level, floor=-2.0, least=2.0, width=3, stance=100) == 1041


def test_a_rezero_of_a_walking_board_is_dated_by_the_pause_in_which_it_sent_nothing(walk):
    """Two seconds later the foot is in the air for the first time since, and leaves a plateau at once."""
    foot, seen = walk
    own = (seen.layout.identities[:, 0] == BOARD)[:, None] & seen.usable
    of_step = np.concatenate([np.full(40, STANDING_COUNT), np.linspace(STANDING_COUNT, 0.0, 4), np.zeros(30)])
    level = np.resize(of_step, len(seen.t_s))
    at = int(np.argmax((seen.t_s > 26.0) & (level == STANDING_COUNT))) + 10
    # In the air the readings are beyond their range, and are interpolated there until they come near no load again.
    level[at:] -= np.interp(np.arange(len(level) - at), [0, 10, 60], [0.0, 0.5 * STANDING_COUNT, STANDING_COUNT])
    missing = seen.missing.copy()
    missing[at - 2 : at + 3, own.any(axis=1)] = True
    activation = np.where(own, level[:, None, None], seen.activation_count)
    _, findings = correct_rezeros(foot, replace(seen, activation_count=activation, missing=missing))
    (finding,) = findings
    assert finding.where.ids == ((BOARD,),)
    assert finding.parameters["t_s"].value == pytest.approx(seen.t_s[at], abs=0.05)


def test_the_missing_load_of_a_walking_board_is_that_of_its_readings_in_the_air(walk):
    """From before the re-zero to after it, the load of the foot changes, too."""
    foot, seen = walk
    own = (seen.layout.identities[:, 0] == BOARD)[:, None] & seen.usable
    activation = seen.activation_count.copy()
    step = np.flatnonzero((seen.t_s > 26.0) & (seen.t_s < 27.0))
    level = activation[step][:, own].mean(axis=1)
    at = int(step[np.argmax(level)]) + int(np.argmax(level[np.argmax(level) :] < 0.7 * level.max()))  # it rolls off
    shift = np.where(own, np.minimum(activation[at], 10.0), 0.0)  # within range, in the air
    activation[at:] -= shift
    _, findings = correct_rezeros(foot, replace(seen, activation_count=activation))
    (finding,) = findings
    assert finding.where.ids == ((BOARD,),)
    assert finding.parameters["shift_count"].value == pytest.approx(float(shift[own].mean()), rel=0.05)


def test_rows_from_the_step_of_a_rezero_on_are_dropped_on_a_walk_even_if_readings_fall_later(walk):
    """The board pauses, then reads beyond its range, so that its readings between are interpolated."""
    foot, seen = walk
    boards = seen.layout.identities[:, 0] == BOARD
    own = boards[:, None] & seen.usable
    activation, missing = seen.activation_count.copy(), seen.missing.copy()
    step = np.flatnonzero((seen.t_s > 28.0) & (seen.t_s < 29.0))
    at = int(step[np.argmax(activation[step][:, own].mean(axis=1))])
    missing[at - 5 : at, boards] = True
    activation[at:] -= np.where(own, activation[at], 0.0)
    last = at + 60
    share = np.linspace(0.0, 1.0, last - at)[:, None]
    activation[at:last, own] = activation[at - 1, own] * (1.0 - share) + activation[last, own] * share
    corrected, findings = correct_rezeros(foot, replace(seen, activation_count=activation, missing=missing))
    assert [each.effect for each in findings] == ["rezero"]
    assert seen.t_s[at] - 1.5 < corrected.t_s[-1] < seen.t_s[at - 5]


def test_standing_is_no_rezero(walk):
    assert correct_rezeros(*walk)[1] == []


def test_undershoot_of_cubics_at_edges_is_no_rezero(walk):
    foot, seen = walk
    own = (seen.layout.identities[:, 0] == BOARD)[:, None] & seen.usable
    activation, after = seen.activation_count.copy(), np.flatnonzero(seen.t_s > STANDS_S[1])
    for k in (0, 1):  # two rows of a step of 50
        activation[after[k::50]] -= np.where(own, 8.0, 0.0)
    assert correct_rezeros(foot, replace(seen, activation_count=activation))[1] == []


def test_a_rezero_is_found_beside_an_effect_that_moves_all_boards_by_as_much(tmp_path):
    folder = chamber.write(tmp_path / "bag", lambda t_s, p: 0.6 * p, seconds=90.0, seed=1)
    recording = insole_daemon.load(folder)
    (foot,) = recording.feet
    (seen,) = observed([recording], [foot], None, lambda text: None, ())
    assert correct_rezeros(foot, seen)[1] == []
    of_board = (seen.layout.identities[:, 0] == BOARD)[:, None] & seen.usable
    no_load = {board.address: board.no_load for board in foot.boards}[BOARD]
    is_between = (seen.t_s > 30.0) & (seen.t_s < 60.0)
    at = int(np.argmax(np.where(is_between, seen.activation_count[:, of_board].mean(axis=1), 0.0)))
    misses = (seen.expected_count - seen.activation_count)[:at, seen.usable].mean(axis=1)
    assert np.median(misses) > 5.5  # more than a re-zero has to change
    landed = seen.calibration.baseline_count - no_load
    zeroed = seen.activation_count.copy()
    zeroed[at:] -= np.where(of_board, seen.activation_count[at] - landed, 0.0)
    (finding,) = correct_rezeros(foot, replace(seen, activation_count=zeroed))[1]
    assert finding.where.ids == ((BOARD,),)
    assert finding.parameters["t_s"].value == pytest.approx(seen.t_s[at], abs=0.2)


def test_readings_that_stay_above_those_of_no_load_were_not_zeroed_under_load(tmp_path):
    recording = insole_daemon.load(chamber.write(tmp_path / "bag"))
    (foot,) = recording.feet
    (seen,) = observed([recording], [foot], None, lambda text: None, ())
    own = (seen.layout.identities[:, 0] == BOARD)[:, None] & seen.usable
    load = seen.expected_count[:, own].mean(axis=1)
    at = int(np.argmax(np.where((seen.t_s > 30.0) & (seen.t_s < 60.0) & (load > 15.0), np.gradient(load), 0.0)))
    landed = seen.calibration.baseline_count - {board.address: board.no_load for board in foot.boards}[BOARD]
    zeroed = seen.activation_count.copy()
    zeroed[at:] -= np.where(own, seen.expected_count[at] - landed, 0.0)
    assert len(correct_rezeros(foot, replace(seen, activation_count=zeroed))[1]) == 1
    stiff = np.where(own, np.maximum(zeroed, landed + 1.0), zeroed)
    assert correct_rezeros(foot, replace(seen, activation_count=stiff))[1] == []


def test_a_board_that_sends_nothing_while_it_zeroes_itself_under_a_changing_load_is_corrected(tmp_path):
    recording = insole_daemon.load(chamber.write(tmp_path / "bag"))
    (foot,) = recording.feet
    (seen,) = observed([recording], [foot], None, lambda text: None, ())
    boards = seen.layout.identities[:, 0] == BOARD
    own = boards[:, None] & seen.usable
    load = seen.expected_count[:, own].mean(axis=1)
    is_between = (seen.t_s > 30.0) & (seen.t_s < 60.0) & (load > 15.0)
    at = int(np.argmax(np.where(is_between, np.gradient(load), 0.0)))
    no_load = {board.address: board.no_load for board in foot.boards}[BOARD]
    lacks = seen.expected_count[at] - (seen.calibration.baseline_count - no_load)
    zeroed, missing = seen.activation_count.copy(), seen.missing.copy()
    zeroed[at:] -= np.where(own, lacks, 0.0)
    first, last = at - 4, at + 20  # half a second: the load changes by more than taxels may be from where they land
    assert load[last] - load[at] > 6.0
    share = np.linspace(0.0, 1.0, last - first)[:, None]
    zeroed[first:last, own] = zeroed[first, own] * (1.0 - share) + zeroed[last, own] * share
    missing[first:last, boards] = True
    corrected, (finding,) = correct_rezeros(foot, replace(seen, activation_count=zeroed, missing=missing))
    assert finding.where.ids == ((BOARD,),)
    assert finding.parameters["t_s"].value == pytest.approx(seen.t_s[at], abs=0.3)
    assert finding.parameters["shift_count"].value == pytest.approx(lacks[own].mean(), abs=1.0)
    error = (corrected.activation_count - seen.activation_count)[last:, own][
        ~corrected.missing[last:, boards].any(axis=1)
    ]
    assert abs(error.mean()) < 1.0
    silent_s = seen.t_s[[first, last]]
    readings = tuple(
        replace(each, **{name: getattr(each, name)[is_sent] for name in ("t_s", "counts", "valid")})
        for each, is_own in zip(seen.readings, boards, strict=True)
        for is_sent in [~is_own | (each.t_s < silent_s[0]) | (each.t_s > silent_s[1])]
    )
    faults = reading_faults(foot, replace(seen, activation_count=zeroed, missing=missing, readings=readings))
    assert [each.effect for each in faults.findings] == ["rezero"], "what it did not send meanwhile is no loss"


@pytest.mark.parametrize(("least_missing", "is_rezero"), [(12.0, True), (-8.0, False)])
def test_readings_that_miss_much_less_than_the_step_at_other_times_were_not_zeroed(tmp_path, least_missing, is_rezero):
    """A strong creep lets the readings of all boards miss a part of the load at one time, and exceed it at another."""
    recording = insole_daemon.load(chamber.write(tmp_path / "bag", seconds=90.0))
    (foot,) = recording.feet
    (seen,) = observed([recording], [foot], None, lambda text: None, ())
    expected = seen.expected_count[:, seen.usable].mean(axis=1)
    at = int(np.argmax((seen.t_s > 10.0) & (np.abs(expected - 12.0) < 1.0)))
    missing = np.where(seen.t_s % 10.0 < 6.0, 12.0, least_missing) * (np.arange(len(seen.t_s)) >= at)
    missing[at : at + 50] = 12.0
    activation = np.where(seen.usable, seen.activation_count - missing[:, None, None], 0.0)
    findings = correct_rezeros(foot, replace(seen, activation_count=activation))[1]
    assert len(findings) == (3 if is_rezero else 0)


@pytest.mark.parametrize(
    ("part", "constant_count", "is_part"), [(0.5, 0.0, True), (0.0, 9.0, False), (0.1, 9.0, False)]
)
def test_readings_that_miss_a_part_of_the_load_are_those_of_a_gain_or_bit_shift(part, constant_count, is_part):
    """A board that halves its readings misses half of the first load, as if it had been zeroed then."""
    rng = np.random.default_rng(2)
    load_count = 20.0 + 10.0 * np.sin(np.arange(400) / 20.0)
    missing_count = part * load_count + constant_count + rng.standard_normal(400)
    load_count[::7] = np.nan
    assert _is_part_of_load(missing_count, load_count) == is_part
