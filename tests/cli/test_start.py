"""The start of a daemon loads no more than it needs."""

from __future__ import annotations

import subprocess
import sys

CODE = (
    "import sys\n"
    "from insole_daemon import cli\n"
    "try:\n"
    "    cli.main()\n"
    "finally:\n"
    "    loaded = {'pydantic', 'numpy.ma', 'insole_daemon.cli.diagnose'} & {*sys.modules}\n"
    "    print(*sorted(loaded))\n"
)


def start(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", CODE, *arguments], capture_output=True, text=True, check=False)


def test_run_starts_without_the_other_verbs_and_without_what_parses_their_options(tmp_path):
    done = start("run", "--config", str(tmp_path / "none.yaml"))
    assert (done.returncode, done.stdout) == (4, "\n")
    assert "there is no such file" in done.stderr


def test_options_of_run_in_another_form_mean_the_same(tmp_path):
    direct, parsed = (start("run", *option) for option in (("--config", "none"), ("--config=none",)))
    assert (direct.stderr, direct.returncode) == (parsed.stderr, parsed.returncode)
    assert parsed.stdout == "pydantic\n"
