"""Tests of code that has a compiled kernel beside it, run with both."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import pytest

from insole_daemon.compiled import kernel

IMPLEMENTATIONS = ["numpy", "compiled"] if kernel else ["numpy"]


def numpy_and_compiled(*modules: ModuleType) -> Callable[..., Any]:
    """A fixture by which every test of a module runs twice: with `modules` on numpy alone, and on the kernel."""

    @pytest.fixture(autouse=True, scope="module", params=IMPLEMENTATIONS)
    def implementation(request: pytest.FixtureRequest) -> Iterator[None]:
        with pytest.MonkeyPatch.context() as patch:
            for module in modules:
                patch.setattr(module, "kernel", kernel if request.param == "compiled" else None)
            yield

    return implementation
