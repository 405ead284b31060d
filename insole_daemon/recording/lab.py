"""Packages that only this room needs, of the extra [lab]: imported when they are used."""

from __future__ import annotations

import importlib
from typing import Any

from ..errors import InsoleError
from ..extras import install_command


def need(module: str, package: str, what: str) -> Any:
    """The module; InsoleError that names the extra where its package is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise InsoleError(
            f"{what} needs the package {package}, which is not installed: {install_command('lab')}"
        ) from error
