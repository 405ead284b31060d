"""The subscriber of the README, as it stands there."""

from __future__ import annotations

import re

from processes import ROOT, python


def test_the_subscriber_of_the_readme(daemon, tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert code.count("insole_daemon.connect()") == 1
    program = tmp_path / "subscriber.py"
    # Only where the daemon listens is another: on a machine that tests, somebody else may have the default port.
    program.write_text(code.replace("insole_daemon.connect()", f'insole_daemon.connect("{daemon.endpoint}")'))
    with daemon.boards(), python(program) as lines:
        rows = [line.split() for line in lines.take(120)]
    assert all(len(row) == 4 for row in rows), "no cycle was lost"
    assert {foot for foot, *_ in rows} == {"left", "right"}
    assert max(float(force) for _, force, _, _ in rows) > 300, "somebody walks"
    assert any(cop != "None" and 0 < float(cop) < 0.3 for _, _, cop, _ in rows)
