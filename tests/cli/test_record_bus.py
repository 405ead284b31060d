"""`insole record` on a host whose bus cannot be opened."""

from __future__ import annotations

from typer.testing import CliRunner

from insole_daemon.cli import app

NAME = "longer-than-a-name-may-be"  # of an interface: no kernel opens it

BOARDS = f"""insoles:
  - foot: left
    boards: [{{interface: {NAME}, address: 8}}, {{interface: {NAME}, address: 9}}, {{interface: {NAME}, address: 10}}]
"""


def test_a_bus_that_cannot_be_opened_names_the_way_to_record_a_daemon(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config.yaml").write_text(f"format: insole-config/1\nbuses: [socketcan:{NAME}]\n{BOARDS}")
    done = CliRunner().invoke(app, ["record", "walk", "--config", "config.yaml"])
    assert done.exit_code == 1
    assert NAME in str(done.exception)
    assert "add --remote" in str(done.exception)
    assert not (tmp_path / "walk").exists()
