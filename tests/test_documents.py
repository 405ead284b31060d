from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest

from insole_daemon.documents import (
    JSON_BYTES,
    MOST_PROBLEMS,
    YAML_BYTES,
    Reading,
    Section,
    at_least,
    matching,
    read,
    spell,
    within,
    wrong,
)
from insole_daemon.errors import DocumentError, SimulationError


@dataclass(frozen=True, slots=True, kw_only=True)
class Part(Section):
    number: Annotated[int, within(1, 14)]
    share: Annotated[float, within(0, 1)] = 0.5
    side: Literal["left", "right"] = "left"


@dataclass(frozen=True, slots=True, kw_only=True)
class Whole(Section):
    parts: Annotated[tuple[Part, ...], at_least(1)]
    slack_ms: Annotated[float, within(0, 1000)] = 5.0
    name: Annotated[str, matching("[a-z]+", " of small letters")] = "whole"
    flag: bool = False
    file: Path | None = None
    weights: tuple[float, ...] = ()
    free: Mapping[str, Any] | None = None


TAG = "test-whole/1"
Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(text: str | bytes, name: str = "document.yaml") -> Path:
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def load(path: Path, check: Callable[[Reading], None] | None = None) -> Whole:
    return read(path, Whole, TAG, check)


def problems(path: Path, check: Callable[[Reading], None] | None = None) -> list[tuple[int | None, str, str]]:
    with pytest.raises(DocumentError) as caught:
        load(path, check)
    assert caught.value.path == str(path)
    return [(problem.line, problem.key, problem.message) for problem in caught.value.problems]


def only(path: Path) -> tuple[int | None, str, str]:
    (problem,) = problems(path)
    return problem


def test_yaml_and_json_read_the_same(write: Write) -> None:
    yaml = write(
        f"format: {TAG}\nparts:\n  - {{number: 3, share: 1}}\nname: some\nfile: a/b.yaml\nweights: [1, 2e3, -.5]\n"
    )
    json = write(
        '{"format": "test-whole/1", "parts": [{"number": 3, "share": 1}], "name": "some",'
        ' "file": "a/b.yaml", "weights": [1, 2e3, -0.5]}',
        "document.json",
    )
    whole = load(yaml)
    assert whole == load(json)
    assert whole == Whole(
        parts=(Part(number=3, share=1.0),),
        name="some",
        file=yaml.parent / "a/b.yaml",
        weights=(1.0, 2000.0, -0.5),
    )
    assert isinstance(whole.parts[0].share, float)
    assert hash(whole)


def test_extensions_are_kept_at_every_level(write: Write) -> None:
    whole = load(
        write(f"format: {TAG}\nextensions: {{a: [1, {{b: 2}}]}}\nparts: [{{number: 1, extensions: {{c: null}}}}]\n")
    )
    assert whole.extensions == {"a": [1, {"b": 2}]}
    assert whole.parts[0].extensions == {"c": None}
    assert "map" in only(write(f"format: {TAG}\nparts: [{{number: 1}}]\nextensions: 5\n"))[2]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("slack_ms: yes", 'expected a finite number from 0 to 1000, found the text "yes"'),
        ("slack_ms: true", "expected a finite number from 0 to 1000, found true"),
        ("slack_ms: 1000.5", "expected a finite number from 0 to 1000, found 1000.5"),
        ("slack_ms: -1", "found -1"),
        ("slack_ms: .nan", "expected a finite number from 0 to 1000, found nan"),
        ("slack_ms: nan", "found nan"),
        ("slack_ms: .inf", "found inf"),
        ("slack_ms: 1e999", "found inf"),
        ("slack_ms: 1" + "0" * 400, "found inf"),
        ("slack_ms: '5'", 'found the text "5"'),
        ("slack_ms:", "found nothing"),
        ("slack_ms: [5]", "found a list of 1"),
        ("slack_ms: {a: 5}", "found a map of 1"),
        ("flag: 1", "expected true or false, found 1"),
        ("flag: no", 'expected true or false, found the text "no"'),
        ("name: Tom", 'expected text of small letters, found the text "Tom"'),
        ("name: 5", "expected text of small letters, found 5"),
        ("file: 5", "expected the path of a file, found 5"),
        ("weights: 5", "expected a list, found 5"),
        ("free: 5", "expected a map, found 5"),
        ("name: " + "x1" * 100, "…"),
    ],
)
def test_wrong_value(write: Write, line: str, message: str) -> None:
    found_line, key, text_found = only(write(f"format: {TAG}\nparts: [{{number: 1}}]\n{line}\n"))
    assert (found_line, key) == (3, line.partition(":")[0])
    assert message in text_found


@pytest.mark.parametrize(
    ("part", "key", "message"),
    [
        ("{number: 15}", "parts[0].number", "expected a whole number from 1 to 14, found 15"),
        ("{number: 5.0}", "parts[0].number", "expected a whole number from 1 to 14, found 5.0"),
        ("{number: true}", "parts[0].number", "found true"),
        ("{number: 1, side: Left}", "parts[0].side", 'expected one of left, right, found the text "Left"'),
        ("{side: left}", "parts[0].number", "missing key: expected a whole number from 1 to 14"),
        ("5", "parts[0]", "expected a map of keys, found 5"),
    ],
)
def test_wrong_value_in_a_list(write: Write, part: str, key: str, message: str) -> None:
    line, found_key, text_found = only(write(f"format: {TAG}\nparts:\n  - {part}\n"))
    assert (line, found_key) == (3, key)
    assert message in text_found


def test_a_list_has_a_least_length(write: Write) -> None:
    assert only(write(f"format: {TAG}\nparts: []\n"))[2] == "expected a list of at least 1, found a list of 0"


def test_numbers_are_those_of_json_and_hexadecimal(write: Write) -> None:
    whole = load(write(f"format: {TAG}\nparts: [{{number: 0xA}}, {{number: 07}}]\nweights: [1e1, +2, 3., -1E-2]\n"))
    assert [part.number for part in whole.parts] == [10, 7]
    assert whole.weights == (10.0, 2.0, 3.0, -0.01)


def test_unknown_key_proposes_the_one_that_was_meant(write: Write) -> None:
    line, key, message = only(write(f"format: {TAG}\nprats: [{{number: 1}}]\n"))
    assert (line, key) == (2, "prats")
    assert message == 'unknown key: did you mean "parts"?'  # and no second problem about `parts` missing


def test_the_error_of_an_unknown_key_lists_the_known_ones(write: Write) -> None:
    message = only(write(f"format: {TAG}\nparts: [{{number: 1}}]\nzzz: 1\n"))[2]
    assert message.startswith("unknown key: known here are ")
    assert "slack_ms" in message


@pytest.mark.parametrize("key", ["slack_s", "slack_us", "slack"])
def test_the_unit_is_part_of_the_name(write: Write, key: str) -> None:
    message = only(write(f"format: {TAG}\nparts: [{{number: 1}}]\n{key}: 1\n"))[2]
    assert message == 'unknown key: did you mean "slack_ms"? The unit is part of the name: give it in ms'


def test_everything_at_once_in_the_order_of_the_file(write: Write) -> None:
    text = f"""\
format: {TAG}
slack_s: 1
parts:
  - number: 99
    side: middle
  - {{number: 2, shar: 0.1}}

  - share: .nan
flag: maybe
flag: true
"""
    places = [(line, key) for line, key, _ in problems(write(text))]
    assert places == [
        (2, "slack_s"),
        (4, "parts[0].number"),
        (5, "parts[0].side"),
        (6, "parts[1].shar"),
        (8, "parts[2].share"),
        (8, "parts[2].number"),
        (10, "flag"),
    ]


def test_json_everything_at_once_with_lines(write: Write) -> None:
    text = """\
{
\t"format": "test-whole/1",
\t"slack_ms": NaN,
\t"parts": [
\t\t{"number":1,
\t\t "number":2},
\t\t{"numbr": 3}
\t],
\t"name": "\\u00fc\\/"
}
"""
    found_problems = problems(write(text, "document.json"))
    assert [(line, key) for line, key, _ in found_problems] == [
        (3, "slack_ms"),
        (6, "parts[0].number"),
        (7, "parts[1].numbr"),
        (9, "name"),
    ]
    assert "found nan" in found_problems[0][2]
    assert "twice, first on line 5" in found_problems[1][2]


def test_json_whose_lines_cannot_be_found_is_still_explained(write: Write) -> None:
    text = '{"format": "test-whole/1", "parts": [{"number": 1, "number": 2}], "name": "\\ud800"}'
    found_problems = problems(write(text, "document.json"))
    assert any("occur twice" in message or "occurs twice" in message for _, _, message in found_problems)
    assert any(key == "name" for _, key, _ in found_problems)


def test_duplicate_key_is_refused(write: Write) -> None:
    line, key, message = only(write(f"format: {TAG}\nparts: [{{number: 1}}]\nflag: true\n\nflag: false\n"))
    assert (line, key) == (5, "flag")
    assert "twice, first on line 3" in message


@pytest.mark.parametrize(
    ("tag", "message"),
    [
        (
            "test-whole/2",
            "expected test-whole/1, found test-whole/2: this program reads version 1 of test-whole",
        ),
        ("insole-layout/1", "expected test-whole/1, found insole-layout/1: this is another kind of file"),
        ("7", "expected test-whole/1, found 7"),
    ],
)
def test_another_format_or_version_is_the_only_problem(write: Write, tag: str, message: str) -> None:
    line, key, text_found = only(write(f"# text\nformat: {tag}\nwhatever: 1\n"))
    assert (line, key) == (2, "format")
    assert message in text_found


def test_missing_format(write: Write) -> None:
    line, key, message = only(write("parts: [{number: 1}]\n"))
    assert (line, key, message) == (1, "format", "missing key: expected format: test-whole/1")


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (f"format: {TAG}\nparts:\n\t- number: 1\n", 3, "a tab: YAML is indented with spaces"),
        (f"format: {TAG}\nparts: [1\nname: x\n", 3, "not YAML"),
        (f"format: {TAG}\n---\nformat: {TAG}\n", 2, "expected one document"),
        (f"format: {TAG}\nparts: &a [1]\n", 2, "anchors"),
        (f"format: {TAG}\nparts: *a\n", 2, "anchors"),
        (f"format: {TAG}\nparts: !!python/object:os.system [1]\n", 2, "tags"),
        (f"format: {TAG}\n? [a, b]\n: 1\n", 2, "expected a word as key"),
        ("- 1\n- 2\n", 1, "expected a map of keys that starts with format: test-whole/1, found a list of 2"),
        ("[" * 100_000, 1, "nested more than"),
        ("# only a comment\n", None, "expected a map"),
        ("a: \x07\n", None, "not YAML"),
    ],
)
def test_yaml_that_cannot_be_read(write: Write, text: str, line: int | None, message: str) -> None:
    problem = problems(write(text))[0]
    assert problem[0] == line
    assert message in problem[2]


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ('{\n"format": "test-whole/1",\n}', 3, "not JSON"),
        ("[" * 100_000, None, "not JSON that can be read"),
        ('{"a": ' + "1" * 5000 + "}", None, "not JSON that can be read"),
        ("[1]", 1, "expected a map of keys"),
    ],
)
def test_json_that_cannot_be_read(write: Write, text: str, line: int | None, message: str) -> None:
    problem = only(write(text, "document.json"))
    assert message in problem[2]
    assert line is None or problem[0] == line


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (b" \n\n", "empty"),
        (b"\x89PNG\r\n\x1a\n", "expected a text file"),
        (b"format: x\0", "expected a text file"),
    ],
)
@pytest.mark.parametrize("name", ["document.yaml", "document.json"])
def test_no_text(write: Write, name: str, content: bytes, message: str) -> None:
    assert message in only(write(content, name))[2]


def test_no_file(tmp_path: Path) -> None:
    line, key, message = only(tmp_path / "missing.yaml")
    assert (line, key) == (None, "")
    assert "cannot be read: there is no such file" in message
    assert "cannot be read: it is a folder" in only(tmp_path)[2]


@pytest.mark.parametrize(
    ("name", "most", "message"),
    [
        ("document.yaml", YAML_BYTES, "cannot be read: expected at most 0.3 MB, found 2.3 MB: is this the right file"),
        ("document.json", JSON_BYTES, "cannot be read: expected at most 1.0 MB, found 3.0 MB: is this the right file"),
    ],
)
def test_a_document_has_a_maximum_size(write: Write, name: str, most: int, message: str) -> None:
    head = b'{"format": "test-whole/1", "parts": [{"number": 1}]'
    assert load(write(head + b" " * (most - len(head) - 1) + b"}", name)).parts[0].number == 1
    assert "expected at most" in only(write(head + b" " * (most - len(head)) + b"}", name))[2]
    assert message in only(write(b" " * (most + 2_000_000), name))[2]


def test_an_endless_document_is_refused(tmp_path: Path) -> None:
    (tmp_path / "document.yaml").symlink_to("/dev/zero")
    assert "expected at most 0.3 MB" in only(tmp_path / "document.yaml")[2]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("document.json", '{"format": "test-whole/1", "parts": [' + "{}," * 300_000 + "{}]}"),
        ("document.json", '{"format": "test-whole/1", ' + '"k": 1,' * 120_000 + '"parts": 1}'),
        ("document.yaml", f"format: {TAG}\nparts: [" + "{a: 1}, " * 30_000 + "]\n"),
        ("document.yaml", f"format: {TAG}\n" + "k" * 200_000 + ": {a: 1}\nparts: [{number: 1, x: 1}]\n"),
        ("document.yaml", "format: " + "x" * 200_000),
    ],
)
def test_at_most_a_hundred_problems_are_listed(write: Write, name: str, text: str) -> None:
    found_problems = problems(write(text, name))
    assert len(found_problems) <= MOST_PROBLEMS + 1
    assert sum(len(key) + len(message) for _, key, message in found_problems) < 50_000
    if len(found_problems) > MOST_PROBLEMS:
        assert found_problems[-1] == (None, "", "there may be more problems: only 100 are listed, fix these first")


def test_byte_order_mark_is_read_over(write: Write) -> None:
    assert load(write(b"\xef\xbb\xbf" + f"format: {TAG}\nparts: [{{number: 1}}]\n".encode())).parts[0].number == 1


def test_checks_get_the_valid_parts_beside_invalid_ones(write: Write) -> None:
    seen = []

    def check(reading: Reading) -> None:
        seen.extend(reading.of(Part))
        reading.problem(("parts", 2, "number"), "not this one")

    found = problems(write(f"format: {TAG}\nparts:\n- {{number: 1}}\n- {{number: x}}\n- {{number: 3}}\n"), check)
    assert [(spell(key), part.number) for key, part in seen] == [("parts[0]", 1), ("parts[2]", 3)]
    assert [(line, key) for line, key, _ in found] == [(4, "parts[1].number"), (5, "parts[2].number")]


def test_message_is_one_line_a_problem(write: Write) -> None:
    path = write(f"format: {TAG}\nparts: 5\nflag: 5\n")
    with pytest.raises(DocumentError) as caught:
        load(path)
    assert str(caught.value).splitlines() == [
        f"{path}: line 2: parts: expected a list of at least 1, found 5",
        f"{path}: line 3: flag: expected true or false, found 5",
    ]


def test_finite_numbers_only(write: Write) -> None:
    whole = load(write(f"format: {TAG}\nparts: [{{number: 1}}]\nfree: {{x: .nan}}\n"))
    assert whole.free is not None
    assert math.isnan(whole.free["x"])  # what is free is kept as it stands


@dataclass(frozen=True, slots=True, kw_only=True)
class Span(Section):
    first: int
    last: int

    def __post_init__(self) -> None:
        if self.last < self.first:
            raise SimulationError(f"expected last after {self.first}, found {self.last}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Spans(Section):
    spans: tuple[Span, ...]


def test_a_struct_with_inconsistent_keys_is_refused_with_its_line(write: Write) -> None:
    path = write(f"format: {TAG}\nspans:\n- {{first: 1, last: 2}}\n- {{first: 3, last: 2}}\n")
    with pytest.raises(DocumentError, match=r"line 4: spans\[1\]: expected last after 3, found 2"):
        read(path, Spans, TAG)


def test_a_struct_made_by_hand_is_held_to_the_same_limits() -> None:
    assert not list(wrong(Whole(parts=(Part(number=1),))))
    whole = Whole(parts=(Part(number=1), Part(number=15, side="up")), slack_ms=math.nan)  # type: ignore[arg-type]
    assert [(spell(key), message) for key, message in wrong(whole)] == [
        ("parts[1].number", "expected a whole number from 1 to 14, found 15"),
        ("parts[1].side", 'expected one of left, right, found the text "up"'),
        ("slack_ms", "expected a finite number from 0 to 1000, found nan"),
    ]
