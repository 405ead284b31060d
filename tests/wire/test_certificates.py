"""docs/beyond-loopback.md from the other side: a false daemon is refused; and every command is a right of its own.

Sessions of this process stand for daemons: what is tested are certificates and rules, on loopback.
"""

from __future__ import annotations

import contextlib
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import zenoh

import insole_daemon
from insole_daemon.errors import WireError
from insole_daemon.service import daemon as daemon_module
from insole_daemon.wire.requests import REPLY_SCHEMA, encoding, pack
from insole_daemon.wire.session import open_session
from tests.ports import free_port
from tests.wire.test_beyond_loopback import blocks, certificate

FOR_DAEMON, FOR_VIEWER = blocks("json5")
VERBS = ("boards", "zero", "model")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The page's certificates, and daemons that are not what they say."""
    if not shutil.which("openssl"):
        pytest.skip("needs openssl")
    made = tmp_path_factory.mktemp("certificates")
    make = blocks("sh")[0].replace("192.168.1.10", "127.0.0.1")
    subprocess.run(["sh", "-eu", "-c", make], cwd=made, check=True, capture_output=True)
    other = "openssl req -x509 -newkey rsa:2048 -nodes -subj /CN=other -keyout other.key -out other.pem"
    subprocess.run(other.split(), cwd=made, check=True, capture_output=True)
    certificate(made, "a-client", "-addext", "subjectAltName=IP:127.0.0.1")  # of the authority, made for connecting
    for name, authority, address, days in (
        ("stolen-name", "other", "127.0.0.1", 9),
        ("elsewhere", "ca", "192.0.2.7", 9),
        ("ended", "ca", "127.0.0.1", -1),
    ):
        (made / "names.cnf").write_text(f"subjectAltName=IP:{address}\nextendedKeyUsage=serverAuth\n")
        for command in (
            f"openssl req -new -newkey rsa:2048 -nodes -subj /CN=daemon -keyout {name}.key -out {name}.csr",
            (
                f"openssl x509 -req -in {name}.csr -CA {authority}.pem -CAkey {authority}.key -days {days} "
                f"-extfile names.cnf -out {name}.pem"
            ),
        ):
            subprocess.run(command.split(), cwd=made, check=True, capture_output=True)
    for name in ("viewer", "operator"):
        (made / f"{name}.json5").write_text(FOR_VIEWER.replace("viewer", name))
    return made


@contextlib.contextmanager
def standing_in(folder: Path, configuration: str):
    """A session with TLS that answers what a daemon answers; its endpoint."""
    endpoint = f"tls/127.0.0.1:{free_port()}"
    (folder / "stand-in.json5").write_text(configuration)
    with open_session("peer", listen=[endpoint], config_file=folder / "stand-in.json5") as session:
        token = session.liveliness().declare_token("insole/test/left/alive")
        for verb in (*VERBS, "reload"):
            session.declare_queryable(f"insole/test/left/{verb}", _answer, complete=True)
        yield endpoint
        token.undeclare()


def _answer(query: zenoh.Query) -> None:
    query.reply(query.key_expr, pack({"done": True}), encoding=encoding(REPLY_SCHEMA))


@pytest.mark.parametrize("name", ["stolen-name", "elsewhere", "ended", "a-client"])
def test_a_client_refuses_a_daemon_with_a_wrong_certificate(folder, name):
    false = FOR_DAEMON.replace('"daemon.pem"', f'"{name}.pem"').replace('"daemon.key"', f'"{name}.key"')
    with standing_in(folder, false) as endpoint:
        with pytest.raises(WireError, match="this program that of the other side"):
            insole_daemon.connect(endpoint, config_file=folder / "viewer.json5").open()


def permitted(folder, configuration, name):
    with standing_in(folder, configuration) as endpoint:
        with insole_daemon.connect(endpoint, config_file=folder / f"{name}.json5") as insole:
            assert insole.feet() == [("test", "left")]
            done = set()
            for verb in (*VERBS, "reload"):
                with contextlib.suppress(WireError):
                    done |= {verb} if insole.request("left", verb)["done"] else set()
            return done


def test_the_documented_access_rules_permit_what_the_page_states(folder):
    assert permitted(folder, FOR_DAEMON, "operator") == set(VERBS)
    assert permitted(folder, FOR_DAEMON, "viewer") == set()


@pytest.mark.parametrize("verb", VERBS)
def test_a_command_is_permitted_alone(folder, verb):
    alone = re.sub(r'"insole/\*/\*/boards", [^]]*"insole/\*/\*/model"', f'"insole/*/*/{verb}"', FOR_DAEMON)
    assert alone != FOR_DAEMON
    assert permitted(folder, alone, "operator") == {verb}


def test_the_rules_list_every_command():
    offered = set(re.findall(r'\.offer\("(\w+)"', Path(daemon_module.__file__).read_text()))
    assert offered == set(VERBS)
    (command,) = re.findall(r'id: "command".*?key_exprs: \[(.*?)\]', FOR_DAEMON, re.DOTALL)
    assert set(re.findall(r"/(\w+)\"", command)) == offered, (
        "reload is none: it takes a signal, from root or the same user"
    )
