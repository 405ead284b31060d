"""Import packages of optional extras where they are used."""

from __future__ import annotations

import importlib
from typing import Any

from ..errors import InsoleError
from ..extras import extra_of, install_command


def need(module: str, package: str, what: str) -> Any:
    """Import and return `module`; InsoleError names the extra to install if its package is missing."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        extra = extra_of(module) or "lab"  # extra_of is None if insole-daemon itself is not installed
        raise InsoleError(
            f"{what} needs the package {package}, which is not installed: {install_command(extra)}"
        ) from error
