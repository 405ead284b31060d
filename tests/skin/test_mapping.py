"""Pressing triangle after triangle of emulated boards whose assignment nobody knows."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from insole_daemon.config import Board, Config, Insole
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.mapping import Mapping, Position, positions
from insole_daemon.skin.mapping_result import layout_of, summary
from insole_daemon.skin.touch import Touch

TEMPLATES = [layouts.builtin("left", (5, 6, 7)), layouts.builtin("right", (8, 9, 10))]
OWNERS = {5: "left", 6: "left", 7: "left", 8: "right", 9: "right", 10: "right"}
FINGER_SIGMA_M = 0.0064  # 15 mm wide at half its height
FINGER_PA = 150e3  # 39 N
CHUNK_NS = 25_000_000


class Finger:
    """Presses places, each for a while: what the simulated person has done so far."""

    def __init__(self, truth, dead=()) -> None:
        self.truth = {layout.foot: layout for layout in truth}
        self.presses: list[tuple[float, float, str, np.ndarray]] = []  # from, to, foot, where
        self.dead = set(dead)
        self.wires: dict[tuple[str, int], tuple[str, int]] = {}  # a place that is wired to another triangle

    def pressure_pa(self, foot, t_s):
        layout = self.truth[foot]
        pressure = np.zeros((len(t_s), len(layout), 12))
        for begin, end, where, xy_m in self.presses[-2:]:
            if where != foot:
                continue
            ramp = np.clip(np.minimum((t_s - begin) / 0.15, (end - t_s) / 0.15), 0, 1)
            away_m = np.hypot(*(layout.xy_m - xy_m).transpose(2, 0, 1))
            blob = FINGER_PA * np.exp(-((away_m / FINGER_SIGMA_M) ** 2) / 2)
            pressure += ramp[:, None, None] * blob
        for (_, row), (other_foot, target) in self.wires.items():
            if other_foot == foot:
                pressure[:, target] += pressure[:, row]
                pressure[:, row] = 0
        for board, triangle in self.dead:
            row = layout.rows.get((board, triangle))
            if row is not None:
                pressure[:, row] = 0
        pressure[..., [6, 10]] = 0
        return pressure


def assignment(seed: int, across: bool = False):
    """Both feet with random (board, triangle) at every position; `across`: any board in any foot."""
    draw = np.random.default_rng(seed)
    truth = []
    slots = [(board, triangle) for board in range(5, 11) for triangle in range(16)]
    draw.shuffle(slots)
    for template in TEMPLATES:
        own = [slot for slot in slots if across or OWNERS[slot[0]] == template.foot]
        taken = own[: len(template)]
        slots = [slot for slot in slots if slot not in taken]
        truth.append(
            layouts.assigned(
                template,
                tuple(
                    dataclasses.replace(t, board=int(board), triangle=int(triangle))
                    for t, (board, triangle) in zip(template.triangles, taken, strict=True)
                ),
            )
        )
    return truth


def wiring(truth):
    """The boards as they really are, a board in both feet as two that share an address."""
    insoles = []
    for layout in truth:
        addresses = sorted(set(layout.identities[:, 0].tolist()))
        insoles.append(Insole(foot=layout.foot, boards=tuple(Board(address=a, interface="can0") for a in addresses)))
    return Config(insoles=tuple(insoles))


def mapped(truth, finger=None, slip=None, seed=0, wait_s=2.0, reaction_s=0.3):
    """A person follows the prompts; `slip(position, time asked)` says where they press instead, None for nowhere."""
    finger = finger or Finger(truth)
    run = Emulator(wiring(truth), truth, finger, seed=seed).run(0)
    touch = Touch()
    feet = {layout.foot for layout in truth}
    wanted = [position for template in TEMPLATES if template.foot in feet for position in positions(template)]
    mapping = Mapping(wanted, OWNERS, wait_s)
    prompts, times = [], {}
    while not mapping.is_done:
        assert run.now_ns < 1000e9, f"stuck at {mapping.position}"
        touch.feed(run.advance(run.now_ns + CHUNK_NS))
        for prompt in mapping.update(run.now_ns, touch.level_count(run.now_ns)):
            prompts.append(prompt)
            if prompt.kind == "press":
                times[prompt.position] = times.get(prompt.position, 0) + 1
                where = slip(prompt.position, times[prompt.position]) if slip else [prompt.position]
                for position in where:
                    now_s = run.now_ns * 1e-9 + reaction_s
                    xy_m = np.array([position.x_mm, position.y_mm]) * 1e-3
                    finger.presses.append((now_s, now_s + 0.9, position.foot, xy_m))
    streaming = [tuple(map(int, i)) for i in np.argwhere(touch.has_arrived())]
    faulty = [tuple(map(int, i)) for i in np.argwhere(touch.faulty())]
    results = mapping.results()
    return results, prompts, summary(results, OWNERS, streaming, faulty), times, run.now_ns * 1e-9


def n_right(results, truth) -> int:
    by_foot = {layout.foot: layout for layout in truth}
    return sum(
        r.state == "answered" and r.identity == tuple(by_foot[r.position.foot].identities[r.position.row])
        for r in results
    )


@pytest.mark.parametrize(("seed", "across"), [(1, False), (3, True)])
def test_a_random_assignment_of_both_feet_is_mapped_in_one_pass(seed, across, tmp_path):
    truth = assignment(seed, across)
    results, _, lines, times, took_s = mapped(truth, seed=seed)
    assert n_right(results, truth) == 56
    assert set(times.values()) == {1}, "one press a position"
    print(f"56 of 56 in {took_s:.0f} s of presses")
    for template, real in zip(TEMPLATES, truth, strict=True):
        path = tmp_path / f"{template.foot}.yaml"
        layouts.write(path, layout_of(template, results), "made by a test")
        back = layouts.load(path, template.foot, OWNERS)
        np.testing.assert_array_equal(back.identities, real.identities)
        np.testing.assert_allclose(back.xy_m, template.xy_m, atol=1e-6)
        assert back.taxel_area_m2 == pytest.approx(template.taxel_area_m2)
    if not across:
        assert lines == []


def test_a_dead_triangle_is_missing_and_the_rest_right():
    truth = assignment(4)[:1]
    board, triangle = truth[0].identities[7].tolist()
    results, _, lines, times, _ = mapped(truth, Finger(truth, dead=[(board, triangle)]))
    assert n_right(results, truth) == 27
    assert results[7].state == "missing"
    assert times[results[7].position] == 2, "asked once more at the end"
    assert any(line.startswith("missing: left foot, front patch, position 8") for line in lines)
    assert f"streaming, but found at no position: board {board} triangle {triangle}" in lines
    assert len(layout_of(TEMPLATES[0], results)) == 27


def test_two_places_on_one_triangle_are_doubled_and_left_out():
    truth = assignment(5)[:1]
    finger = Finger(truth)
    finger.wires[("left", 3)] = ("left", 20)
    results, _, lines, _, _ = mapped(truth, finger)
    assert n_right(results, truth) == 26
    assert [result.state for result in results if result.state != "answered"] == ["doubled"] * 2
    assert {result.position.row for result in results if result.state == "doubled"} == {3, 20}
    assert any(line.startswith("doubled: board") and "position 4; left foot" in line for line in lines)
    assert len(layout_of(TEMPLATES[0], results)) == 26


def test_boards_that_are_swapped_between_the_feet_are_named():
    truth = [layouts.builtin("left", (5, 9, 7)), layouts.builtin("right", (8, 6, 10))]
    results, prompts, lines, _, _ = mapped(truth)
    assert n_right(results, truth) == 56
    assert [line.split(",")[0] for line in lines] == [
        "swapped: board 6 lies in the right foot",
        "swapped: board 9 lies in the left foot",
    ]
    assert any(
        "gives to the right foot" in prompt.text
        for prompt in prompts
        if prompt.position and prompt.position.foot == "left"
    )


def test_a_slip_of_the_person_is_made_good_at_the_end():
    truth = assignment(6)[:1]

    def slip(position: Position, time: int):
        wrong = (position.foot, position.row) == ("left", 4) and time == 1
        return [positions(TEMPLATES[0])[9]] if wrong else [position]

    results, _, _, times, _ = mapped(truth, slip=slip)
    assert n_right(results, truth) == 28
    assert sorted(p.row for p, n in times.items() if n == 2) == [4, 9]


def test_two_pressed_at_once_are_asked_again():
    truth = assignment(7)[:1]

    def clumsy(position: Position, time: int):
        both = position.row == 2 and time == 1
        return [position, positions(TEMPLATES[0])[26]] if both else [position]

    results, prompts, _, times, _ = mapped(truth, slip=clumsy)
    assert n_right(results, truth) == 28
    assert [prompt.position.row for prompt in prompts if prompt.kind == "again"] == [2]
    assert max(times.values()) == 2


def test_positions_without_a_press_are_missing():
    truth = assignment(8)[:1]
    results, _, _, _, _ = mapped(truth, slip=lambda position, time: [], wait_s=0.2)
    assert {result.state for result in results} == {"missing"}
    assert layout_of(TEMPLATES[0], results) is None


def test_triangles_without_a_sensor_do_not_answer():
    """All sixteen enabled, as the public launch file does: the open ones report it."""
    truth = [layouts.builtin("left", (5, 6, 7)), layouts.builtin("right", (8, 9, 10))]
    touch = Touch()
    run = Emulator(wiring(truth), truth, Finger(truth)).run(0)
    for mounted in run._mounted:
        mounted.board.enable(range(16), True)
    touch.feed(run.advance(300_000_000))
    level = touch.level_count(run.now_ns)
    assert np.isfinite(level).sum() == 56
    assert touch.has_arrived().sum() == 96
    assert touch.faulty().sum() == 40
    assert np.isnan(touch.level_count(run.now_ns + 600_000_000)).all(), "silence is not a reading"
