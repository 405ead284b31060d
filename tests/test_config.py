from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import FrozenInstanceError, dataclass
from pathlib import Path
from typing import Any

import pytest

from insole_daemon.config import Bus, Config, Insole, check_insoles, load
from insole_daemon.documents import Section, read
from insole_daemon.errors import DocumentError

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "tests" / "data" / "examples"
BOARDS = "boards: [{address: 5, interface: can0}, {address: 6, interface: can0}, {address: 7, interface: can0}]"

Write = Callable[[str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(text: str) -> Path:
        path = tmp_path / "config.yaml"
        path.write_text("format: insole-config/1\n" + text)
        return path

    return write


def problems(path: Path) -> list[tuple[int | None, str, str]]:
    with pytest.raises(DocumentError) as caught:
        load(path)
    return [(problem.line, problem.key, problem.message) for problem in caught.value.problems]


def test_the_repositorys_config_equals_the_built_in_one() -> None:
    assert load(ROOT / "config.yaml") == load() == Config()


def test_the_repositorys_file_mentions_every_key() -> None:
    text = (ROOT / "config.yaml").read_text()
    config = load()
    insole = config.insoles[0]
    for struct in (config, insole, insole.boards[0], config.publish, config.contact, config.boards, config.zenoh):
        for key in set(struct.__dataclass_fields__) - {"extensions"}:
            assert f"{key}:" in text


def test_the_built_in_configuration() -> None:
    config = load()
    assert config.rig == "insole1"
    assert config.buses == (Bus("socketcan", "can0"),)
    assert [(insole.foot, insole.addresses) for insole in config.insoles] == [
        ("left", (5, 6, 7)),
        ("right", (8, 9, 10)),
    ]
    boards = [board for insole in config.insoles for board in insole.boards]
    assert {(b.interface, b.period_ms, b.no_load, b.skin_type) for b in boards} == {("can0", 20, 240, 0)}
    assert (config.publish.slack_ms, config.publish.rate_hz, config.publish.stale_after_ms) == (5, 50, 200)
    assert config.contact.activation_threshold_count == 0
    assert config.boards.configure is False, "nothing is sent unless somebody says so"
    assert (config.contact.min_force_n, config.contact.min_pressure_pa) == (20, 20_000)
    assert (config.zenoh.mode, config.zenoh.listen) == ("peer", ("tcp/127.0.0.1:7447",))
    assert config.zenoh.connect == ()


def test_omitted_keys_have_the_built_in_values(write: Write) -> None:
    assert load(write("")) == Config()
    config = load(write("publish: {rate_hz: 100}\n"))
    assert (config.publish.rate_hz, config.publish.slack_ms) == (100, 5)


def test_structs_are_frozen_and_hashable() -> None:
    config = load()
    assert hash(config) == hash(Config())
    with pytest.raises(FrozenInstanceError):
        config.rig = "other"  # type: ignore[misc]


def test_paths_are_relative_to_the_file(write: Write) -> None:
    path = write(f"insoles:\n- foot: left\n  layout: maps/left.yaml\n  calibration: /etc/left.json\n  {BOARDS}\n")
    (insole,) = load(path).insoles
    assert insole.layout == path.parent / "maps/left.yaml"
    assert insole.calibration == Path("/etc/left.json")


def test_the_name_of_an_interface_is_the_channel(write: Write) -> None:
    text = "buses: [pcan:PCAN_USBBUS1, 'slcan:/dev/ttyACM0@1:2']\n"
    text += "insoles:\n- foot: left\n  layout: l.yaml\n  boards:\n"
    boards = "  - {address: 1, interface: PCAN_USBBUS1}\n  - {address: 2, interface: '/dev/ttyACM0@1:2'}\n"
    config = load(write(text + boards))
    assert config.buses == (Bus("pcan", "PCAN_USBBUS1"), Bus("slcan", "/dev/ttyACM0@1:2"))
    assert str(config.buses[1]) == "slcan:/dev/ttyACM0@1:2"


@pytest.mark.parametrize("bus", ["can0", "'socketcan:'", "':can0'", "'socketcan:can 0'", "5"])
def test_a_bus_is_driver_and_channel(write: Write, bus: str) -> None:
    line, key, message = problems(write(f"buses: [{bus}]\n"))[0]
    assert (line, key) == (2, "buses[0]")
    assert "expected a text driver:channel, such as socketcan:can0" in message


@pytest.mark.parametrize(
    ("text", "key", "message"),
    [
        ("rig: a/b", "rig", "expected text of letters, digits, - and _"),
        ("rig: '*'", "rig", "expected text of letters, digits, - and _"),
        ("publsh: {}", "publsh", 'did you mean "publish"?'),
        ("publish: {slack_s: 0.005}", "publish.slack_s", "The unit is part of the name: give it in ms"),
        ("publish: {rate_hz: 0}", "publish.rate_hz", "from 0.1 to 1000, found 0"),
        ("publish: {rate_hz: .nan}", "publish.rate_hz", "found nan"),
        ("publish:", "publish", "expected a map of keys, found nothing"),
        ("contact: {min_force_kn: 1}", "contact.min_force_kn", "give it in n"),
        ("contact: {activation_threshold_count: 256}", "contact.activation_threshold_count", "from 0 to 255"),
        ("boards: {configure: yes}", "boards.configure", "expected true or false"),
        ("boards: {configur: true}", "boards.configur", 'did you mean "configure"?'),
        ("zenoh: {mode: server}", "zenoh.mode", "expected one of peer, client, router"),
        ("zenoh: {listen: tcp/0.0.0.0:7447}", "zenoh.listen", "expected a list"),
        ("zenoh: {connect: ['127.0.0.1:7447']}", "zenoh.connect[0]", "such as tcp/127.0.0.1:7447"),
        ("insoles: []", "insoles", "expected a list of at least 1, found a list of 0"),
        ("buses: []", "buses", "expected a list of at least 1"),
        (
            "buses: [socketcan:can0, virtual:can0]",
            "buses[1]",
            "two buses with the channel can0, the other is buses[0]",
        ),
    ],
)
def test_wrong_values(write: Write, text: str, key: str, message: str) -> None:
    ((line, found_key, text_found),) = problems(write(text + "\n"))
    assert (line, found_key) == (2, key)
    assert message in text_found


@pytest.mark.parametrize(
    ("board", "key", "message"),
    [
        ("{address: 0, interface: can0}", "address", "expected a whole number from 1 to 14, found 0"),
        ("{address: 15, interface: can0}", "address", "from 1 to 14, found 15"),
        ("{address: 1, interface: can0, period_ms: 256}", "period_ms", "from 1 to 255, found 256"),
        ("{address: 1, interface: can0, period_s: 0.02}", "period_s", "give it in ms"),
        ("{address: 1, interface: can0, shift: 8}", "shift", "from 0 to 7, found 8"),
        ("{address: 1, interface: can0, no_load: 0}", "no_load", "from 1 to 255, found 0"),
        ("{address: 1, interface: can0, skin_type: 4}", "skin_type", "one of 0, 1, 2, 3, 7, 8, found 4"),
        ("{address: 1}", "interface", "missing key: expected text"),
        ("{address: 1, interface: can1}", "interface", 'the interface "can1" is not a channel of the buses'),
    ],
)
def test_wrong_boards(write: Write, board: str, key: str, message: str) -> None:
    text = f"insoles:\n- foot: left\n  layout: l.yaml\n  boards:\n  - {board}\n"
    ((line, found_key, text_found),) = problems(write(text))
    assert (line, found_key) == (6, f"insoles[0].boards[0].{key}")
    assert message in text_found


def test_two_boards_on_one_address_of_both_feet(write: Write) -> None:
    text = f"insoles:\n- foot: left\n  {BOARDS}\n- foot: right\n  boards:\n"
    right = "".join(f"  - {{address: {a}, interface: can0}}\n" for a in (8, 6, 10))
    ((line, key, message),) = problems(write(text + right))
    assert (line, key) == (8, "insoles[1].boards[1].address")
    assert "two boards on address 6, the other is insoles[0].boards[1]: " in message


def test_a_foot_twice(write: Write) -> None:
    text = f"insoles:\n- foot: left\n  {BOARDS}\n"
    text += "- layout: l.yaml\n  boards: [{address: 9, interface: can0}]\n  foot: left\n"
    ((line, key, message),) = problems(write(text))
    assert (line, key, message) == (7, "insoles[1].foot", "the left foot is listed twice, first in insoles[0]")


def test_the_built_in_layout_needs_three_boards(write: Write) -> None:
    ((line, key, message),) = problems(write("insoles:\n- foot: left\n  boards: [{address: 5, interface: can0}]\n"))
    assert (line, key) == (3, "insoles[0].layout")
    assert "expected a layout file, or 3 boards (front, middle, rear) for the built-in layout, found 1" in message
    found_problems = problems(
        write("insoles:\n- foot: left\n  boards:" + 3 * "\n  - {address: x, interface: can0}" + "\n")
    )
    assert {key.rpartition(".")[2] for _, key, _ in found_problems} == {"address"}  # three, if they were right


def test_other_buses_need_other_boards(write: Write) -> None:
    found_problems = problems(write("buses: [virtual:demo]\n"))
    assert [key for _, key, _ in found_problems] == ["insoles"]
    assert 'the interface "can0" is not a channel of the buses: demo' in found_problems[0][2]


def test_a_bus_that_is_wrong_is_not_held_against_its_boards(write: Write) -> None:
    text = f"buses: [can0, virtual:demo]\ninsoles:\n- foot: left\n  {BOARDS}\n"
    assert [key for _, key, _ in problems(write(text))] == ["buses[0]"]


def test_everything_at_once(write: Write) -> None:
    text = f"rig: a b\ninsoles:\n- foot: lef\n  {BOARDS}\n- foot: right\n  layout: l.yaml\n  boards:\n"
    right = "  - {address: 5, interface: can9}\n  - {address: 6, interface: can0, shft: 2}\n"
    places = [(line, key) for line, key, _ in problems(write(text + right + "publish: {slack_s: 1}\n"))]
    assert places == [
        (2, "rig"),
        (4, "insoles[0].foot"),
        (9, "insoles[1].boards[0].address"),
        (9, "insoles[1].boards[0].interface"),
        (10, "insoles[1].boards[1].shft"),
        (10, "insoles[1].boards[1].address"),
        (11, "publish.slack_s"),
    ]


def test_another_version(tmp_path: Path) -> None:
    path = tmp_path / "config.yaml"
    path.write_text("format: insole-config/2\nnews: 1\n")
    ((line, key, message),) = problems(path)
    assert (line, key) == (1, "format")
    assert "expected insole-config/1, found insole-config/2: this program reads version 1" in message


def test_importing_needs_neither_zenoh_nor_can() -> None:
    code = "import sys, insole_daemon.config; sys.exit(bool({'zenoh', 'can', 'numpy'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False, cwd=ROOT).returncode == 0


@pytest.mark.parametrize("kind", ["chamber", "shoe"])
def test_insoles_of_a_recording_have_the_same_shape(kind: str) -> None:
    @dataclass(frozen=True, slots=True, kw_only=True)
    class Recording(Section):
        kind: str
        can: str
        can_origin: str
        insoles: tuple[Insole, ...]
        reference: tuple[Any, ...]

    recording = read(EXAMPLES / kind / "recording.yaml", Recording, "insole-recording/1", check_insoles)
    assert recording.kind == kind
    assert recording.insoles[0].addresses == (5, 6, 7)
    assert recording.insoles[0].layout == EXAMPLES / kind / "layout.yaml"
