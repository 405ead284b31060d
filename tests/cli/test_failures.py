"""Every verb with every bad input: one message that names what is wrong, an exit status, and nothing half-written."""

from __future__ import annotations

import contextlib
import os
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from insole_daemon import cli
from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial
from insole_daemon.skin import layout as layouts
from tests.conftest import PATIENCE_S

INSOLE = Path(sys.executable).with_name("insole")
USAGE, REFUSED, NO_NETWORK, DEFECT = 2, 4, 3, 70


@pytest.fixture(scope="module")
def given(tmp_path_factory) -> Path:
    """Good recordings of the left foot, and one bad thing of every kind."""
    folder = tmp_path_factory.mktemp("given")
    left = Config().insoles[0]
    config = Config(insoles=(left,))
    layout = load_layout(left)
    Trial("plenum", config, [layout], seed=1).write(folder / "chamber", 12.0)
    Trial("t1", config, [layout], seed=2).write(folder / "walk", 4.0)
    right = Config().insoles[1]
    Trial("t1", Config(insoles=(right,)), [load_layout(right)], seed=3).write(folder / "right-walk", 3.0)
    (folder / "folder").mkdir()
    (folder / "study").mkdir()
    (folder / "study" / "study.yaml").write_text(
        "format: insole-study/1\nrecordings:\n"
        "  - {folder: ../walk, person: p01, session: before, condition: barefoot}\n"
    )
    (folder / "bytes").write_bytes(bytes(range(256)))
    (folder / "text.yaml").write_text("format: something-else/9\n")
    (folder / "mapping.yaml").write_text(
        "format: insole-table/1\nfoot: left\ntime: {column: t, unit: s}\nforce: {column: F, unit: N}\n"
        "cop_x: {column: X, unit: m}\ncop_y: {column: Y, unit: m}\n"
    )
    (folder / "right-mapping.yaml").write_text((folder / "mapping.yaml").read_text().replace("left", "right"))
    (folder / "forces.csv").write_text("t,F,X,Y\n" + "".join(f"{n / 100},{700 + n % 7},0.1,0\n" for n in range(400)))
    (folder / "text.json").write_text('{"format": "something-else/9"}')
    (folder / "left.yaml").write_text(
        "format: insole-config/1\nbuses: ['virtual:fails']\ninsoles:\n  - foot: left\n    boards:\n"
        + "".join(f"      - {{address: {address}, interface: fails}}\n" for address in (5, 6, 7))
    )
    layouts.write(folder / "left-layout.yaml", layout, "")
    return folder


def insole(monkeypatch, capsys, *arguments: object) -> tuple[int, str]:
    """(exit status, stderr) of the command, in this process."""
    monkeypatch.setattr(sys, "argv", ["insole", *map(str, arguments)])
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        cli.main()
    except SystemExit as end:
        printed = capsys.readouterr()
        assert "\x1b" not in printed.out + printed.err, "no terminal, no escape sequences"
        return int(end.code or 0), printed.err
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    raise AssertionError("the command did not end with a status")


# Arguments with {bad} where the bad thing stands, relative to the folder `given`; the statuses and words expected.
CONFIG = {
    "run": ("run", "--config", "{bad}"),
    "simulate": ("simulate", "--out", "new", "--config", "{bad}"),
    "record": ("record", "new", "--config", "{bad}"),
    "map": ("map", "--out", "new", "--config", "{bad}"),
    "import log": ("import", "walk/can.log", "new", "--config", "{bad}"),
    "bring-up": ("bring-up", "--config", "{bad}"),
}
RECORDING = {
    "report": ("report", "{bad}"),
    "export": ("export", "{bad}", "new.npz"),
    "calibrate": ("calibrate", "{bad}", "--out", "new.json"),
    "validate": ("validate", "{bad}", "--calibration", "chamber/calibration.json"),
    "diagnose": ("diagnose", "{bad}", "--out", "new"),
    "study": ("study", "{bad}"),
    "reference": ("reference", "{bad}", "bytes", "--foot", "left"),
}
OTHER_FILES = {
    "replay": ("replay", "{bad}", "--bus", "virtual:fails"),
    "import": ("import", "{bad}", "new", "--foot", "left"),
    "simulate --effects": ("simulate", "--out", "new", "--effects", "{bad}"),
    "simulate --trial": ("simulate", "--out", "new", "--trial", "{bad}"),
    "validate --calibration": ("validate", "walk", "--calibration", "{bad}"),
    "diagnose --calibration": ("diagnose", "chamber", "--out", "new", "--calibration", "{bad}"),
    "diagnose --simulation": ("diagnose", "chamber", "--out", "new", "--simulation", "{bad}"),
    "map --template": ("map", "--out", "new", "--config", "left.yaml", "--foot", "left", "--template", "{bad}"),
    "record --shoe": ("record", "new", "--config", "left.yaml", "--foot", "left", "--kind", "shoe",
                      "--reference", "-", "--shoe", "{bad}"),
    "reference of C3D": ("reference", "walk", "{bad}", "--foot", "left"),
    "reference of text": ("reference", "walk", "{bad}", "--mapping", "mapping.yaml"),
    "reference --mapping": ("reference", "walk", "bytes", "--mapping", "{bad}"),
    "import --layout": ("import", "bytes", "new", "--layout", "{bad}"),
}  # fmt: skip
CLIENTS = {verb: (verb, "--zenoh-config", "{bad}") for verb in ("watch", "status", "boards", "zero", "model", "view")}
ALL_FILES = {**CONFIG, **RECORDING, **OTHER_FILES, **CLIENTS}
BAD = {"missing file": "nothing-here", "folder": "folder", "wrong format": "bytes"}


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("verb", ALL_FILES)
def test_invalid_file_is_refused_in_one_message(verb, bad, given, monkeypatch, capsys):
    monkeypatch.chdir(given)
    status, stderr = insole(monkeypatch, capsys, *(word.format(bad=BAD[bad]) for word in ALL_FILES[verb]))
    assert status == REFUSED, stderr
    assert BAD[bad] in stderr
    assert len(stderr.strip().splitlines()) <= 6
    for internal in ("Traceback", "Errno", "codec", "(file)", "(folder)"):
        assert internal not in stderr
    assert not list(given.glob("*new*")), "nothing half-written"


@pytest.mark.parametrize("bad", ["nothing-here", "folder", "bytes"])
def test_doctor_reports_a_configuration_that_is_none_as_a_problem(bad, given, monkeypatch, capsys):
    monkeypatch.chdir(given)
    monkeypatch.setattr(sys, "argv", ["insole", "doctor", "--config", bad])
    with pytest.raises(SystemExit, match="1"):
        cli.main()
    assert f"→ correct {bad}, or name another file" in capsys.readouterr().out


def test_an_effect_that_a_chamber_cannot_show_is_refused_before_the_simulation(given, monkeypatch, capsys):
    monkeypatch.chdir(given)
    status, stderr = insole(monkeypatch, capsys, "demo", "--hide", "crosstalk", "--in", "chamber")
    assert status == USAGE
    assert stderr.startswith("insole: expected an effect that a chamber can show (hysteresis, ")


WRONG_FOOT = {
    "record": ("record", "new", "--config", "left.yaml", "--foot", "right"),
    "map": ("map", "--out", "new", "--config", "left.yaml", "--foot", "right"),
    "calibrate": ("calibrate", "chamber", "--out", "new.json", "--foot", "right"),
    "validate": ("validate", "walk", "--calibration", "right-walk/calibration.json"),
    "diagnose": ("diagnose", "chamber", "--out", "new", "--foot", "right"),
    "import": ("import", "bytes", "new", "--foot", "right", "--layout", "left-layout.yaml"),
    "bring-up": ("bring-up", "--config", "left.yaml", "--foot", "right", "--out", "new"),
    "reference": ("reference", "walk", "forces.csv", "--mapping", "right-mapping.yaml"),
}


@pytest.mark.parametrize("verb", WRONG_FOOT)
def test_a_layout_of_the_wrong_foot_is_reported(verb, given, monkeypatch, capsys):
    monkeypatch.chdir(given)
    status, stderr = insole(monkeypatch, capsys, *WRONG_FOOT[verb])
    assert status in (USAGE, NO_NETWORK, REFUSED), stderr
    assert "right" in stderr
    assert "Traceback" not in stderr
    assert not list(given.glob("*new*"))


EXISTING = {
    "report": ("report", "walk", "--out", "taken.html"),
    "calibrate": ("calibrate", "chamber", "--out", "taken.json"),
    "calibrate --report": ("calibrate", "chamber", "--out", "new.json", "--report", "taken.html"),
    "validate": ("validate", "walk", "--calibration", "walk/calibration.json", "--json", "taken.json"),
    "export": ("export", "walk", "taken.npz"),
    "export folder": ("export", "walk", "taken", "--to", "csv"),
    "diagnose": ("diagnose", "chamber", "--out", "taken-diagnosis"),
    "record": ("record", "taken", "--config", "left.yaml", "--foot", "left"),
    "simulate": ("simulate", "t1", "--out", "taken"),
    "import": ("import", "walk/can.log", "taken", "--config", "left.yaml"),
    "map": ("map", "--out", "taken", "--config", "left.yaml", "--foot", "left"),
}


@pytest.mark.parametrize("verb", EXISTING)
def test_an_existing_file_is_not_overwritten(verb, given, monkeypatch, capsys):
    monkeypatch.chdir(given)
    for folder in ("taken", "taken-diagnosis"):
        (given / folder).mkdir(exist_ok=True)
    files = [
        "taken.html", "taken.json", "taken.npz", "taken/file", "taken/left-layout.yaml", "taken-diagnosis/model.json",
    ]  # fmt: skip
    for name in files:
        (given / name).write_text("mine")
    status, stderr = insole(monkeypatch, capsys, *EXISTING[verb])
    assert status == REFUSED, stderr
    assert "taken" in stderr
    assert "already there" in stderr
    assert [(given / name).read_text() for name in files] == ["mine"] * len(files)
    for name in files:
        (given / name).unlink()


FORCED = {
    "report": (("report", "walk", "--out", "{out}"), "taken.html", b"<!doctype html>"),
    "export": (("export", "walk", "{out}"), "taken.csv", b"time_s,foot,f_z_n"),
}
FOLDERS = {  # what is made a second time, and a file of it
    "simulate": (("simulate", "stand", "--seconds", "0.5", "--out", "{out}"), "recording.yaml"),
    "import": (("import", "walk/can.log", "{out}", "--config", "left.yaml"), "recording.yaml"),
    "export": (("export", "walk", "{out}", "--to", "csv"), "steps.csv"),
}


@pytest.mark.parametrize("verb", FOLDERS)
def test_force_replaces_a_folder_that_the_command_made_and_no_other(verb, given, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(given)
    arguments, name = FOLDERS[verb]
    made, others = tmp_path / "made", tmp_path / "others"
    again = [word.format(out=made) for word in arguments]
    assert insole(monkeypatch, capsys, *again)[0] == 0
    before = (made / name).stat().st_ino
    assert insole(monkeypatch, capsys, *again)[0] == REFUSED
    assert insole(monkeypatch, capsys, *again, "--force")[0] == 0
    assert (made / name).stat().st_ino != before
    others.mkdir()
    (others / "letter.txt").write_text("mine")
    status, stderr = insole(monkeypatch, capsys, *(word.format(out=others) for word in arguments), "--force")
    assert status == REFUSED
    assert "replaces only what this command wrote" in stderr
    assert (others / "letter.txt").read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["made", "others"]


def test_output_replaced_with_force_is_restored_if_the_new_one_fails(given, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(given)
    out = tmp_path / "made"
    assert insole(monkeypatch, capsys, "simulate", "stand", "--seconds", "0.5", "--out", out)[0] == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    status, _ = insole(monkeypatch, capsys, "import", "bytes", out, "--foot", "left", "--force")
    assert status == REFUSED
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["made"]


@pytest.mark.parametrize("verb", FORCED)
def test_the_option_force_replaces_existing_output(verb, given, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(given)
    arguments, name, begins = FORCED[verb]
    out = tmp_path / name
    out.write_text("mine")
    status, stderr = insole(monkeypatch, capsys, *(word.format(out=out) for word in arguments), "--force")
    assert status == 0, stderr
    assert out.read_bytes().startswith(begins)
    assert "insole: next: " in stderr


FULL_DISK = {
    "report": ("report", "walk", "--out", "new.html"),
    "export npz": ("export", "walk", "new.npz"),
    "export csv": ("export", "walk", "new", "--to", "csv"),
    "export forces": ("export", "walk", "new.csv"),
    "export mat": ("export", "walk", "new.mat"),
    "export mcap": ("export", "walk", "new.mcap"),
    "simulate": ("simulate", "t1", "--out", "new", "--seconds", "3"),
    "import": ("import", "walk/can.log", "new", "--config", "left.yaml"),
    "record": ("record", "new", "--config", "left.yaml", "--foot", "left", "--seconds", "1"),
    "validate": ("validate", "walk", "--calibration", "walk/calibration.json", "--report", "new.html"),
    "study": ("study", "study"),
    "reference": ("reference", "walk", "forces.csv", "--mapping", "mapping.yaml", "--force"),
    "prove": ("prove", "--cases", "1", "--suite", "bench", "--seed", "5", "--out", "new"),
}


@pytest.mark.parametrize("verb", FULL_DISK)
def test_a_full_disk_is_reported_and_leaves_no_file(verb, given):
    def no_room() -> None:  # the kernel refuses every byte beyond these, as a full disk does
        resource.setrlimit(resource.RLIMIT_FSIZE, (2048, 2048))

    done = subprocess.run(
        [INSOLE, *FULL_DISK[verb]], capture_output=True, text=True, cwd=given, preexec_fn=no_room,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},  # Python would leave half of a compiled module
    )  # fmt: skip
    assert done.returncode == REFUSED, done.stderr
    assert {"study": "study/table", "reference": "walk"}.get(verb, "new") in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(given.glob("*new*"))


def test_a_full_disk_under_stdout_is_reported(given):
    with open("/dev/full", "w") as full:
        done = subprocess.run([INSOLE, "--version"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == REFUSED
    assert done.stderr.strip() == f"insole: {os.strerror(28)}"


@pytest.mark.parametrize("verb", ["status", "watch", "boards", "zero", "model", "view", "record"])
@pytest.mark.parametrize("prefix", ["tcp/", ""])
def test_an_endpoint_may_leave_out_tcp(verb, prefix, monkeypatch, capsys, tmp_path, endpoint):
    out = [tmp_path / "new", "--remote"] if verb == "record" else []
    address = endpoint.removeprefix("tcp/")
    status, stderr = insole(monkeypatch, capsys, verb, *out, "--connect", prefix + address)
    assert status == NO_NETWORK
    assert f"nobody answers on {endpoint}" in stderr


@pytest.mark.parametrize("endpoint", ["a b", "tcp/", "://", "host:port:7"])
def test_malformed_endpoint_is_wrong_usage(endpoint, monkeypatch, capsys):
    status, stderr = insole(monkeypatch, capsys, "status", "--connect", endpoint)
    assert status == USAGE
    assert "expected an endpoint such as tcp/127.0.0.1:7447" in stderr


@pytest.fixture
def taken_port():
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield listening.getsockname()[1]


def test_error_for_a_page_port_in_use_names_an_existing_option(taken_port, endpoint, monkeypatch, capsys):
    status, stderr = insole(monkeypatch, capsys, "demo", "--view", "--port", taken_port, "--listen", endpoint)
    assert status == NO_NETWORK
    assert f"--port {taken_port + 1}" in stderr


def not_ignoring_interrupts():
    """A shell starts programs in the background with interrupts ignored, these tests perhaps among them."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_interrupted_is_one_word_and_status_130(given):
    os.mkfifo(given / "endless.log")
    process = subprocess.Popen(
        [INSOLE, "import", "endless.log", "new", "--config", "left.yaml"], cwd=given, stderr=subprocess.PIPE, text=True,
        preexec_fn=not_ignoring_interrupts,
    )  # fmt: skip
    try:
        with open(given / "endless.log", "wb", buffering=0) as log:  # once it reads
            process.send_signal(signal.SIGINT)
            # A signal just before a read is only seen after it, and a read may wait for several bytes: the log goes on.
            until = time.monotonic() + PATIENCE_S
            with contextlib.suppress(BrokenPipeError):
                while process.poll() is None and time.monotonic() < until:
                    log.write(b"\n")
                    time.sleep(0.02)
        _, stderr = process.communicate(timeout=1)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 130, stderr
    assert stderr.strip().splitlines()[-1] == "insole: interrupted"
    assert "Traceback" not in stderr
    assert not list(given.glob("*new*"))


def test_a_defect_is_one_line_status_70_and_a_report(tmp_path):
    code = (
        "from insole_daemon import cli\n"
        "@cli.app.command()\n"
        "def broken(): {}['unexpected']\n"
        "import sys; sys.argv[1:] = ['broken']\n"
        "cli.main()"
    )
    environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert done.returncode == DEFECT
    assert len(done.stderr.splitlines()) == 1
    written = re.search(r"the details are in (\S+),", done.stderr)
    assert written is not None, done.stderr
    report = Path(written[1]).read_text()
    assert "KeyError: 'unexpected'" in report
    assert "['broken']" in report


@pytest.mark.parametrize(
    ("package", "verb", "extra"),
    [
        ("scipy", ("calibrate", "chamber", "--out", "new.json"), "lab"),
        ("scipy", ("export", "walk", "new.mat"), "lab"),
        ("mcap", ("export", "walk", "new.mcap"), "lab"),
        ("aiohttp", ("view",), "view"),
        ("distributed", ("study", "study"), "study"),
    ],
)
def test_a_missing_extra_is_one_line_with_the_command(package, verb, extra, given):
    code = (
        "import sys; sys.modules[sys.argv.pop(1)] = None\n"  # as if it were not installed
        "from insole_daemon import cli; cli.main()"
    )
    done = subprocess.run([sys.executable, "-c", code, package, *verb], capture_output=True, text=True, cwd=given)
    assert done.returncode == NO_NETWORK, done.stderr
    line = done.stderr.strip().splitlines()[-1]
    assert f"needs the package {package}" in line or f"needs {package}" in line
    assert f"install {extra}" in line or f"insole-daemon[{extra}]" in line


def on_a_terminal(given: Path, *arguments: str) -> tuple[int, list[str]]:
    """(exit status, lines) of the command on a terminal of 80 columns."""
    if shutil.which("script") is None:
        pytest.fail("needs the program script, of util-linux")
    command = f"stty columns 80; {INSOLE} {' '.join(arguments)}"
    done = subprocess.run(["script", "-qec", command, "/dev/null"], capture_output=True, text=True, cwd=given)
    return done.returncode, re.sub(r"\x1b\[[\d;]*m", "", done.stdout).splitlines()


def test_a_wide_table_is_whole_in_80_columns(given):
    status, lines = on_a_terminal(given, "validate", "walk", "--calibration", "walk/calibration.json")
    printed = "\n".join(lines)
    assert status == 0, printed
    assert max(len(line) for line in lines if "insole: next" not in line) <= 80  # a command, to be copied
    assert "…" not in printed
    assert re.search(r"CoP_y RMSE mm +[\d.–]+", printed)


def test_doctor_breaks_its_lines_between_words_in_80_columns(given):
    _, lines = on_a_terminal(given, "doctor", "--config", "left.yaml")
    findings = [line for line in lines if "→" not in line]  # remedies are commands, to be copied
    long = [line for line in findings if len(line) > 80]
    assert [line for line in long if " " in line.strip()] == []  # a path is one word
    assert any(line.startswith(" " * 28) for line in findings), "what is longer goes on below its beginning"
