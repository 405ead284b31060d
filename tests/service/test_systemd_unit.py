"""systemd's own programs read the files in systemd/, and a mistake in one of them is found."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

SYSTEMD = Path(__file__).parents[2] / "systemd"
UNIT = SYSTEMD / "insole-daemon.service"


@pytest.fixture(autouse=True)
def systemd_analyze() -> None:
    if shutil.which("systemd-analyze"):
        return
    missing = "systemd-analyze is not installed (Debian package systemd)"
    if os.environ.get("CI") == "true":
        pytest.fail(missing)
    pytest.skip(missing)


def check(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([SYSTEMD / "check", folder], capture_output=True, text=True, check=False)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    return Path(shutil.copytree(SYSTEMD, tmp_path / "systemd"))


def test_systemd_understands_every_file() -> None:
    result = check(SYSTEMD)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""


def test_exposure_is_2_at_most() -> None:
    review = subprocess.run(
        ["systemd-analyze", "security", "--no-pager", "--offline=true", UNIT],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    score = re.search(r"Overall exposure level for insole-daemon\.service: (\d+\.\d)", review)
    assert score, review
    assert float(score[1]) <= 2.0


@pytest.mark.parametrize(
    ("file", "right", "wrong"),
    [
        ("insole-daemon.service", "WatchdogSec=", "WatchdogSecs="),
        ("insole-daemon.service", "Type=notify", "Type=notifi"),
        ("real-time.conf", "CPUSchedulingPolicy=fifo", "CPUSchedulingPolicy=fifi"),
    ],
)
def test_a_typo_in_the_unit_file_is_detected(copy: Path, file: str, right: str, wrong: str) -> None:
    mistake(copy / file, right, wrong)
    result = check(copy)
    assert result.returncode == 1
    assert file in result.stderr


def test_a_sandbox_that_is_too_open_is_detected(copy: Path) -> None:
    unit = copy / UNIT.name
    unit.write_text(re.sub(r"^(Protect|Private|Restrict|SystemCall)\w+=.*$", "", unit.read_text(), flags=re.MULTILINE))
    result = check(copy)
    assert result.returncode == 1
    assert "too open" in result.stderr


@pytest.mark.parametrize(
    ("file", "right", "wrong"),
    [
        ("80-insole-can.network", "BitRate=1M", "BitRates=1M"),
        ("80-insole-can.network", "RestartSec=100ms", "RestartSec=soon"),
        ("70-insole-can.link", "TransmitQueueLength=128", "TransmitQueueLength=many"),
    ],
)
def test_a_typo_in_a_network_file_is_detected(copy: Path, file: str, right: str, wrong: str) -> None:
    mistake(copy / file, right, wrong)
    result = check(copy)
    if "not checked: .link and .network" in result.stdout:
        pytest.skip(result.stdout.splitlines()[-1])
    assert result.returncode == 1
    assert f"{file}:" in result.stderr


def mistake(file: Path, right: str, wrong: str) -> None:
    text = file.read_text()
    assert text.count(right) == 1
    file.write_text(text.replace(right, wrong))
