"""The page is complete, of one piece, and shows what the files say."""

from __future__ import annotations

import pkgutil
import re
from xml.etree import ElementTree

import pytest

import insole_daemon
from insole_daemon.diagnosis import candidates, writing
from insole_daemon.diagnosis.diagnosing import Diagnosis, diagnose
from insole_daemon.diagnosis.reporting.meanings import FAULTS, MEANINGS
from insole_daemon.diagnosis.reporting.report import html
from insole_daemon.diagnosis.reporting.untouched import untouched
from insole_daemon.errors import FileError
from insole_daemon.physics.effects import laws

from .chamber import LAYOUT, relaxing, write

BOARD_6 = LAYOUT.identities[:, 0].repeat(12) == 6


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory) -> Diagnosis:
    folder = write(tmp_path_factory.mktemp("solid") / "solid", relaxing(0.3, 0.8), BOARD_6, clock="own", seconds=60.0)
    return diagnose([insole_daemon.load(folder)], None, None, lambda text: None)


def test_it_loads_nothing_and_every_drawing_is_well_formed(diagnosed):
    page = html(diagnosed)
    assert not re.search(r'(src|href)="|<script|@import|url\((?!#)', page)
    drawings = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert len(drawings) > 10
    for each in drawings:
        ElementTree.fromstring(each)
        assert not re.search(r"\bnan\b|\binf\b", each)
    clips = re.findall(r'<clipPath id="(\w+)"', page)
    assert len(clips) == len(set(clips))


def test_what_the_file_says_stands_on_the_page(diagnosed):
    page = html(diagnosed)
    (finding,) = diagnosed.findings
    assert finding.sentence[1:] in page
    for name in finding.parameters:
        assert f'<td class="text">{name}</td>' in page
    for word in ("hysteresis", "creep", "static curves alone", "chosen"):
        assert f'<td class="text">{word}</td>' in page or word == "chosen" in page
    for limit in diagnosed.not_identifiable:
        assert limit["record_instead"] in page


def test_before_and_after_are_of_rows_that_were_held_out(diagnosed):
    (seen,) = untouched(diagnosed)
    assert seen.after.std() < 0.2 * seen.before.std()
    # A model that had seen every row leaves less than one that had not.
    best = seen.named.naming.best
    assert best.left_heldout > best.left


def test_a_page_of_a_null_says_that_nothing_was_found(tmp_path):
    diagnosis = diagnose([insole_daemon.load(write(tmp_path / "null", seconds=40.0))], None, None, lambda text: None)
    page = html(diagnosis)
    assert "what is left is noise" in page
    assert "Nothing was found" in page
    assert "which is not worth a word" in page


def test_faults_of_a_kind_are_one_line_on_page_one_and_each_a_row_below(tmp_path):
    def touch(t_s, counts):
        counts[:, :12] = 0.0
        counts[t_s > 20.0, 12:24] = 0.0  # what fails at another time is another finding

    folder = write(tmp_path / "open", touch=touch, seconds=40.0)
    page = html(diagnose([insole_daemon.load(folder)], None, None, lambda text: None))
    triangles = [".".join(map(str, each)) for each in LAYOUT.identities[:2].tolist()]
    assert page.count("<dt>Open triangle: a triangle that has lost contact</dt>") == 1
    for name in triangles:
        assert f'<td class="text">triangle {name}</td>' in page


def test_every_word_of_a_finding_has_a_meaning():
    words = {word for word, law in laws().items() if word in MEANINGS} | {"unknown", *FAULTS}
    assert set(MEANINGS) == words
    modules = {found.name for found in pkgutil.iter_modules(candidates.__path__)}
    assert modules < set(MEANINGS)


def test_a_page_that_cannot_be_written_leaves_nothing(diagnosed, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot be written"):
        writing.write(diagnosed, tmp_path / "file" / "out")
    out = tmp_path / "out"
    writing.write(diagnosed, out)
    assert sorted(path.name for path in out.iterdir()) == ["diagnosis.json", "model.json", "report.html"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "out"]
