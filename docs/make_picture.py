"""Draw docs/demo.svg: what `insole demo` shows, from the messages of a demo that is running.

insole demo --seconds 20 > /dev/null &
python docs/make_picture.py
"""

import io
from pathlib import Path

from rich.console import Console

import insole_daemon
from insole_daemon.cli.terminal_view import FootView, screen

with insole_daemon.connect() as insole:
    views = {foot: FootView(insole.meta(foot)) for foot in ("left", "right")}
    for message in insole.messages("insole/demo/*/*"):
        views[message.foot].take(message)
        left, right = views["left"], views["right"]
        both = [view.wrench.f_z_n if view.wrench else 0 for view in (left, right)]
        if left.health and right.health and min(both) > 250:  # double support: both feet have something to show
            break
console = Console(record=True, width=88, file=io.StringIO(), force_terminal=True, color_system="truecolor")
console.print(screen(views, "insole demo"))
picture = console.export_svg(title="insole demo")
# The fonts that rich names are fetched from the network; a picture in a repository stands for itself.
start, end = picture.index("@font-face"), picture.rindex("}", 0, picture.index(".terminal"))
picture = picture[:start] + picture[picture.index(".", end) :] if start < end else picture
(Path(__file__).parent / "demo.svg").write_text(picture)
