"""The report of a recording: one file, whole, with what the recording holds."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
import yaml

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.report.colours import CATEGORIES, MAGNITUDES
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial
from insole_daemon.view.recorded import recorded_page

INSOLE = Path(sys.executable).with_name("insole")
PAGE = Path(__file__).parents[2] / "insole_daemon" / "view" / "page"
CONFIG = Config()
LAYOUTS = [load_layout(insole) for insole in CONFIG.insoles]


class Seen(HTMLParser):
    """Names of the elements, and all text."""

    def __init__(self, html):
        super().__init__()
        self.elements, self.text = [], ""
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    return Trial("t4", CONFIG, LAYOUTS, seed=1).write(tmp_path_factory.mktemp("trial") / "walk", 12.0)


def test_the_command_writes_one_file_that_loads_nothing(walk, tmp_path):
    out = tmp_path / "walk.html"
    done = subprocess.run([INSOLE, "report", walk, "--out", out], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")
    html = out.read_text()
    assert not re.search(r"<script|<link|<img|@import|url\(", html.replace("url(#", ""))
    seen = Seen(html)
    assert sum(tag == "svg" for tag, _ in seen.elements) >= 10
    assert all("clip-path" not in attrs or attrs["clip-path"].startswith("url(#") for _, attrs in seen.elements)
    for words in ("highest pressure of every taxel, left foot", "f_z from 0 to", "cadence, steps/min", "Health"):
        assert words in seen.text, words
    assert "walk" in seen.text


def test_its_figures_are_those_of_the_recording(walk):
    recording = insole_daemon.load(walk)
    seen = Seen(recorded_page(recording))
    assert f"{recording['left'].wrench.f_z_n.max():.0f} N" in seen.text
    cadence = re.search(r"cadence, steps/min([\d.]+) ± [\d.]+ \((\d+)\)", seen.text)
    assert abs(float(cadence.group(1)) - 100) <= 3
    assert int(cadence.group(2)) >= 4


def test_a_recording_of_little_has_a_page_too(walk, tmp_path):
    for name, change in {
        "uncalibrated": lambda document: [insole.pop("calibration") for insole in document["insoles"]],
        "one foot": lambda document: (document["insoles"].pop(), document["reference"].pop()),
    }.items():
        folder = tmp_path / name
        folder.mkdir()
        for file in walk.iterdir():
            (folder / file.name).write_bytes(file.read_bytes())
        document = yaml.safe_load((walk / "recording.yaml").read_text())
        change(document)
        (folder / "recording.yaml").write_text(yaml.safe_dump(document))
        assert "Health" in recorded_page(insole_daemon.load(folder))
    empty = tmp_path / "empty"
    Trial("t4", CONFIG, LAYOUTS, seed=1).write(empty, 12.0)
    (empty / "can.log").write_text("(1760000000.000000) can0 123#00\n")  # nothing of ours
    assert "0.0 s" in recorded_page(insole_daemon.load(empty))


def test_the_live_page_has_the_same_colours():
    colours = (PAGE / "colours.js").read_text()
    anchors = re.search(r"VIRIDIS = \[(.*?)\];", colours, re.DOTALL).group(1)
    assert [[int(each) for each in row.split(",")] for row in re.findall(r"\[([\d, ]+)\]", anchors)] == (
        MAGNITUDES.astype(int).tolist()
    )
    style = (PAGE / "style.css").read_text()
    assert [f"--left: {CATEGORIES[0]}" in style, f"--right: {CATEGORIES[1]}" in style] == [True, True]


def test_a_folder_without_a_recording_is_reported(tmp_path):
    done = subprocess.run([INSOLE, "report", tmp_path], capture_output=True, text=True)
    assert done.returncode == 4
    assert "recording.yaml" in done.stderr
    assert not list(tmp_path.iterdir())
