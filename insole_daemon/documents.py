"""Reading of YAML and JSON files into frozen structs; one error lists all problems of a file.

A struct is the grammar of its part of a file: the fields of a `Section` are the keys of a map, their types are the
permitted values, and `Annotated` adds limits. YAML and JSON (by the name's ending) read the same: a plain word of YAML
has its meaning in JSON, so `no` and `on` are text and `1e3` is a number.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from os import PathLike
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, NoReturn, TypeVar, Union, get_args, get_origin, get_type_hints

import yaml

from .errors import DocumentError, InsoleError, Problem
from .files import read_at_most, unreadable
from .untrusted import quoted

Key = tuple[str | int, ...]  # ("insoles", 0, "foot") is spelled insoles[0].foot
T = TypeVar("T")
S = TypeVar("S", bound="Section")

MAX_DEPTH = 50  # of nested maps and lists; our formats need 7
YAML_BYTES = (
    1 << 18
)  # for files of people: a layout is 3 kB; the most expensive file takes a quarter of a second to read
JSON_BYTES = 1 << 20  # for files of programs: an effect for each of 480 taxels is 0.4 MB
MOST_PROBLEMS = 100  # reported for one file
_LONGEST_KEY = 80  # characters of a key in a message
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml if present: ten times faster
_BAD: Any = object()  # replaces a refused value
# Units at the end of keys, in our formats or in common use.
_UNITS = set(re.findall(r"\w+", "pa kpa bar n kn nm nmm m mm cm in m2 mm2 cm2 s ms us ns hz khz deg rad count pa2"))
_INT = re.compile(r"[-+]?[0-9]{1,300}|0x[0-9a-fA-F]{1,250}")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)(e[-+]?[0-9]+)?|[-+]?\.?(inf|nan|infinity)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Limit:
    """A limit of a value in addition to its type, for `Annotated`."""

    words: str  # follows the name of the type: "a whole number" + " from 1 to 14"
    allows: Callable[[Any], bool]


def within(low: float, high: float) -> Limit:
    """Limit a number to `low` to `high`, both allowed."""
    return Limit(f" from {low:g} to {high:g}", lambda value: low <= value <= high)


def at_least(n: int) -> Limit:
    """Require a list of n entries or more."""
    return Limit(f" of at least {n}", lambda value: len(value) >= n)


def entries(low: int, high: int) -> Limit:
    """Limit a list's number of entries to `low` to `high`, both allowed."""
    return Limit(f" of {low} to {high}", lambda value: low <= len(value) <= high)


def matching(regex: str, words: str) -> Limit:
    """Require a text that matches `regex` as a whole; `words` describe this to a person."""
    return Limit(words, lambda value: re.fullmatch(regex, value) is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """Base of every struct that mirrors a map of a file; `extensions` are kept without being read."""

    extensions: Mapping[str, Any] = field(default_factory=dict, hash=False, repr=False)


def read(path: str | PathLike[str], kind: type[S], tag: str, check: Callable[[Reading], None] | None = None) -> S:
    """Return the file `path`, which must have `format: <tag>`, as a `kind`; DocumentError lists all problems.

    `check` compares sections: `Reading.of` gives it those that are valid by themselves, even if others are not, and it
    reports with `Reading.problem`.
    """
    reading = Reading(Path(path))
    document = reading.document
    if not isinstance(document, dict):
        reading.refuse((), f"expected a map of keys that starts with format: {tag}, found {_describe_value(document)}")
    if document.get("format", tag) != tag:  # then nothing else can be judged
        reading.refuse(("format",), _describe_foreign_format(tag, document["format"]))
    if "format" not in document:
        reading.problem(("format",), f"missing key: expected format: {tag}")
    body = {name: value for name, value in document.items() if name != "format"}
    struct: S = reading.section(kind, body, (), also=("format",))
    if check is not None:
        check(reading)
    reading.finish()
    return struct


def wrong(struct: Section, key: Key = ()) -> Iterator[tuple[Key, str]]:
    """Yield the keys of a struct made in code whose values a file could not have, with what was expected there."""
    kind: Any = type(struct)
    for name, of_field in _grammar(kind)[0].items():
        yield from _wrong(of_field, getattr(struct, name), (*key, name))


def spell(key: Key) -> str:
    """Return `key` as a person writes it: insoles[0].boards[2].address; an empty text for the whole file."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part:.{_LONGEST_KEY}}" for part in key)
    return text.removeprefix(".")


class Reading:
    """One file while it is read: its plain values, its valid sections, and its problems."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._problems: list[tuple[Key, str, int | None]] = []
        self._found: list[tuple[Key, Any]] = []
        self._lines: dict[Key, int] = {}
        self._json = ""  # the text, if it is JSON
        json_by_name = path.suffix.lower() == ".json"
        text = self._decode(JSON_BYTES if json_by_name else YAML_BYTES)
        self.document: Any = self._parse_json(text) if json_by_name else self._parse_yaml(text)

    def problem(self, key: Key, message: str, line: int | None = None) -> None:
        """Report a problem at `key`; reading continues up to MOST_PROBLEMS."""
        self._problems.append((key, message, line))
        if len(self._problems) == MOST_PROBLEMS:
            self.finish()

    def refuse(self, key: Key, message: str, line: int | None = None) -> NoReturn:
        """Report a problem at `key` that makes further reading useless, and raise."""
        self.problem(key, message, line)
        self.finish()
        raise AssertionError

    def of(self, kind: type[T]) -> list[tuple[Key, T]]:
        """Return every valid `kind` of the file with its key."""
        return [(key, struct) for key, struct in self._found if isinstance(struct, kind)]

    def finish(self) -> None:
        """Raise DocumentError if there is any problem."""
        if self._problems:
            self._number_lines()
            problems = [Problem(line or self._line(key), spell(key), text) for key, text, line in self._problems]
            problems.sort(key=lambda problem: problem.line or 0)
            if len(problems) >= MOST_PROBLEMS:
                more = f"there may be more problems: only {MOST_PROBLEMS} are listed, fix these first"
                problems = [*problems[:MOST_PROBLEMS], Problem(None, "", more)]
            raise DocumentError(str(self.path), problems)

    def section(self, kind: Any, raw: Any, key: Key, also: tuple[str, ...] = ()) -> Any:
        """Return a `kind` from the map `raw`; `also` are keys that are read elsewhere."""
        if not isinstance(raw, dict):
            self.problem(key, f"expected {_expectation(_parse_type(kind))}, found {_describe_value(raw)}")
            return _BAD
        grammar, required = _grammar(kind)
        values: dict[str, Any] = {}
        meant: set[str] = set()
        for name, value in raw.items():
            if name in grammar:
                values[name] = self._value(grammar[name], value, (*key, name))
            else:
                near, hint = _nearest(name, (*grammar, *also))
                meant.add(near)
                self.problem((*key, name), f"unknown key{hint}")
        for name in grammar:
            if name in required - values.keys() - meant:
                self.problem((*key, name), f"missing key: expected {_expectation(grammar[name])}")
        values = {name: value for name, value in values.items() if value is not _BAD}
        if not required <= values.keys():
            return _BAD
        try:
            struct = kind(**values)
        except InsoleError as error:  # its fields do not fit together
            self.problem(key, str(error))
            return _BAD
        self._found.append((key, struct))
        return struct

    def _value(self, kind: _Type, raw: Any, key: Key) -> Any:
        base = kind.base
        if base is Any or (raw is None and kind.optional):
            return raw
        if kind.section:
            return self.section(base, raw, key)
        if base is float and type(raw) is int:
            raw = float(raw) if abs(raw) < 2**1023 else math.inf
        value: Any = _BAD
        if base is Literal:
            value = raw if any(type(raw) is type(choice) and raw == choice for choice in kind.choices) else _BAD
        elif kind.entry is not None and isinstance(raw, list) and kind.allows(raw):
            read = [self._value(kind.entry, item, (*key, i)) for i, item in enumerate(raw)]
            right = tuple(entry for entry in read if entry is not _BAD)
            # a list of numbers is valid or not as a whole; of a list of sections, checks get the valid ones
            return right if kind.entry.section or len(right) == len(raw) else _BAD
        elif base is Mapping and isinstance(raw, dict):
            value = raw
        elif base is Path and isinstance(raw, str) and raw:
            value = self.path.parent / raw
        elif hasattr(base, "parse") and isinstance(raw, str):
            value = base.parse(raw) or _BAD
            self._found.append((key, value))
        elif type(raw) is base and (base is not float or math.isfinite(raw)) and kind.allows(raw):
            value = raw
        if value is _BAD:
            self.problem(key, f"expected {_expectation(kind)}, found {_describe_value(raw)}")
        return value

    def _decode(self, most_bytes: int) -> str:
        try:
            text = read_at_most(self.path, most_bytes).decode("utf-8-sig")
        except OSError as error:
            self.refuse((), unreadable(error))
        except UnicodeDecodeError as error:
            self.refuse((), f"expected a text file (UTF-8), found other bytes from byte {error.start} on")
        if "\0" in text:
            self.refuse((), "expected a text file (UTF-8), found zero bytes in it")
        if not text.strip():
            self.refuse((), "the file is empty")
        return text

    def _parse_json(self, text: str) -> Any:
        duplicates: list[str] = []

        def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
            result = dict(pairs)
            if len(result) < len(pairs):
                duplicates.extend(name for name, n in Counter(name for name, _ in pairs).items() if n > 1)
            return result

        try:
            document = json.loads(text, object_pairs_hook=unique)
        except json.JSONDecodeError as error:
            self.refuse((), f"not JSON: {error.msg} (column {error.colno})", error.lineno)
        except (ValueError, RecursionError) as error:  # a number or a nesting beyond the limits
            self.refuse((), f"not JSON that can be read: {error}")
        self._json = text
        if duplicates:
            self._number_lines()  # which finds where
            if not self._problems:
                self.problem((), f"keys that occur twice in one map: {quoted(duplicates)}")
        return document

    def _number_lines(self) -> None:
        """Find the lines of the keys of a JSON file, which the JSON parser does not give."""
        if self._json and not self._lines and len(self._json) <= YAML_BYTES:
            self._lines[()] = 1
            # JSON is YAML, except for tabs between tokens and pairs of surrogates; with these, lines stay unknown
            try:
                self._node(_events(self._json.replace("\t", " ")), ())
            except (yaml.YAMLError, RecursionError):
                pass

    def _parse_yaml(self, text: str) -> Any:
        try:
            events = _events(text)
            document = self._node(events, ())
            for event in events:
                if isinstance(event, yaml.DocumentStartEvent):
                    self.refuse((), "expected one document, found a second after ---", _line_of_event(event))
            return document
        except RecursionError:
            self.refuse((), f"maps and lists are nested more than {MAX_DEPTH} deep")
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            start = text.splitlines()[mark.line : mark.line + 1] if mark else []
            tab = any(re.match(r" *\t", line) for line in start)
            reason = ", ".join(filter(None, (error.context, error.problem)))
            message = "a tab: YAML is indented with spaces" if tab else f"not YAML: {reason}"
            self.refuse((), message, mark.line + 1 if mark else None)
        except yaml.YAMLError as error:
            self.refuse((), f"not YAML: {' '.join(str(error).split())}")

    def _node(self, events: Iterator[Any], key: Key) -> Any:
        """Return the plain value that begins with the next event, and store the line of every key in it."""
        event = next(events, None)
        if event is None or isinstance(event, yaml.SequenceEndEvent):
            return _BAD
        self._lines.setdefault(key, _line_of_event(event))
        if isinstance(event, yaml.AliasEvent) or event.anchor or (event.tag and event.tag != "!"):
            message = "anchors (&), aliases (*) and tags (!) are not read: write plain values"
            self.problem(key, message, _line_of_event(event))
        if isinstance(event, yaml.ScalarEvent):
            return event.value if event.style else _parse_scalar(event.value)
        if isinstance(event, yaml.AliasEvent):
            return None
        if len(key) > MAX_DEPTH:
            raise RecursionError
        if isinstance(event, yaml.SequenceStartEvent):
            items: list[Any] = []
            while (item := self._node(events, (*key, len(items)))) is not _BAD:
                items.append(item)
            return items
        result: dict[str, Any] = {}
        while not isinstance(event := next(events), yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent):
                self.refuse(key, "expected a word as key, found a list, a map or an alias", _line_of_event(event))
            at = (*key, event.value)
            if event.value in result:
                first = self._lines[at]
                self.problem(at, f"this key occurs twice, first on line {first}: keep one", _line_of_event(event))
            self._lines.setdefault(at, _line_of_event(event))
            result[event.value] = self._node(events, at)
        return result

    def _line(self, key: Key) -> int | None:
        while key and key not in self._lines:
            key = key[:-1]
        return self._lines.get(key)


@dataclass(frozen=True, slots=True)
class _Type:
    base: Any
    choices: tuple[Any, ...]  # of a Literal
    entry: _Type | None  # of a list
    limits: tuple[Any, ...]
    optional: bool
    section: bool

    def allows(self, value: Any) -> bool:
        return all(limit.allows(value) for limit in self.limits)


@cache
def _parse_type(hint: Any) -> _Type:
    optional = get_origin(hint) in (Union, UnionType)
    if optional:  # the one union there is: something | None
        (hint,) = (arg for arg in get_args(hint) if arg is not type(None))
    hint, *limits = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    base = get_origin(hint) or hint
    section = isinstance(base, type) and issubclass(base, Section)
    choices = get_args(hint) if base is Literal else ()
    entry = _parse_type(get_args(hint)[0]) if base is tuple else None
    return _Type(base, choices, entry, tuple(limits), optional, section)


@cache
def _grammar(kind: Any) -> tuple[dict[str, _Type], set[str]]:
    """Return key → type, and the required keys."""
    hints = get_type_hints(kind, include_extras=True)
    required = {f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING}
    return {f.name: _parse_type(hints[f.name]) for f in fields(kind)}, required


def _wrong(kind: _Type, value: Any, key: Key) -> Iterator[tuple[Key, str]]:
    if isinstance(value, Section):
        yield from wrong(value, key)
    elif value is not None and (not kind.allows(value) or (kind.base is Literal and value not in kind.choices)):
        yield key, f"expected {_expectation(kind)}, found {_describe_value(value)}"
    elif kind.entry is not None and isinstance(value, tuple):
        for i, entry in enumerate(value):
            yield from _wrong(kind.entry, entry, (*key, i))


def _expectation(kind: _Type) -> str:
    names = {
        int: "a whole number", float: "a finite number", str: "text", bool: "true or false",
        tuple: "a list", Path: "the path of a file", Mapping: "a map",
        Literal: f"one of {', '.join(map(str, kind.choices))}", Any: "a value",
    }  # fmt: skip
    name = "a map of keys" if kind.section else names.get(kind.base) or kind.base.EXPECTED
    return name + "".join(limit.words for limit in kind.limits)


def _describe_value(value: Any) -> str:
    if isinstance(value, str):
        return f'the text "{value}"' if len(value) < 60 else f'the text "{value[:50]}…"'
    if isinstance(value, list | dict):
        return f"a {'list' if isinstance(value, list) else 'map'} of {len(value)}"
    return "nothing" if value is None else str(value).lower()


def _events(text: str) -> Iterator[Any]:
    """Yield the YAML events of `text` from its first value on; none if it has only comments."""
    skip = (yaml.StreamStartEvent, yaml.StreamEndEvent, yaml.DocumentEndEvent)
    events = (event for event in yaml.parse(text, Loader=_LOADER) if not isinstance(event, skip))
    next(events, None)  # the document's start
    return events


def _line_of_event(event: Any) -> int:
    return int(event.start_mark.line) + 1


def _parse_scalar(word: str) -> Any:
    if _INT.fullmatch(word):
        return int(word, 16 if word.startswith("0x") else 10)
    if _FLOAT.fullmatch(word):
        return float(word.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return {"": None, "~": None, "null": None, "true": True, "false": False}.get(word.lower(), word)


def _stem(key: str) -> tuple[str, str]:
    stem, _, unit = key.rpartition("_")
    return (stem, unit) if stem and unit in _UNITS else (key, "")


def _nearest(key: str, known_keys: Iterable[str]) -> tuple[str, str]:
    """Return the known key that `key` probably means ("" if none) and a hint for the message."""
    for name in known_keys:
        stem, unit = _stem(name)
        if unit and stem == _stem(key)[0]:
            return name, f': did you mean "{name}"? The unit is part of the name: give it in {unit}'
    from difflib import get_close_matches  # needed for messages only

    close = get_close_matches(key, list(known_keys), n=1)
    return (close[0], f': did you mean "{close[0]}"?') if close else ("", f": known here are {', '.join(known_keys)}")


def _describe_foreign_format(tag: str, format_found: Any) -> str:
    name, _, version = tag.partition("/")
    shown = format_found[:_LONGEST_KEY] if isinstance(format_found, str) else _describe_value(format_found)
    text = f"expected {tag}, found {shown}"
    if isinstance(format_found, str) and format_found.startswith(f"{name}/"):
        return f"{text}: this program reads version {version} of {name} and no other"
    return f"{text}: this is another kind of file"
