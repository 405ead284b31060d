"""The package has no import cycle, so every module can be the first one that a program imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import insole_daemon

PACKAGE = Path(insole_daemon.__file__).parent


def test_no_module_is_imported_again_while_it_is_being_imported() -> None:
    files = {_name_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}
    imports = {name: _imports(name, path, files) for name, path in files.items()}
    assert len(imports) > 100, "the modules of the package were not found"
    cycle: list[str] = []
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        cycle = error.args[1]
    assert not cycle, "import cycle, each module imported by the next: " + ", ".join(cycle)


def _name_of(path: Path) -> str:
    names = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(names[:-1] if names[-1] == "__init__" else names)


def _imports(name: str, path: Path, files: dict[str, Path]) -> set[str]:
    """Return the modules of the package that must have been imported before the module `name` is complete.

    Importing a.b.c imports a and a.b first; where these contain `name`, they are being imported already.
    """
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    imported: set[str] = set()
    for module in _named_modules(ast.parse(path.read_text()).body, package):
        while module and module not in files:  # a name in a module
            module = module.rpartition(".")[0]
        while module and not f"{name}.".startswith(f"{module}."):
            imported.add(module)
            module = module.rpartition(".")[0]
    return imported


def _named_modules(statements: list[ast.stmt], package: str) -> Iterator[str]:
    """Yield what a module imports when it is imported itself: not in functions, and not for type checkers."""
    for statement in statements:
        if isinstance(statement, ast.Import):
            yield from (alias.name for alias in statement.names)
        elif isinstance(statement, ast.ImportFrom):
            ancestors = package.split(".")
            base = ancestors[: len(ancestors) + 1 - statement.level] if statement.level else []
            yield from (".".join([*base, *filter(None, [statement.module]), alias.name]) for alias in statement.names)
        elif isinstance(statement, ast.If) and "TYPE_CHECKING" in ast.unparse(statement.test):
            yield from _named_modules(statement.orelse, package)
        elif not isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef):
            for field in ("body", "handlers", "orelse", "finalbody"):
                yield from _named_modules(getattr(statement, field, []), package)
