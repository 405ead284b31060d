#!/usr/bin/env python3
"""From a fresh clone to a running demo or test, with nothing but Python 3.11 or newer.

    python3 bootstrap.py demo [ARGUMENTS...]      insole demo
    python3 bootstrap.py test [ARGUMENTS...]      the tests, with pytest
    python3 bootstrap.py install [EXTRA,...]      only prepare .venv

Needs no root, no compiler and no pip: the package goes into .venv beside this file, and where Python comes
without pip (Debian without python3-venv), pip is fetched. Later runs start at once.
What is installed is what locks/ names: every package in one version, with the hashes that its files must have.
"""

from __future__ import annotations

import base64
import contextlib
import fcntl
import hashlib
import html.parser
import importlib.util
import json
import os
import shutil
import ssl
import subprocess
import sys
import tempfile
import urllib.error
import urllib.parse
import urllib.request
import venv
from pathlib import Path
from typing import Any, NoReturn

OLDEST_PYTHON = (3, 11)
HERE = Path(__file__).resolve().parent
VENV = HERE / ".venv"
PYTHON = VENV / "bin" / "python"
STATE = VENV / "bootstrap.json"  # what .venv was made for; {} while it is being made

# The one thing run before pip is there to check hashes, so its hash stands here.
PIP_WHEEL = "pip-25.3-py3-none-any.whl"
PIP_SHA256 = "9655943313a94722b7774661c21049070f6bbb0a1516bf02f7c8d5d9201514cd"
INDEX_URL = os.environ.get("PIP_INDEX_URL") or "https://pypi.org/simple"


class BootstrapError(Exception):
    """An error with a message for a person: what happened and what to do."""


def main(arguments: list[str]) -> int:
    """Prepare .venv, then run the requested command in place of this process."""
    command, rest = (arguments[0], arguments[1:]) if arguments else ("", [])
    if command == "demo":
        prepare({"lab", "view"})  # all that the documented commands need
        become(VENV / "bin" / "insole", "demo", *rest)
    if command == "test":
        prepare({"test"})
        os.chdir(HERE)  # where pytest finds its settings
        # Threads of small matrices wait for each other on a busy machine, ten times as long as they work.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # A process a core, four at most: each takes up to 0.6 GB.
        become(PYTHON, "-m", "pytest", "--numprocesses=auto", "--maxprocesses=4", "--dist=worksteal", *rest)
    if command == "install" and len(rest) <= 1:
        prepare(set(rest[0].split(",")) if rest else set())
        return 0
    print((__doc__ or "").strip(), file=sys.stderr)
    return 2


def become(program: Path, *arguments: str) -> NoReturn:
    """Replace this process by another program."""
    os.execv(program, [str(program), *arguments])


def prepare(extras: set[str]) -> None:
    """Install this package, editable, with `extras` into .venv, unless it has them already."""
    with contextlib.suppress(OSError):  # a file system without locks
        # Two of us at once: the second waits. The lock goes with the process.
        fcntl.flock(os.open(HERE, os.O_RDONLY), fcntl.LOCK_EX)
    state = read_state()
    wanted: dict[str, Any] = {
        "checkout": str(HERE),
        "python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "pyproject": sha256(HERE / "pyproject.toml"),
        "kernel": sha256(HERE / "insole_daemon" / "kernel.c"),  # compiled when the package is installed
        "extras": sorted(extras | set(state.get("extras", []))),  # what an earlier run installed stays
    }
    locks = [HERE / "locks" / f"{name}.txt" for name in ("base", *wanted["extras"])]
    for lock in locks:
        if not lock.exists():
            raise BootstrapError(f"expected one of the extras of pyproject.toml, found {lock.stem!r}")
    wanted["locks"] = [sha256(lock) for lock in locks]
    if state == wanted and PYTHON.exists():
        return

    fit = PYTHON.exists() and all(state.get(key) == wanted[key] for key in ("checkout", "python"))
    if not fit:
        say(f"making {VENV} with Python {wanted['python']}")
        make_venv()
    say("installing the package and what it needs (a minute or so, once)")
    pip("install", "--only-binary=:all:", "--require-hashes", *(f"--requirement={lock}" for lock in locks))
    pip("install", "--no-deps", "--no-build-isolation", "--editable", str(HERE))  # built by what has just been checked
    compile_modules()
    write_state(wanted)
    say(f'the command insole is in {VENV / "bin"}: export PATH="{VENV / "bin"}:$PATH"')


def sha256(file: Path) -> str:
    """Return the SHA-256 of the content of `file`."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def read_state() -> dict[str, Any]:
    """Return the state of .venv; empty if there is none, or if it is unfinished."""
    if not VENV.exists():
        return {}
    if not STATE.exists() and any(VENV.iterdir()):
        raise BootstrapError(
            f"{VENV} was not made by bootstrap.py, which leaves it alone. Move it away, or use it yourself:\n"
            f"    {PYTHON} -m pip install -e '{HERE}[test]'"
        )
    try:
        state: dict[str, Any] = json.loads(STATE.read_text())
        return state
    except (OSError, ValueError):
        return {}


def write_state(state: dict[str, Any]) -> None:
    """Write the state in one step, so that a reader never sees a partial file."""
    draft = STATE.with_suffix(".new")
    draft.write_text(json.dumps(state))
    draft.replace(STATE)


def make_venv() -> None:
    """Make an empty virtual environment with pip."""
    VENV.mkdir(exist_ok=True)
    write_state({})
    for entry in VENV.iterdir():  # all but the mark that it is ours, should we be interrupted
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        elif entry != STATE:
            entry.unlink()
    has_ensurepip = importlib.util.find_spec("ensurepip") is not None
    try:
        venv.create(VENV, with_pip=has_ensurepip, symlinks=True)
    except subprocess.CalledProcessError as error:
        raise BootstrapError(f"python's own venv module failed: {error}") from error
    if not has_ensurepip:
        with tempfile.TemporaryDirectory() as folder:
            wheel = Path(folder, PIP_WHEEL)
            wheel.write_bytes(fetch_pip())
            # A wheel is a zip that Python can import from: pip installs itself.
            pip("install", "--no-index", str(wheel), program=[str(wheel / "pip")])


def pip(*arguments: str, program: list[str] | None = None) -> None:
    """Run pip in .venv; show its output only if it fails."""
    options = ["-qq", "--disable-pip-version-check", "--no-input", "--no-compile"]  # `compile_modules` does
    command = [str(PYTHON), *(program or ["-m", "pip"]), *arguments, *options]
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if result.returncode:
        print(result.stdout.strip(), file=sys.stderr)
        fetch(index_page("pip"))  # the usual cause, which pip names only at length: no network
        raise BootstrapError("pip could not install the packages, for the reason above")


def compile_modules() -> None:
    """Compile the package and what it needs on all cores; pip would take one core, and the packages' own tests, too."""
    command = [str(PYTHON), "-m", "compileall", "-q", "-j", "0", "-x", "site-packages/.*/tests/"]
    folders = [str(HERE / "insole_daemon"), *(str(folder) for folder in VENV.glob("lib/*/site-packages"))]
    # Some packages contain examples for other versions of Python. What is not compiled here is when it is imported.
    subprocess.run([*command, *folders], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)


def fetch_pip() -> bytes:
    """Download the pinned wheel of pip from the package index."""
    say(f"this Python has no pip; fetching {PIP_WHEEL}")
    page_url = index_page("pip")
    links = Links()
    links.feed(fetch(page_url).decode())
    for link in links.found:
        url = urllib.parse.urljoin(page_url, link)
        if urllib.parse.urlparse(url).path.endswith("/" + PIP_WHEEL):
            content = fetch(url)
            if hashlib.sha256(content).hexdigest() != PIP_SHA256:
                raise BootstrapError(
                    f"{PIP_WHEEL} from {host(url)} is not the right file: its SHA-256 is not {PIP_SHA256}"
                )
            return content
    raise BootstrapError(
        f"expected {PIP_WHEEL} on {host(page_url)}, found none; another way is: apt install python3-venv"
    )


def index_page(project: str) -> str:
    """Return the address at which the package index lists the files of a project."""
    return f"{INDEX_URL.rstrip('/')}/{project}/"


class Links(html.parser.HTMLParser):
    """Collects the links of a page. Every index serves HTML; not every mirror serves JSON."""

    def __init__(self) -> None:
        """Nothing found yet."""
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Called by feed."""
        self.found += [value for name, value in attrs if tag == "a" and name == "href" and value]


def fetch(url: str) -> bytes:
    """Return the content at `url`."""
    trusted = ssl.create_default_context(cafile=os.environ.get("PIP_CERT"))
    # A minimal Debian has no ca-certificates. The wheel's pinned hash vouches for it, whoever sent it.
    unchecked = ssl.create_default_context()
    unchecked.check_hostname = False
    unchecked.verify_mode = ssl.CERT_NONE
    parts = urllib.parse.urlsplit(url)
    request = urllib.request.Request(parts._replace(netloc=parts.netloc.rpartition("@")[2]).geturl())
    request.add_header("Accept", "text/html, */*;q=0.1")
    if parts.username:  # a private index
        login = urllib.parse.unquote(f"{parts.username}:{parts.password or ''}")
        request.add_header("Authorization", "Basic " + base64.b64encode(login.encode()).decode())
    try:
        try:
            response = urllib.request.urlopen(request, timeout=30, context=trusted)
        except urllib.error.URLError as error:
            if parts.username or not isinstance(error.reason, ssl.SSLCertVerificationError):
                raise
            response = urllib.request.urlopen(request, timeout=30, context=unchecked)
        with response:
            content: bytes = response.read()
            return content
    except (OSError, ValueError) as error:
        raise BootstrapError(
            f"cannot reach {host(url)}: {getattr(error, 'reason', error)}. Is there a network? "
            "A mirror is set with PIP_INDEX_URL, a proxy with HTTPS_PROXY."
        ) from error


def host(url: str) -> str:
    """Return the part of an address that may be shown: the rest can contain a password."""
    return urllib.parse.urlsplit(url).hostname or url


def say(what: str) -> None:
    """Print progress on stderr; stdout belongs to the command."""
    print(f"bootstrap: {what}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    if sys.version_info < OLDEST_PYTHON:
        sys.exit(
            "bootstrap: expected Python 3.11 or newer, found {}.{} ({}). Debian 12 and Ubuntu 24.04 have it; "
            "or name another one: python3.12 bootstrap.py demo".format(*sys.version_info[:2], sys.executable)
        )
    try:
        sys.exit(main(sys.argv[1:]))
    except BootstrapError as error:
        sys.exit(f"bootstrap: {error}")
    except OSError as error:
        sys.exit(f"bootstrap: {error.strerror or error}: {error.filename or VENV} (all it writes is {VENV})")
    except KeyboardInterrupt:
        sys.exit(130)
