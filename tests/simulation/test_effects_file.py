"""Files of `insole simulate --effects`: assignment to the feet, and problems with key and allowed range."""

import pytest

from insole_daemon.errors import DocumentError, SimulationError
from insole_daemon.simulation import effects_file
from insole_daemon.skin import layout as layouts

LAYOUTS = [layouts.builtin("left", (5, 6, 7)), layouts.builtin("right", (8, 9, 10))]
LAG = "{effect: lag, where: {scope: insole}, parameters: {tau_s: {value: 0.02, unit: s}}}"


def read(tmp_path, *entries, name="effects.yaml"):
    path = tmp_path / name
    path.write_text("format: insole-effects/1\neffects:\n" + "".join(f"  - {entry}\n" for entry in entries))
    return effects_file.load(path, LAYOUTS)


def test_an_effect_applies_to_the_foot_of_its_boards(tmp_path):
    both = "{effect: gain, where: {scope: board, ids: [[6], [10]]}, parameters: {gain: {value: 1.2, unit: '1'}}}"
    one = "{effect: delay, where: {scope: triangle, ids: [[8, 0]]}, parameters: {delay_s: {value: 0.1, unit: s}}}"
    by_foot = read(tmp_path, LAG, both, one)
    assert [effect.law.word for effect in by_foot["left"]] == ["lag", "gain"]
    assert [effect.law.word for effect in by_foot["right"]] == ["lag", "gain", "delay"]
    assert by_foot["left"][1].where.ids == ((6,),)
    assert by_foot["right"][1].where.ids == ((10,),)


def test_two_triangles_are_swapped_on_one_foot(tmp_path):
    where = "where: {scope: triangle, ids: %s}, parameters: {pair: {value: %s, unit: '1'}}"
    swap = "{effect: swapped_triangles, " + where + "}"
    by_foot = read(tmp_path, swap % (("[[5, 0], [7, 3]]",) * 2))
    assert [len(by_foot[foot]) for foot in ("left", "right")] == [1, 0]
    with pytest.raises(
        SimulationError, match=r"pair: expected two triangles of one foot, found \[\[5, 0\], \[8, 0\]\]"
    ):
        read(tmp_path, swap % (("[[5, 0], [8, 0]]",) * 2))


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (LAG.replace("0.02", "-1"), r"effects\[0\]\.parameters\.tau_s.*expected a number from .* to .* s, found -1"),
        (LAG.replace("lag", "leg"), r'effects\[0\]\.effect: unknown effect "leg": did you mean "lag"'),
        (LAG.replace("unit: s", "unit: ms"), r'tau_s\.unit: expected the unit "s", found "ms"'),
        (LAG.replace("scope: insole", "scope: board, ids: [[12]]"), r"ids\[0\]: board 12 is not in the layout"),
        (LAG.replace("tau_s", "tau_ms"), r"tau_ms: unknown parameter"),
    ],
)
def test_problems_are_reported_with_key_and_range(tmp_path, entry, message):
    with pytest.raises(DocumentError, match=message):
        read(tmp_path, entry)


def test_a_file_of_another_format_is_refused(tmp_path):
    path = tmp_path / "effects.json"
    path.write_text("[]")
    with pytest.raises(DocumentError, match="insole-effects/1"):
        effects_file.load(path, LAYOUTS)
