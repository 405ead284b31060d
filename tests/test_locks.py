"""What is installed is pinned with hashes and its licences are known; what no program here may do is not done."""

from __future__ import annotations

import re
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
EXTRAS = PROJECT["project"]["optional-dependencies"]
# Weak copyleft binds who changes the package itself; none is part of the daemon but python-can, which is used as it is.
PERMISSIVE = r"MIT|BSD|Apache|ISC|PSF|Python Software Foundation|0BSD|Zlib|CC0|Unlicense"
WEAK_COPYLEFT = {"python-can", "certifi", "hypothesis", "pathspec"}


def lock(name: str) -> dict[str, list[tuple[Requirement, int]]]:
    """By package, what is locked (one entry a marker), and how many hashes it has."""
    requirements: dict[str, list[tuple[Requirement, int]]] = {}
    for entry in re.split(r"\n(?=\S)", (ROOT / "locks" / f"{name}.txt").read_text().strip()):
        line, *hashes = re.split(r"\s*\\\n\s*", entry)
        assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", text) for text in hashes), entry
        requirement = Requirement(line)
        requirements.setdefault(canonicalize_name(requirement.name), []).append((requirement, len(hashes)))
    return requirements


@pytest.mark.parametrize("name", ["base", *EXTRAS])
def test_a_lock_names_one_version_of_everything_with_hashes(name):
    needed = [*PROJECT["project"]["dependencies"], *EXTRAS.get(name, [])]
    if name == "base":
        needed += PROJECT["dependency-groups"]["build"]
    locked = lock(name)
    for entries in locked.values():
        for requirement, hashes in entries:
            assert re.fullmatch(r"==[\w.]+", str(requirement.specifier)), requirement
            assert hashes > 0, requirement
    for text in needed:
        requirement = Requirement(text)
        if requirement.name == PROJECT["project"]["name"]:  # extras of our own
            continue
        for entry, _ in locked[canonicalize_name(requirement.name)]:
            version = str(entry.specifier).removeprefix("==")
            assert requirement.specifier.contains(version), f"{text}: locked is {version}: run locks/make"


def test_all_locks_name_the_same_versions():
    versions: dict[str, set[str]] = {}
    for name in ("base", *EXTRAS):
        for package, entries in lock(name).items():
            versions.setdefault(package, set()).add(" ".join(sorted(str(entry.specifier) for entry, _ in entries)))
    assert {package: of_package for package, of_package in versions.items() if len(of_package) > 1} == {}


def test_bootstrap_installs_only_locked_packages():
    text = (ROOT / "bootstrap.py").read_text()
    installs = re.findall(r'pip\("install".*\)', text)
    assert len(installs) == 3
    for line in installs:
        assert "--require-hashes" in line or "--no-deps" in line or "--no-index" in line, line


def test_every_locked_package_has_a_known_licence():
    rows = re.findall(r"^\| (\S+) \| (.*) \| (\S.*) \|$", (ROOT / "docs" / "licences.md").read_text(), re.MULTILINE)[1:]
    listed = {canonicalize_name(name): licence for name, licence, _ in rows if name != "---"}
    here = set()
    for name in ("base", *EXTRAS):
        for package, entries in lock(name).items():
            if any(entry.marker is None or entry.marker.evaluate() for entry, _ in entries):
                here.add(package)
    assert here - listed.keys() == set(), "run locks/licences"
    for package, licence in listed.items():
        free = re.search(PERMISSIVE, licence) or package in WEAK_COPYLEFT
        assert free, f"{package}: {licence}: is it permissive? If it is, say so here"


def test_the_licences_are_those_that_are_installed():
    from importlib.machinery import SourceFileLoader
    from importlib.util import module_from_spec, spec_from_loader

    loader = SourceFileLoader("licences", str(ROOT / "locks" / "licences"))
    spec = spec_from_loader("licences", loader)
    assert spec is not None
    program = module_from_spec(spec)
    loader.exec_module(program)
    page = (ROOT / "docs" / "licences.md").read_text()
    known = 0
    for name in lock("base"):
        try:
            licence = program.licence(name)
        except metadata.PackageNotFoundError:
            continue
        known += 1
        assert f"| {name} | {licence} |" in page, "run locks/licences"
    assert known > 10


def test_no_program_here_unpickles():
    """Beside ruff's rules S (no pickle, no yaml.load, no shell): numpy would, if it were allowed to."""
    for folder in ("insole_daemon", "benchmarks", "docs"):
        for path in (ROOT / folder).rglob("*.py"):
            assert not re.search(r"allow_pickle\s*=\s*(?!False)", path.read_text()), path
    selected = PROJECT["tool"]["ruff"]["lint"]
    assert "S" in selected["select"]
    assert not [rule for rule in selected["ignore"] if rule in ("S301", "S302", "S403", "S506", "S602", "S604", "S605")]
