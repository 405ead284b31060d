"""Ten wrong set-ups and a right one, of both generations of boards: each is named with its remedy."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from insole_daemon.bring_up.judgement import judge_force, judge_observation
from insole_daemon.bring_up.observation import Observation
from insole_daemon.bus.frames import ERROR, FrameBatch
from insole_daemon.config import Config
from insole_daemon.service.doctor.can import judge_interface
from insole_daemon.service.doctor.finding import CheckResult
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.simulation.load import Unloaded

CONFIG = Config()
LAYOUTS = [load_layout(insole) for insole in CONFIG.insoles]
SECONDS = 6.0
GENERATIONS = pytest.mark.parametrize("generation", ["mtb3", "mtb4"])


def check_results(frames: FrameBatch, config: Config = CONFIG) -> list[CheckResult]:
    """What is said of frames that came in portions of 50 ms."""
    boards = {board.address: board for insole in config.insoles for board in insole.boards}
    observation = Observation(LAYOUTS, boards)
    edges_ns = np.arange(int(frames.t_mono_ns[0]), int(frames.t_mono_ns[-1]) + 50_000_000, 50_000_000)
    for begin_ns, end_ns in itertools.pairwise(edges_ns.tolist()):
        rows = (frames.t_mono_ns >= begin_ns) & (frames.t_mono_ns < end_ns)
        observation.feed(frames[rows], end_ns)
    return list(judge_observation(observation, config, LAYOUTS))


def emulated(generation: str, played: Config = CONFIG, **further: object) -> FrameBatch:
    return Emulator(played, LAYOUTS, Unloaded(LAYOUTS), generation=generation, **further).frames(0, SECONDS)


def changed(address: int, **settings: object) -> Config:
    """The configuration with other settings of one board."""
    return dataclasses.replace(
        CONFIG,
        insoles=tuple(
            dataclasses.replace(
                insole,
                boards=tuple(
                    dataclasses.replace(board, **settings) if board.address == address else board
                    for board in insole.boards
                ),
            )
            for insole in CONFIG.insoles
        ),
    )


def problems(results: list[CheckResult]) -> list[CheckResult]:
    return [result for result in results if result.level == "problem"]


def only(results: list[CheckResult], subject: str) -> CheckResult:
    """The one problem, which is of `subject`."""
    (problem,) = problems(results)
    assert problem.subject == subject
    assert problem.remedy
    return problem


def error_frames(n: int, kind: int = 0x008) -> FrameBatch:
    t_ns = np.linspace(0.1e9, SECONDS * 1e9, n).astype(np.int64)
    return FrameBatch(
        t_ns, t_ns, np.zeros(n, np.uint8), np.full(n, kind, np.uint32), np.full(n, 8, np.uint8),
        np.zeros((n, 8), np.uint8), np.full(n, ERROR, np.uint8),
    )  # fmt: skip


def merged(*batches: FrameBatch) -> FrameBatch:
    together = FrameBatch.concatenate(batches)
    return together[np.argsort(together.t_mono_ns, kind="stable")]


@GENERATIONS
def test_a_right_set_up_has_no_problem_and_names_the_generation(generation):
    results = check_results(emulated(generation))
    assert not problems(results)
    boards = [result for result in results if result.subject.startswith("board")]
    assert len(boards) == 6
    assert any("out of order (an MTB3)" in result.text for result in boards) == (generation == "mtb3")
    assert all("every 20.0 ms" in result.text for result in boards)


@GENERATIONS
def test_two_boards_on_one_address(generation):
    clash = InjectedFault("address_clash", 0.0, None, 6, other=7)
    results = check_results(emulated(generation, faults=[clash]))
    assert "two boards send under this address" in " ".join(result.text for result in problems(results))
    (named,) = [result for result in problems(results) if "two boards" in result.text]
    assert named.subject == "board 6"
    assert "unplug one" in named.remedy


@GENERATIONS
def test_a_missing_terminator_by_its_error_frames(generation):
    problem = only(check_results(merged(emulated(generation), error_frames(400))), "bus")
    assert "terminator is missing" in problem.text
    assert "120 Ω" in problem.remedy


def test_a_wrong_bit_rate_by_error_frames_without_data():
    results = problems(check_results(error_frames(400)))
    assert results[0].subject == "bus"
    assert "bit rate is wrong" in results[0].text
    assert "bitrate 1000000" in results[0].remedy


def test_a_wrong_bit_rate_of_the_interface_is_a_problem():
    link = {
        "flags": ["UP"],
        "linkinfo": {"info_kind": "can", "info_data": {"state": "ERROR-ACTIVE", "bittiming": {"bitrate": 500_000}}},
    }
    (problem,) = problems(list(judge_interface("can0", link, False)))
    assert "runs at 500000 bit/s, expected 1000000" in problem.text


def test_an_mtb3_at_shift_7():
    problem = only(check_results(emulated("mtb3", changed(5, shift=7))), "board 5")
    assert "shift 7" in problem.text
    assert "shift: 3" in problem.remedy


@GENERATIONS
def test_a_board_at_50_ms(generation):
    problem = only(check_results(emulated(generation, changed(9, period_ms=50))), "board 9")
    assert "sends every 50 ms, the configuration says 20 ms" in problem.text
    assert "period_ms: 50" in problem.remedy


@GENERATIONS
def test_a_loose_triangle(generation):
    loose = InjectedFault("loose", 0.0, None, 6, triangle=5)
    results = check_results(emulated(generation, faults=[loose]))
    named = [result for result in results if result.level != "ok" and "6" in result.subject]
    assert any("triangle 5" in f"{result.subject} {result.text}" for result in named), results
    assert any("flat cable" in result.remedy for result in named)


@GENERATIONS
def test_frames_of_another_sender_are_reported(generation):
    n = 200
    t_ns = np.linspace(0.1e9, SECONDS * 1e9, n).astype(np.int64)
    other = FrameBatch(
        t_ns, t_ns, np.zeros(n, np.uint8), np.full(n, 0x123, np.uint32), np.full(n, 4, np.uint8),
        np.zeros((n, 8), np.uint8), np.zeros(n, np.uint8),
    )  # fmt: skip
    results = check_results(merged(emulated(generation), other))
    (named,) = [finding for finding in results if "another sender" in finding.text]
    assert "0x123 (200)" in named.text
    assert "bus of its own" in named.remedy


@GENERATIONS
def test_a_board_that_the_configuration_does_not_have(generation):
    fewer = dataclasses.replace(CONFIG, insoles=(CONFIG.insoles[0],))
    boards = {board.address: board for board in fewer.insoles[0].boards}
    observation = Observation(LAYOUTS[:1], boards)
    observation.feed(emulated(generation), round(SECONDS * 1e9))
    results = problems(list(judge_observation(observation, fewer, LAYOUTS[:1])))
    assert [result.subject for result in results] == ["board 8", "board 9", "board 10"]
    assert "- {address: 8, interface: can0, period_ms: 20" in results[0].remedy


@GENERATIONS
def test_boards_that_do_not_start(generation):
    results = problems(check_results(emulated(generation, left_out=(8, 9, 10))))
    assert [result.subject for result in results] == ["board 8", "board 9", "board 10"]
    assert all("no frame received" in result.text for result in results)
    assert "insole boards start --foot right" in results[0].remedy


def test_a_bus_on_which_nothing_is_sent():
    observation = Observation(LAYOUTS, {board.address: board for insole in CONFIG.insoles for board in insole.boards})
    observation.feed(FrameBatch.empty(), 0)
    results = problems(list(judge_observation(observation, CONFIG, LAYOUTS)))
    assert "no frame and no error frame received" in results[0].text
    assert len(results) == 7


@pytest.mark.parametrize(
    ("f_z_n", "std_n", "builtin", "level"),
    [
        (700.0, 15.0, False, "ok"),
        (640.0, 15.0, False, "ok"),
        (400.0, 15.0, False, "problem"),
        (700.0, float("nan"), False, "warning"),
        (700.0, 15.0, True, "warning"),
    ],
)
def test_the_force_of_one_foot(f_z_n, std_n, builtin, level):
    finding = judge_force("left", f_z_n, std_n, 70.0, builtin)
    assert finding.level == level
    assert "687 N" in finding.text
