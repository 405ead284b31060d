"""docs/beyond-loopback.md as it stands: its commands make the certificates, its files run the daemon, its code reads.

Only addresses are exchanged for free ports of 127.0.0.1.
"""

from __future__ import annotations

import itertools
import os
import re
import shutil
import socket
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

import insole_daemon
from insole_daemon.config import Zenoh
from insole_daemon.errors import WireError
from insole_daemon.wire.exposure import exposures
from insole_daemon.wire.session import open_session
from tests.conftest import RunningDaemon
from tests.ports import free_port

DOC = Path(__file__).resolve().parents[2] / "docs" / "beyond-loopback.md"
INSOLE = Path(sys.executable).with_name("insole")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", DOC.read_text(), re.MULTILINE | re.DOTALL)


def blocks(language: str) -> list[str]:
    return [text for kind, text in BLOCKS if kind == language]


@dataclass
class Example:
    folder: Path
    loopback: str
    endpoint: str
    daemon: RunningDaemon

    def local(self, text: str) -> str:
        """What the page says, on this host and our ports."""
        for theirs, ours in (
            ("tls/192.168.1.10:7448", self.endpoint),
            ("tls/0.0.0.0:7448", self.endpoint),
            ("tcp/127.0.0.1:7447", self.loopback),
            ("192.168.1.10", "127.0.0.1"),
        ):
            text = text.replace(theirs, ours)
        return text

    def connect(self, name: str):
        return insole_daemon.connect(self.endpoint, config_file=self.folder / f"{name}.json5")


def certificate(folder: Path, name: str, *more: str, authority: str = "ca") -> None:
    """One more, made as the page makes those of who connects."""
    command = (
        "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 9 "
        f"-subj /CN={name} -CA {authority}.pem -CAkey {authority}.key -addext basicConstraints=critical,CA:FALSE "
        f"-addext extendedKeyUsage=clientAuth -keyout {name}.key -out {name}.pem"
    )
    subprocess.run([*command.split(), *more], cwd=folder, check=True, capture_output=True)


def expire(folder: Path, name: str) -> None:
    """expired.pem: the certificate of `name`, which has ended."""
    request = f"openssl req -new -key {name}.key -subj /CN={name} -out expired.csr"
    sign = "openssl x509 -req -in expired.csr -CA ca.pem -CAkey ca.key -days -1 -out expired.pem"
    for command in (request, sign):
        subprocess.run(command.split(), cwd=folder, check=True, capture_output=True)
    shutil.copy(folder / f"{name}.key", folder / "expired.key")


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    if not shutil.which("openssl"):
        assert not os.environ.get("CI"), "apt-get install openssl"
        pytest.skip("needs openssl")
    folder = tmp_path_factory.mktemp("tls")
    loopback, endpoint = f"tcp/127.0.0.1:{free_port()}", f"tls/127.0.0.1:{free_port()}"
    daemon = RunningDaemon(folder / "config.yaml", loopback, free_port(socket.SOCK_DGRAM))
    made = Example(folder, loopback, endpoint, daemon)
    make, (for_daemon, for_viewer), (config,) = blocks("sh")[0], blocks("json5"), blocks("yaml")
    subprocess.run(["sh", "-eu", "-c", made.local(make)], cwd=folder, check=True, capture_output=True)
    other = "openssl req -x509 -newkey rsa:2048 -nodes -subj /CN=other -keyout other.key -out other.pem"
    subprocess.run(other.split(), cwd=folder, check=True, capture_output=True)
    certificate(folder, "stranger")
    certificate(folder, "forged", authority="other")
    expire(folder, "viewer")
    (folder / "zenoh.json5").write_text(for_daemon)
    for name in ("viewer", "operator", "stranger", "forged", "expired"):
        (folder / f"{name}.json5").write_text(for_viewer.replace("viewer", name))
    (folder / "nobody.json5").write_text(re.sub(r"\n.*connect_\w+:.*", "", for_viewer))
    daemon.config_file.write_text("format: insole-config/1\nrig: test\nbuses: [virtual:can0]\n" + made.local(config))
    daemon.start()
    with daemon.boards():
        yield made
    daemon.end()


def test_the_pages_program_reads_a_walk(example):
    (program,) = blocks("python")
    process = subprocess.Popen(
        [sys.executable, "-c", example.local(program)], cwd=example.folder, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    forces = [float(line) for line in itertools.islice(process.stdout, 100)]
    process.kill()
    process.communicate()
    assert len(forces) == 100
    assert max(forces) > 100


def test_the_pages_commands(example):
    status, boards = (line.split()[1:] for line in example.local(blocks("sh")[1]).splitlines())
    done = subprocess.run([INSOLE, *status], cwd=example.folder, capture_output=True, text=True)
    assert "test left: ok" in done.stdout, done.stderr
    done = subprocess.run([INSOLE, *boards], cwd=example.folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert re.search(r"5 +can0 .* streaming ", done.stdout)


def test_a_viewer_may_subscribe_and_not_command(example):
    with example.connect("viewer") as insole:
        assert insole.feet() == [("test", "left"), ("test", "right")]
        assert insole.meta("left").rig == "test"
        for verb, arguments in (("boards", {"do": "list"}), ("zero", {})):
            with pytest.raises(WireError, match="may this client ask it"):
                insole.request("left", verb, **arguments)


def test_an_operator_may_ask_for_the_boards_and_a_zero(example):
    with example.connect("operator") as insole:
        assert [board["address"] for board in insole.request("left", "boards", do="list")["boards"]] == [5, 6, 7]
        assert insole.request("left", "zero", seconds=2.0)["ok"] is False, "somebody walks, and 2 s hold a stance"


def test_so_may_a_process_of_this_host_without_certificate(example):
    with insole_daemon.connect(example.loopback) as insole:
        assert next(insole.wrenches("left")).seq > 0
        assert insole.request("right", "boards", do="list")["boards"]


@pytest.mark.parametrize("name", ["viewer", "operator", "stranger"])
def test_only_the_daemon_can_publish_under_its_keys(example, name):
    with open_session("client", connect=[example.loopback]) as here:
        seen = []
        here.declare_subscriber("insole/test/left/wrench", lambda sample: seen.append(sample.payload.to_bytes()))
        config_file = example.folder / f"{name}.json5"
        with open_session("client", connect=[example.endpoint], config_file=config_file) as there:
            for _ in range(20):
                there.put("insole/test/left/wrench", b"forged")
            with example.connect("operator") as insole:
                list(itertools.islice(insole.wrenches("left"), 10))
        assert seen
        assert b"forged" not in seen


def test_a_certificate_with_another_name_gets_nothing(example):
    with example.connect("stranger") as insole:
        assert insole.feet() == []
        with open_session("client", connect=[example.endpoint], config_file=example.folder / "stranger.json5") as there:
            seen = []
            there.declare_subscriber("insole/**", seen.append)
            with example.connect("operator") as other:
                list(itertools.islice(other.wrenches("left"), 25))
            assert seen == []


@pytest.mark.parametrize("name", ["nobody", "forged", "expired"])
def test_without_a_certificate_of_the_authority_no_client_connects(example, name):
    with pytest.raises(WireError, match="certificate"), example.connect(name):
        pass


def test_plain_tcp_does_not_connect(example):
    with pytest.raises(WireError), insole_daemon.connect(example.endpoint.replace("tls/", "tcp/")):
        pass


def test_the_example_is_not_warned_about(example):
    listen = (example.loopback, "tls/0.0.0.0:7448")
    assert exposures(Zenoh(listen=listen, config_file=example.folder / "zenoh.json5")) == []


def test_the_doctor_finds_nothing_wrong_with_it(example):
    command = [INSOLE, "doctor", "--config", example.daemon.config_file]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"^ok +certificates +.*zenoh.json5", done.stdout, re.MULTILINE)
    output = " ".join(done.stdout.split())  # it is folded
    assert f"in use, as it seems by the daemon that answers on {example.loopback}" in output
    assert "exposure" not in done.stdout


def test_a_daemon_open_to_the_network_warns_when_it_starts(tmp_path):
    config = tmp_path / "config.yaml"
    boards = "".join(f"      - {{address: {address}, interface: nocan7}}\n" for address in (5, 6, 7))
    config.write_text(
        f"format: insole-config/1\nbuses: [socketcan:nocan7]\ninsoles:\n  - foot: left\n    boards:\n{boards}"
        "zenoh: {listen: [tcp/0.0.0.0:7447]}\n"
    )
    done = subprocess.run([INSOLE, "run", "--config", config], capture_output=True, text=True)
    assert "insole: warning: zenoh.listen: tcp/0.0.0.0:7447 is open to the network" in done.stderr


@pytest.mark.parametrize(
    ("zenoh", "words"),
    [
        (Zenoh(listen=("tcp/0.0.0.0:7447",)), "without encryption"),
        (Zenoh(listen=("tcp/[::]:7447",)), "without encryption"),
        (Zenoh(listen=("udp/insole.local:7447",)), "without encryption"),
        (Zenoh(mode="client", connect=("tcp/192.168.1.10:7447",)), r"zenoh\.connect"),
        (Zenoh(listen=("tls/0.0.0.0:7448",)), "enable_mtls"),
    ],
)
def test_access_open_to_others_is_reported(zenoh, words):
    (message,) = exposures(zenoh)
    assert re.search(words, message)


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:7447", "tcp/[::1]:1", "udp/localhost:1", "unixsock-stream//run/x"])
def test_loopback_is_not_warned_about(endpoint):
    assert exposures(Zenoh(listen=(endpoint,))) == []


def test_certificates_without_access_rules_are_warned_about(example, tmp_path):
    text = (example.folder / "zenoh.json5").read_text().replace("enabled: true", "enabled: false")
    for file in ("ca.pem", "daemon.pem", "daemon.key"):
        shutil.copy(example.folder / file, tmp_path)
    (tmp_path / "zenoh.json5").write_text(text)
    (message,) = exposures(Zenoh(listen=("tls/0.0.0.0:7448",), config_file=tmp_path / "zenoh.json5"))
    assert "access_control" in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{ listen: { endpoints: ['tcp/0.0.0.0:7447'] } }", r"zenoh\.listen"),
        ("{ mode: 'router' }", r"zenoh\.mode"),
        ("{ scouting: { multicast: { enabled: true } } }", "scouting/multicast/enabled .* always false"),
        ("{ listens: [] }", r"unknown field `listens`[^/]*$"),
        ("{ access_control: ", "JSON5"),
        ("{ transport: { link: { tls: { root_ca_certificate: 'none.pem' } } } }", "root_ca_certificate: .*none.pem"),
        (None, "cannot be read"),
    ],
)
def test_a_zenoh_configuration_that_is_refused(tmp_path, text, words):
    file = tmp_path / "zenoh.json5"
    if text is not None:
        file.write_text(text)
    with pytest.raises(WireError, match=words) as refused:
        open_session("peer", config_file=file)
    assert str(file) in str(refused.value)
    assert refused.value.exit_status == 4
