"""A digest of all sources that compiled kernels depend on.

The machine code of a kernel depends on its own text, on the kernels it calls and on the constants
it names. So the digest covers the modules that define kernels, and each definition that these
import from the model. It ignores comments and docstrings, and the rest of the model, which passes
numbers to kernels as arguments.
"""

from __future__ import annotations

import ast
import hashlib
import tomllib
from pathlib import Path

__all__ = ["digest"]

_PACKAGE = "imapper_prob.models"
_COMPILER = f"{_PACKAGE}.jit"
_DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
_DOCUMENTED = (*_DEFINITIONS, ast.Module)


def digest(folder: Path) -> str:
    """The digest of the kernels of the model in ``folder``: sixteen hexadecimal digits.

    Parameters
    ----------
    folder : Path
        Folder of the package ``imapper_prob.models``.

    Returns
    -------
    str
    """
    model = _Model(folder)
    for path in sorted(folder.rglob("*.py")):
        if f"from {_COMPILER} import" in path.read_text(encoding="utf-8"):
            model.reach_all(_module(folder, path))
    model.reach_all(_COMPILER)
    state = hashlib.sha256()
    for module, number in sorted(model.reached):
        state.update(f"{module}:{ast.dump(model.statements(module)[number])}\n".encode())
    for group, constants in tomllib.loads(_text(folder / "calibrated.toml")).items():
        for name, constant in constants.items():
            state.update(f"{group}.{name} = {constant['value']!r}\n".encode())
    return state.hexdigest()[:16]


class _Model:
    """The statements of the model's modules, and the subset that kernels depend on."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.reached: set[tuple[str, int]] = set()
        self._asked: set[tuple[str, str]] = set()
        self._statements: dict[str, list[ast.stmt]] = {}
        self._bound: dict[str, list[frozenset[str] | None]] = {}

    def statements(self, module: str) -> list[ast.stmt]:
        """Statements of a module, without docstrings and imports for type checkers."""
        if module not in self._statements:
            path = self.folder.joinpath(*module.split(".")[2:])
            path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
            tree = ast.parse(_text(path))
            _strip(tree)
            kept = [s for s in tree.body if not _for_checkers(s)]
            self._statements[module] = kept
            self._bound[module] = [_bound(s) for s in kept]
        return self._statements[module]

    def reach_all(self, module: str) -> None:
        """Mark every statement of a module and all that they use."""
        for number in range(len(self.statements(module))):
            self._reach(module, number)

    def reach_name(self, module: str, name: str) -> None:
        """Mark the statements that define ``name``, and those that may change it on import."""
        if (module, name) in self._asked:
            return
        self._asked.add((module, name))
        self.statements(module)
        for number, bound in enumerate(self._bound[module]):
            if bound is None or name in bound:
                self._reach(module, number)

    def _reach(self, module: str, number: int) -> None:
        if (module, number) in self.reached:
            return
        self.reached.add((module, number))
        statement = self.statements(module)[number]
        for node in ast.walk(statement):
            if isinstance(node, ast.Name):
                self.reach_name(module, node.id)
            elif isinstance(node, ast.ImportFrom) and _inside(node.module):
                for alias in node.names:
                    self._reach_import(str(node.module), alias.name)
            elif isinstance(node, ast.Import):
                for alias in node.names:
                    if _inside(alias.name):
                        self.reach_all(alias.name)

    def _reach_import(self, module: str, name: str) -> None:
        path = self.folder.joinpath(*module.split(".")[2:], name)
        if path.is_dir() or path.with_suffix(".py").is_file():
            self.reach_all(f"{module}.{name}")
        elif name == "*":
            self.reach_all(module)
        elif module != _COMPILER:
            self.reach_name(module, name)


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _module(folder: Path, path: Path) -> str:
    parts = path.relative_to(folder).with_suffix("").parts
    return ".".join((_PACKAGE, *(parts[:-1] if parts[-1] == "__init__" else parts)))


def _inside(module: str | None) -> bool:
    return module is not None and f"{module}.".startswith(f"{_PACKAGE}.")


def _strip(tree: ast.Module) -> None:
    """Remove docstrings, including those of constants."""
    for node in ast.walk(tree):
        if isinstance(node, _DOCUMENTED):
            node.body = [s for s in node.body if not _is_text(s)]


def _is_text(statement: ast.stmt) -> bool:
    value = statement.value if isinstance(statement, ast.Expr) else None
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


def _for_checkers(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.If)
        and isinstance(statement.test, ast.Name)
        and statement.test.id == "TYPE_CHECKING"
    )


def _bound(statement: ast.stmt) -> frozenset[str] | None:
    """The names that a statement binds; None if it may have other effects."""
    if isinstance(statement, _DEFINITIONS):
        return frozenset([statement.name])
    if isinstance(statement, ast.Import | ast.ImportFrom):
        return frozenset((a.asname or a.name).split(".")[0] for a in statement.names)
    if isinstance(statement, ast.Assign | ast.AnnAssign):
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        nodes = [node for target in targets for node in ast.walk(target)]
        if not any(isinstance(node, ast.Attribute | ast.Subscript) for node in nodes):
            return frozenset(node.id for node in nodes if isinstance(node, ast.Name))
    return None
