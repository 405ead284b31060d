"""Packages of an extra, imported where they are used."""

from __future__ import annotations

import importlib
from typing import Any

from ..errors import InsoleError
from ..extras import extra_of, install_command


def need(module: str, package: str, what: str) -> Any:
    """The module; InsoleError that names the extra where its package is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        extra = extra_of(module) or "lab"  # None: the package runs without having been installed
        raise InsoleError(
            f"{what} needs the package {package}, which is not installed: {install_command(extra)}"
        ) from error
