"""The doctor on what there really is: this kernel, real sockets, real Zenoh sessions, real files, a real daemon."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insole_daemon.config import Bus, Config, Zenoh, load
from insole_daemon.physics import zero as zeros
from insole_daemon.physics.zero import Zero
from insole_daemon.service.doctor import boards, can, examine, files, host, network
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.wire.session import open_session
from tests.ports import free_port

INSOLE = Path(sys.executable).with_name("insole")


def only(findings, level=None):
    """The one finding, of that level."""
    matching = [finding for finding in findings if level is None or finding.level == level]
    assert len(matching) == 1, matching
    return matching[0]


# --- CAN


def has_can():
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def test_the_kernel_is_asked_itself():
    finding = only(can.check_kernel())
    if has_can():
        assert finding.level == "ok"
    else:
        assert finding.level == "problem"
        assert "modprobe can-raw" in finding.remedy


def test_how_a_kernel_gets_can(tmp_path):
    assert "on the host" in can.module_remedy("6.1.0", tmp_path)
    (tmp_path / "6.1.0").mkdir()
    assert "linux-modules-extra-6.1.0" in can.module_remedy("6.1.0", tmp_path)
    (tmp_path / "6.1.0" / "modules.dep").write_text("kernel/net/can/can-raw.ko: kernel/net/can/can.ko\n")
    assert can.module_remedy("6.1.0", tmp_path) == "sudo modprobe can-raw"


def test_a_missing_interface_and_one_that_is_not_can_are_refused():
    assert "no such interface" in only(can.check_interface(Bus("socketcan", "nocan7"), False)).text
    assert "no CAN interface" in only(can.check_interface(Bus("socketcan", "lo"), False)).text


def test_drivers_of_python_can():
    assert "no driver" in only(can.check_interface(Bus("pcann", "x"), False), "problem").text
    assert "within one process" in only(can.check_interface(Bus("virtual", "x"), False), "warning").text
    assert only(can.check_interface(Bus("slcan", "/dev/ttyACM0"), False)).level in ("ok", "problem")  # needs pyserial


def link(bit_rate_hz=1_000_000, state="ERROR-ACTIVE", flags=("NOARP", "UP", "LOWER_UP", "ECHO"), **data):
    """What iproute2 writes for a real controller (its ip/iplink_can.c), of which there is none here."""
    data = {"state": state, "restart_ms": 100, "bittiming": {"bitrate": bit_rate_hz, "sample_point": "0.750"}} | data
    return {"ifname": "can0", "flags": list(flags), "linkinfo": {"info_kind": "can", "info_data": data}}


@pytest.mark.parametrize(
    ("interface", "level", "words", "remedy"),
    [
        (link(), "ok", "up at 1000000", ""),
        (link(flags=("NOARP",)), "problem", "down", "sudo ip link set can0 up type can bitrate 1000000"),
        (link(500_000), "problem", "500000 bit/s, expected 1000000", "down && sudo ip link set can0 up type can"),
        (link(state="BUS-OFF"), "problem", "bus-off", "restart-ms 100"),
        (link(state="ERROR-PASSIVE"), "warning", "120 Ω", "ip -details"),
        (link(restart_ms=0), "warning", "stays off", "restart-ms 100"),
        (link(ctrlmode=["LISTEN-ONLY"]), "problem", "only listens", "listen-only off"),
        ({"flags": ["UP"]}, "warning", "without the program ip", "iproute2"),
        ({"flags": []}, "problem", "down", "sudo ip link set can0 up"),
    ],
)
def test_state_and_bit_rate(interface, level, words, remedy):
    worst = sorted(
        can.judge_interface("can0", interface, configure=True),
        key=lambda finding: ["problem", "warning", "ok"].index(finding.level),
    )
    assert worst[0].level == level
    assert words in worst[0].text
    assert remedy in worst[0].remedy


def test_a_bit_rate_of_a_controller_with_fixed_rates():
    data = {"state": "ERROR-ACTIVE", "restart_ms": 100, "bittiming_bitrate": 1_000_000}
    interface = {"flags": ["UP"], "linkinfo": {"info_kind": "can", "info_data": data}}
    assert only(can.judge_interface("can0", interface, configure=False)).level == "ok"


def test_listening_only_is_right_for_a_daemon_that_sends_nothing():
    assert only(can.judge_interface("can0", link(ctrlmode=["LISTEN-ONLY"]), configure=False)).level == "ok"


# --- the host


def test_the_receive_buffer_limit(tmp_path):
    limit = tmp_path / "rmem_max"
    limit.write_text("212992\n")
    finding = only(host.check_receive_buffer(limit), "warning")
    assert "212992" in finding.text
    assert "net.core.rmem_max=8388608" in finding.remedy
    limit.write_text("8388608\n")
    assert only(host.check_receive_buffer(limit)).level == "ok"
    limit.unlink()
    assert only(host.check_receive_buffer(limit)).level == "warning"
    assert len(list(host.check_receive_buffer())) == 1


def test_the_clock(monkeypatch):
    watch = host.ClockWatch()
    assert only(watch.findings()).level in ("ok", "warning"), "this host's own"
    real_ns = time.time_ns
    monkeypatch.setattr(host.time, "time_ns", lambda: real_ns() + 5_000_000_000)
    assert "stepped by +5000 ms" in only(watch.findings(), "warning").text
    monkeypatch.setattr(host.time, "time", lambda: 0.0)
    assert only(watch.findings()).level == "problem"


def test_where_zeros_are_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "not" / "yet"))
    assert only(host.check_state_folder()).level == "ok"
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "file" / "below"))
    assert only(host.check_state_folder()).level == "problem"


# --- the files


def test_every_error_of_a_configuration_is_a_problem(tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text("format: insole-config/1\nrigg: x\npublish:\n  slack_s: 0.005\nzenoh: {mode: client}\n")
    settings, findings = files.check_configuration(config)
    assert settings is None
    assert [finding.level for finding in findings] == ["problem"] * 3
    assert f"edit {config}, line 2: rigg" in findings[0].remedy
    assert {finding.subject for finding in examine(config)} == {"config", "receive buffer", "clock"}, "nothing guessed"


def test_a_built_in_calibration_is_a_warning():
    (left, _) = Config().insoles
    assert [finding.level for finding in files.check_foot(left, "rig", None)] == ["warning"] * 3


def calibrated(tmp_path, foot="left"):
    (left, _) = Config().insoles
    layout = load_layout(left)
    taxels = [
        {"board": b, "triangle": t, "taxel": k, "baseline_count": 240.0, "coefficients_pa": [0.0, 8000.0]}
        for b, t in layout.identities.tolist()
        for k in range(12)
        if k not in (6, 10)
    ]
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps({"format": "insole-calibration/1", "foot": foot, "taxels": taxels}))
    return replace(left, calibration=file, zero=tmp_path / "zero.json"), layout


def test_ages_of_calibration_and_zero(tmp_path):
    insole, layout = calibrated(tmp_path)
    os.utime(insole.calibration, (time.time() - 40 * 86_400,) * 2)
    count = np.full((len(layout), 12), 240.0)
    count[:, [6, 10]] = np.nan

    def findings(age_s):
        zeros.save(insole.zero, Zero("left", time.time_ns() - round(age_s * 1e9), count, count * 0), layout)
        return list(files.check_foot(insole, "rig", None))

    _, calibration, zero = findings(600)
    assert (calibration.level, zero.level) == ("ok", "ok")
    assert "280 taxels, written 40 days ago" in calibration.text
    assert "taken 10 minutes ago" in zero.text
    old = findings(3 * 86_400)[2]
    assert (old.level, old.remedy) == ("warning", "insole zero --foot left")
    assert "future" in findings(-3600)[2].text


def test_files_of_the_other_foot_are_problems(tmp_path):
    insole, _ = calibrated(tmp_path, foot="right")
    insole.zero.write_text("{}")
    problems = [finding for finding in files.check_foot(insole, "rig", None) if finding.level == "problem"]
    assert "expected the calibration of the left foot" in problems[0].text
    assert any(finding.subject == "left zero" for finding in problems)


# --- Zenoh


def config_with(**zenoh):
    return Config(zenoh=Zenoh(**zenoh))


def test_a_free_endpoint(endpoint):
    assert network.check_daemon(config_with(listen=(endpoint,))) == (None, [network.ok(endpoint, "free")])


def test_an_endpoint_of_another_program():
    with socket.create_server(("127.0.0.1", 0)) as server:

        def hang_up():
            with contextlib.suppress(OSError):  # the end of listening
                for connection, _ in iter(server.accept, None):
                    connection.close()

        answering = threading.Thread(target=hang_up)
        answering.start()
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        reached, findings = network.check_daemon(config_with(listen=(endpoint,)))
        server.shutdown(socket.SHUT_RDWR)  # which wakes the thread; closing does not
        answering.join()
    assert reached is None
    assert "does not let us in" in only(findings, "problem").text


def test_an_endpoint_of_another_zenoh_node_and_one_that_is_not_ours(endpoint):
    with open_session("router", [endpoint]):
        assert "no insole daemon" in only(network.check_daemon(config_with(listen=(endpoint,)))[1], "problem").text
    assert "cannot be listened on" in only(network.check_daemon(config_with(listen=("tcp/192.0.2.1:7447",)))[1]).text


def test_the_router_of_a_client_and_of_a_peer(endpoint):
    dead = f"tcp/127.0.0.1:{free_port()}"
    with open_session("router", [endpoint]):
        assert only(network.check_connects(config_with(mode="router", connect=(endpoint,)))).level == "ok"
        assert "mode: router" in only(network.check_connects(config_with(connect=(endpoint,))), "warning").remedy
    assert only(network.check_connects(config_with(mode="router", connect=(dead,)))).level == "warning"
    assert only(network.check_connects(config_with(mode="client", connect=(dead,)))).level == "problem"


def test_an_open_listener_and_an_open_key(tmp_path):
    assert only(network.check_exposure(config_with(listen=("tcp/0.0.0.0:7447",)))).level == "warning"
    file = tmp_path / "zenoh.json5"
    file.write_text("{ transport: { link: { tls: { listen_private_key: 'daemon.key' } } } }")
    assert only(network.check_exposure(config_with(config_file=file))).level == "problem", "there is no such key"
    (tmp_path / "daemon.key").write_text("")
    (tmp_path / "daemon.key").chmod(0o644)
    assert "chmod 600" in only(network.check_exposure(config_with(config_file=file)), "warning").remedy
    (tmp_path / "daemon.key").chmod(0o600)
    assert only(network.check_exposure(config_with(config_file=file))).level == "ok"


# --- the daemon that runs


def board(**changes):
    return {
        "address": 5, "type": "MTB4", "firmware": "1.25.0", "bootloader": False, "state": "streaming", "rate_hz": 50.0,
        "change_rate_hz": 27.0, "open_triangles": [], "differences": [],
    } | changes  # fmt: skip


@pytest.mark.parametrize(
    ("entry", "level", "words"),
    [
        (board(), "ok", "MTB4 with firmware 1.25.0, sends 50.0 Hz, new values 27.0 Hz"),
        (board(state="silent"), "problem", "silent"),
        (board(bootloader=True), "problem", "bootloader"),
        (board(type="MTB", firmware="2.9.1"), "warning", "older than 2.10.16"),
        (board(type="MTB", firmware="2.17.0"), "ok", "2.17.0"),
        (board(type=None, firmware=None, bootloader=None), "ok", "does not say what it is"),
        (board(open_triangles=[3, 4]), "warning", "triangle 3, 4: not connected"),
        (board(differences=["every 50 ms, expected 20"]), "warning", "every 50 ms"),
    ],
)
def test_boards(entry, level, words):
    first = next(boards.judge_board(entry, "left", configure=True))
    assert first.level == level
    assert words in first.text
    assert level == "ok" or first.remedy


def doctor(*arguments):
    done = subprocess.run([INSOLE, "doctor", *arguments], capture_output=True, text=True)
    assert "Traceback" not in done.stderr
    return done


def test_a_daemon_that_runs_and_one_that_does_not(daemon):
    daemon.config_file.write_text(daemon.config_file.read_text() + "buses: [virtual:can0]\n")
    with daemon.boards():
        time.sleep(1.5)
        done = doctor("--config", daemon.config_file)
    assert done.returncode == 0, done.stdout
    assert "the daemon answers: rig test, left and right" in done.stdout
    for address in range(5, 11):
        assert f"board {address}" in done.stdout
    assert "not asked what it is (boards: {configure: false}), sends " in " ".join(done.stdout.split())
    assert done.stdout.splitlines()[-1].startswith("0 problems, ")
    done = doctor("--config", daemon.config_file)  # the boards are gone
    assert done.returncode == 1
    assert "silent: is it powered and connected?" in done.stdout
    daemon.end()
    done = doctor("--config", daemon.config_file)
    assert done.returncode == 0
    assert f"insole run --config {daemon.config_file}" in done.stdout
    daemon.start()


def test_a_daemon_with_another_calibration_and_another_rig(daemon, tmp_path):
    insole, _ = calibrated(tmp_path)
    file = json.loads(insole.calibration.read_text())
    for taxel in file["taxels"]:
        taxel["coefficients_pa"] = [0.0, 9000.0]
    insole.calibration.write_text(json.dumps(file))
    settings = load(daemon.config_file)
    with boards.Running(settings, daemon.endpoint, None) as running:
        _, other, _, zero = files.check_foot(replace(insole, zero=None), "test", running.meta("left"))
    assert "the daemon that runs applies another one: built-in" in other.text
    assert zero.level == "warning"
    reached, findings = network.check_daemon(replace(settings, rig="another"))
    assert reached is None
    assert "the daemon of rig test listens there" in only(findings, "problem").text
    with boards.Running(replace(settings, rig="another"), reached, None) as running:
        (alone,) = running.findings()
    assert alone.text.startswith("none of rig another runs"), "the line on the endpoint has named one of another rig"
