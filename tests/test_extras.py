"""The command that brings a package that is missing, where the program runs from."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from insole_daemon import extras


def test_an_environment_of_bootstrap_is_extended_by_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "bootstrap.json").write_text(json.dumps({"checkout": "/home/me/insole daemon"}))
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert extras.install_command("lab") == "python3 '/home/me/insole daemon/bootstrap.py' install lab"


def test_another_environment_is_extended_by_its_own_pip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setattr(sys, "executable", str(tmp_path / "bin" / "python"))
    assert extras.install_command("study") == f"{tmp_path}/bin/python -m pip install 'insole-daemon[study]'"


def test_pipx_replaces_what_it_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "pipx" / "venvs" / "insole-daemon"))
    assert extras.install_command("lab") == "pipx install --force 'insole-daemon[lab]'"


def test_beside_the_debian_package_pipx_installs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "prefix", "/usr")
    monkeypatch.setattr(extras, "__file__", "/usr/lib/insole-daemon/insole_daemon/extras.py")
    assert extras.install_command("lab") == "sudo apt install pipx && pipx install 'insole-daemon[lab]'"
