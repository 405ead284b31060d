"""The name of a result says all that it depends on."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial
from insole_daemon.study.content import content_key


@pytest.fixture
def recording(tmp_path):
    left = Config().insoles[0]
    return Trial("t1", Config(insoles=(left,)), [load_layout(left)], seed=1).write(tmp_path / "recording", 1.0)


def replace_in(path, before, after):
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))


def test_a_log_of_any_name_and_a_layout_outside_the_folder_are_part_of_the_key(recording, tmp_path):
    (recording / "can.log").rename(recording / "walk.txt")
    (recording / "layout.yaml").rename(tmp_path / "shared.yaml")
    replace_in(recording / "recording.yaml", "can: can.log", "can: walk.txt")
    replace_in(recording / "recording.yaml", "layout: layout.yaml", "layout: ../shared.yaml")
    first = content_key(recording, "steps", [])
    assert content_key(recording, "steps", []) == first
    with open(recording / "walk.txt", "a") as log:
        log.write("\n")
    longer_log = content_key(recording, "steps", [])
    with open(tmp_path / "shared.yaml", "a") as layout:
        layout.write("# moved\n")
    assert len({first, longer_log, content_key(recording, "steps", [])}) == 3


def test_counts_that_are_still_a_folder_are_part_of_the_key(recording):
    (recording / "counts").mkdir()
    replace_in(recording / "recording.yaml", "can: can.log", "counts: counts")
    keys = set()
    for content in (b"1", b"2"):
        (recording / "counts" / "left.npy").write_bytes(content)
        keys.add(content_key(recording, "steps", []))
    assert len(keys) == 2


def test_a_report_in_the_folder_is_not_part_of_the_key(recording):
    before = content_key(recording, "steps", [])
    (recording / "report.html").write_text("<html>")
    assert content_key(recording, "steps", []) == before


def test_a_changed_line_of_the_program_makes_another_key_though_its_version_stays(tmp_path):
    copy = shutil.copytree(
        Path(insole_daemon.__file__).parent, tmp_path / "insole_daemon", ignore=shutil.ignore_patterns("__pycache__")
    )
    code = "from insole_daemon.study.content import program_digest as digest; print(digest())"

    def digest():
        command = [sys.executable, "-P", "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r}); {code}"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    first = digest()
    (copy / "_kernel.abi3.so").write_bytes(b"compiled elsewhere")
    assert digest() == first
    with open(copy / "mechanics" / "gait" / "steps.py", "a") as module:
        module.write("# changed\n")
    assert digest() != first
