"""Judgement of an observation: findings with their remedies, and lines of config.yaml that match the boards."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from ..config import Board, Config
from ..service.doctor.finding import CheckResult, ok, problem, warning
from ..skin.layout import Layout
from ..skin.mapping import PositionResult
from .observation import BoardFacts, Observation

_PERIOD_RATIO = 1.25  # a board keeps its period to some 100 ppm; a bus that is nearly full delays a frame by a few ms
_REST_COUNT = 8.0  # unloaded, the median taxel of a board is this near to its no-load
_FLAGGED_SHARE = 0.2
_MOST_IDENTIFIERS = 6
_WIRING = "power off: 120 Ω between CAN_H and CAN_L at both ends of the bus (60 Ω in all), both wires, the ground"


def judge_observation(observation: Observation, config: Config, layouts: Sequence[Layout]) -> Iterator[CheckResult]:
    """Compare the observed boards with `config`; yield findings."""
    heard = observation.boards()
    yield from _judge_bus(observation, heard)
    clashing = {fault.board for fault in observation.faults if fault.kind == "board_address_clash"}
    for insole, layout in zip(config.insoles, layouts, strict=True):
        for board in insole.boards:
            facts = heard.get(board.address)
            if facts is None:
                yield problem(
                    _name(board.address),
                    f"of the {insole.foot} foot: no frame received",
                    f"is it powered and connected? Then start it: in config.yaml boards: {{configure: true}}, "
                    f"'insole run', and 'insole boards start --foot {insole.foot}'",
                )
            elif board.address in clashing:
                yield problem(
                    _name(board.address),
                    "two boards send under this address: their readings cannot be distinguished",
                    "unplug one of the two and give the other a free address with the maker's tool",
                )
            else:
                yield from _judge_board(board, facts, layout, insole.foot)
    configured = {board.address for insole in config.insoles for board in insole.boards}
    silent = [str(address) for address in sorted(configured - heard.keys())]
    for address in sorted(heard.keys() - configured):
        instead = f"instead of board {' or '.join(silent)}, if it is that one" if silent else "under boards of its foot"
        yield problem(
            _name(address),
            f"sends {len(heard[address].triangles)} triangles, and config.yaml does not have it",
            f"{instead}: {config_line(heard[address], None, config.buses[0].channel)}   # or unplug it",
        )
    yield from _judge_faults(observation, clashing)


def _judge_bus(observation: Observation, heard: Mapping[int, BoardFacts]) -> Iterator[CheckResult]:
    frames = observation.frames()
    errors = sum(observation.error_frames.values())
    kinds = ", ".join(f"{count} {kind.replace('_', ' ')}" for kind, count in observation.error_frames.items())
    data = len(frames) - errors
    if errors and not data:
        yield problem(
            "bus",
            f"error frames ({kinds}) and not one frame that can be read: the bit rate is wrong, or the wiring",
            "sudo ip link set can0 down && sudo ip link set can0 up type can bitrate 1000000   # that of the boards",
        )
    elif errors:
        yield problem("bus", f"error frames: {kinds}: a terminator is missing, or a wire is bad", _WIRING)
    elif not data:
        yield problem(
            "bus",
            "no frame and no error frame received",
            "are the boards powered, and is this their interface? 'insole doctor' checks the interface",
        )
    other_frames = observation.other_senders()
    if other_frames:
        most = sorted(other_frames, key=lambda identifier: -other_frames[identifier])[:_MOST_IDENTIFIERS]
        listed = ", ".join(f"0x{identifier:03X} ({other_frames[identifier]})" for identifier in most)
        more = f" and {len(other_frames) - len(most)} more" if len(other_frames) > len(most) else ""
        yield warning(
            "bus",
            f"another sender: frames that no tactile board sends, by identifier (frames): {listed}{more}",
            "give the insole a bus of its own: another sender takes its time, and may command its boards",
        )
    if data and not errors and not other_frames and heard:
        yield ok("bus", f"{data} frames, no error frame, no other sender")


def _judge_board(board: Board, facts: BoardFacts, layout: Layout, foot: str) -> Iterator[CheckResult]:
    name, line = _name(board.address), f"config.yaml: {config_line(facts, board)}"
    configure = f"insole boards configure --foot {foot}   # or {line}"
    wrong = False
    if not _is_near(facts.period_ms, board.period_ms):
        wrong = True
        yield problem(
            name, f"sends every {facts.period_ms:.0f} ms, the configuration says {board.period_ms} ms", configure
        )
    if facts.out_of_range_share > _FLAGGED_SHARE:
        wrong = True
        yield problem(
            name,
            f"flags {facts.out_of_range_share:.0%} of its taxels as out of range although they are not: an MTB3 at "
            "shift 7, whose 16-bit arithmetic overflows",
            f"in config.yaml shift: 3 for this board, and boards: {{configure: true}}; then "
            f"insole boards configure --foot {foot}",
        )
    if math.isfinite(facts.rest_count) and abs(facts.rest_count - board.no_load) > _REST_COUNT:
        wrong = True
        yield problem(
            name,
            f"rests at {facts.rest_count:.0f} counts, the configuration says no_load: {board.no_load}; "
            "or it is pressed, or was started under load",
            configure,
        )
    expected = {triangle.triangle for triangle in layout.triangles if triangle.board == board.address}
    missing, further = sorted(expected - set(facts.triangles)), sorted(set(facts.triangles) - expected)
    if missing:
        wrong = True
        yield problem(
            name,
            f"triangles {_format_numbers(missing)} of the layout are never sent",
            f"insole boards configure --foot {foot}   # enables them; or take them out of the layout",
        )
    if further:
        yield warning(
            name,
            f"sends triangles {_format_numbers(further)}, which are not in the layout",
            "'insole map' finds where they lie; triangles that are not in the layout are not used",
        )
    for triangles, words in (
        (facts.open_triangles, "not connected"),
        (facts.no_ack_triangles, "a chip does not answer"),
    ):
        used = sorted(set(triangles) & expected)
        if used:
            wrong = True
            yield problem(name, f"triangle {_format_numbers(used)}: {words}", "check the flat cable of that triangle")
    if facts.legacy:
        yield warning(name, "sends in the old class 3: an MTB3 that was never configured", configure)
    if not wrong:
        yield ok(name, describe_board(facts))


def _judge_faults(observation: Observation, clashing: set[int]) -> Iterator[CheckResult]:
    """Yield the faults that the daemon's fault watch detected, without those that the boards report themselves."""
    reported_open = {
        (address, triangle) for address, facts in observation.boards().items() for triangle in facts.open_triangles
    }
    for fault in observation.faults:
        if fault.board in clashing or fault.kind == "board_silent" or (fault.board, fault.triangle) in reported_open:
            continue
        where = "" if fault.triangle is None else f" triangle {fault.triangle}"
        where += "" if fault.taxel is None else f" taxel {fault.taxel}"
        words = fault.kind.partition("_")[2].replace("_", " ")
        remedy = {
            "triangle_loose": "check the flat cable of that triangle",
            "board_reset": "check the power of that board",
            "board_rezeroed": "lift the foot and take a zero: insole zero",
        }.get(fault.kind, "the daemon leaves it out; nothing to do unless there are many")
        yield warning(f"{_name(fault.board)}{where}", words, remedy)


def judge_placement(layout: Layout, results: Sequence[PositionResult]) -> Iterator[CheckResult]:
    """Compare the mapping results of one foot with `layout`, which the configuration uses."""
    boards: dict[str, set[int]] = {}
    expected: dict[str, set[int]] = {}
    moved = []
    for result in results:
        if result.position.foot != layout.foot:
            continue
        expected_triangle = layout.triangles[result.position.row]
        expected.setdefault(expected_triangle.patch, set()).add(expected_triangle.board)
        if result.identity is not None:
            boards.setdefault(expected_triangle.patch, set()).add(result.identity[0])
            if result.identity != (expected_triangle.board, expected_triangle.triangle):
                moved.append(result)
    for patch, responding in boards.items():
        if not responding & expected[patch]:
            yield problem(
                f"{layout.foot} foot",
                f"patches are swapped: at the {patch} patch board {_format_numbers(sorted(responding))} answers, "
                f"the layout has board {_format_numbers(sorted(expected[patch]))} there",
                f"plug the patches as the layout says, or use the one written here: layout: {layout.foot}-layout.yaml",
            )
            return
    if moved:
        yield warning(
            f"{layout.foot} foot",
            f"{len(moved)} triangles lie elsewhere than the layout says",
            f"in config.yaml, under the {layout.foot} foot: layout: {layout.foot}-layout.yaml   # written here",
        )
    elif boards:
        yield ok(f"{layout.foot} foot", "every triangle that answered lies where the layout says")


def judge_force(foot: str, f_z_n: float, std_n: float, body_mass_kg: float, builtin: bool) -> CheckResult:
    """Judge the force measured while a person stands on `foot` alone; `std_n` is the calibration's uncertainty."""
    weight_n = 9.81 * body_mass_kg
    measured = f"{f_z_n:.0f} N on the {foot} foot, the body weighs {weight_n:.0f} N"
    if builtin or not math.isfinite(std_n):
        return warning(
            f"{foot} force",
            f"{measured}; the calibration states no uncertainty, so the difference cannot be judged",
            "insole calibrate   # makes a calibration of this insole, with its uncertainty",
        )
    limit_n = 3 * std_n + 0.05 * weight_n  # the force of a standing person varies by a few percent
    if abs(f_z_n - weight_n) <= limit_n:
        return ok(f"{foot} force", f"{measured}: within ± {limit_n:.0f} N")
    return problem(
        f"{foot} force",
        f"{measured}: further off than ± {limit_n:.0f} N, three times the calibration's uncertainty and 5 %",
        "is it the calibration of this insole, and was the zero taken without load? insole zero, then again",
    )


def config_line(facts: BoardFacts, board: Board | None, bus_interface: str = "can0") -> str:
    """Return the line of config.yaml that agrees with what the board sends.

    What frames do not tell is taken from `board`, the configured one; `bus_interface` is used where there is none.
    """
    period_ms = round(facts.period_ms) if math.isfinite(facts.period_ms) else 20
    no_load = round(facts.rest_count) if math.isfinite(facts.rest_count) else 240
    interface, shift = (bus_interface, 3) if board is None else (board.interface, board.shift)
    if board is not None:
        period_ms = board.period_ms if _is_near(facts.period_ms, board.period_ms) else period_ms
        no_load = board.no_load if abs(no_load - board.no_load) <= _REST_COUNT else no_load
    return (
        f"- {{address: {facts.address}, interface: {interface}, period_ms: {period_ms}, shift: {shift}, "
        f"no_load: {no_load}}}"
    )


def describe_board(facts: BoardFacts) -> str:
    """Return the properties of a board's frames in one sentence."""
    order = (
        "halves in ascending order (an MTB4, or an MTB3 whose queue stays short)"
        if facts.is_ordered
        else "halves out of order (an MTB3)"
    )
    pads = (
        "" if facts.pads_count is None else f", thermal pads at {facts.pads_count[0]:.0f} and {facts.pads_count[1]:.0f}"
    )
    return (
        f"{len(facts.triangles)} triangles every {facts.period_ms:.1f} ms, new values at {facts.new_values_hz:.1f} Hz, "
        f"rests at {facts.rest_count:.0f}, {order}{pads}"
    )


def _is_near(measured_ms: float, configured_ms: float) -> bool:
    return math.isfinite(measured_ms) and 1 / _PERIOD_RATIO < measured_ms / configured_ms < _PERIOD_RATIO


def _name(address: int) -> str:
    return f"board {address}"


def _format_numbers(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))
