"""The report is complete, one file, and has the content of the other files."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pytest
import typer

import insole_daemon
from insole_daemon.cli import app
from insole_daemon.diagnosis import writing
from insole_daemon.diagnosis.pipeline import diagnose
from insole_daemon.diagnosis.reporting.meanings import FAULTS, MEANINGS
from insole_daemon.diagnosis.reporting.what_now import REMEDIES
from insole_daemon.diagnosis.reporting.wrench import html
from insole_daemon.diagnosis.result import Diagnosis
from insole_daemon.diagnosis.terms import TERMS
from insole_daemon.errors import FileError
from insole_daemon.physics.effects import laws

from .chamber import LAYOUT, relaxing, write

BOARD_6 = LAYOUT.identities[:, 0].repeat(12) == 6


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory) -> Diagnosis:
    folder = write(tmp_path_factory.mktemp("solid") / "solid", relaxing(0.3, 0.8), BOARD_6, clock="own", seconds=60.0)
    return diagnose([insole_daemon.load(folder)], None, lambda text: None)


def test_the_page_loads_nothing_and_its_drawings_are_well_formed(diagnosed):
    page = html(diagnosed)
    assert not re.search(r'(src|href)="(?!data:)|<script|@import|url\((?!#)', page)  # figures to keep are in the page
    drawings = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert len(drawings) >= 3  # where it is, the load, the error
    for each in drawings:
        ElementTree.fromstring(each)
        assert not re.search(r"\bnan\b|\binf\b", each)
    clips = re.findall(r'<clipPath id="(\w+)"', page)
    assert len(clips) == len(set(clips))


def test_the_page_has_the_content_of_the_file(diagnosed):
    page = html(diagnosed)
    (finding,) = diagnosed.findings
    assert finding.sentence[1:] in page
    for name in finding.parameters:
        assert f'<td class="text">{name}</td>' in page
    for limit in diagnosed.not_identifiable:
        assert limit["record_instead"] in page


def test_the_page_has_remedies_and_the_insole(diagnosed):
    page = html(diagnosed)
    assert "The model beside this page undoes viscoelasticity" in page
    assert "insole validate OTHER-RECORDING --calibration model.json" in page
    assert "left: boards 5, 6, 7; calibration" in page


def test_errors_in_counts_are_also_in_kpa_and_n(diagnosed):
    page = html(diagnosed)
    (result,) = diagnosed.results
    seen = result.seen
    errors = re.findall(r"<b>([\d.]+) counts, ([\d.]+) kPa</b>", page)
    assert [float(counts) for counts, _ in errors] == [
        round(diagnosed.heldout[k], 1) for k in ("before", "after", "floor")
    ]
    # A taxel of these tests reads 1.6e-4 counts a pascal at first, and less the more it is loaded.
    slopes_kpa = [
        float(kpa) / diagnosed.heldout[k] for (_, kpa), k in zip(errors, ("before", "after", "floor"), strict=True)
    ]
    low, high = np.percentile(seen.slope_pa[:, seen.usable], (1, 99)) * 1e-3
    assert 5.5 < low < high < 20.0
    assert all(low < slope < high for slope in slopes_kpa)
    before_n, after_n = map(float, re.findall(r"<b>([\d.]+) → ([\d.]+) N</b>", page)[0])
    # The six triangles' taxels, of which two boards have no effect: a third of a reading's error, of the whole area.
    area_m2 = seen.usable.sum() * seen.layout.taxel_area_m2
    assert 0.1 < before_n / (float(errors[0][1]) * 1e3 * area_m2) < 1.0
    assert after_n < before_n / 2
    assert "error before and after in kPa" in page


def test_every_remedy_has_an_existing_effect_and_command():
    assert REMEDIES.keys() <= MEANINGS.keys()
    assert MEANINGS.keys() - REMEDIES.keys() <= {term.word for term in TERMS}  # physics is in the model
    verbs = {match for each in REMEDIES.values() for match in re.findall(r": insole ([a-z]+)", each)}
    assert "zero" in verbs
    assert verbs <= set(typer.main.get_command(app).commands)


def test_the_page_of_a_null_states_no_finding(tmp_path):
    page = html(diagnose([insole_daemon.load(write(tmp_path / "null", seconds=40.0))], None, lambda text: None))
    assert "what is left is noise" in page
    assert "Nothing was found" in page
    assert "What to do now" not in page


def test_faults_of_one_kind_are_one_entry_with_all_places(tmp_path):
    def touch(t_s, counts):
        counts[:, :12] = 0.0
        counts[t_s > 20.0, 12:24] = 0.0  # what fails at another time is another finding

    folder = write(tmp_path / "open", touch=touch, seconds=40.0)
    page = html(diagnose([insole_daemon.load(folder)], None, lambda text: None))
    assert page.count("<dt>Open triangle: a triangle that has lost contact</dt>") == 1
    for each in LAYOUT.identities[:2].tolist():
        assert f"riangle {'.'.join(map(str, each))}: lost contact" in page


def test_every_word_of_a_finding_has_a_meaning():
    of_terms = {each.word for each in TERMS if not each.is_internal}
    assert of_terms <= set(MEANINGS)
    assert set(MEANINGS) <= of_terms | set(laws()) | {"unknown", *FAULTS}


def test_a_page_that_cannot_be_written_leaves_nothing(diagnosed, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot be written"):
        writing.write(diagnosed, tmp_path / "file" / "out")
    out = tmp_path / "out"
    writing.write(diagnosed, out)
    assert sorted(path.name for path in out.iterdir()) == ["diagnosis.json", "model.json", "report.html"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "out"]
