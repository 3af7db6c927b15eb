"""The rules of dependence: what stands on what, and what importing costs."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.machine import unit

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "imapper_prob"
# `imapper_prob/models` and `imapper_prob/samplers` are links to folders at the root.
SOURCES = sorted(
    {
        path
        for folder in (PACKAGE, PACKAGE / "models", PACKAGE / "samplers")
        for path in folder.rglob("*.py")
    }
)
LABORATORY = sorted((ROOT / "lab").rglob("*.py"))
FLOORS = [
    {"models", "samplers"},
    {"config", "files", "layouts", "memory", "people", "plotting", "progress", "simulate"},
    {"clips"},
    {"scenelets"},
    {"solver"},
    {"lifting"},
    {"sampling"},
    {"uncertainty"},
    {"recording"},
    {"results"},
    {"api"},
    {"evaluate"},
    {"cli", "__init__", "__main__"},
]
"""From the ground up: a floor imports itself and what is below it."""
LONGEST_MODULE = 600
"""Lines, without those of docstrings."""
HEAVY = {"torch", "numba", "rerun", "matplotlib", "emcee", "xarray", "arviz_base", "trimesh"}
LONGEST_IMPORT = 10.0
"""Units of ``tests.machine`` for `import imapper_prob` in a fresh interpreter, its own start not
counted; .3 s on a common machine."""
DISTRIBUTIONS = {"PIL": "pillow", "rerun": "rerun-sdk", "dask": "distributed"}
"""Distributions whose name is not that of the module."""


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def imports(path: Path) -> frozenset[str]:
    """Dotted names of all that a module imports, wherever in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                is_module = (ROOT / Path(*full.split("."))).is_dir() or (
                    ROOT / Path(*full.split("."))
                ).with_suffix(".py").is_file()
                found.add(full if is_module else str(node.module))
    return frozenset(found)


def floor_of(module: str) -> int:
    parts = module.split(".")
    name = parts[1] if len(parts) > 1 else "__init__"
    matches = [i for i, floor in enumerate(FLOORS) if name in floor]
    assert matches, f"{module}: give imapper_prob.{name} a floor in this test"
    return matches[0]


def inner(path: Path) -> Iterator[str]:
    return (name for name in imports(path) if name.split(".")[0] == "imapper_prob")


def test_there_is_something_to_check() -> None:
    names = {module_name(p) for p in SOURCES}
    assert {"imapper_prob", "imapper_prob.models.scene", "imapper_prob.samplers"} <= names


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_nothing_imports_upward(path: Path) -> None:
    module = module_name(path)
    for name in inner(path):
        assert floor_of(name) <= floor_of(module), f"{module} imports {name}"


@pytest.mark.parametrize("ground", ["models", "samplers"])
def test_models_and_samplers_know_nothing_of_each_other(ground: str) -> None:
    for path in SOURCES:
        if module_name(path).startswith(f"imapper_prob.{ground}"):
            strangers = {n for n in inner(path) if not n.startswith(f"imapper_prob.{ground}")}
            assert not strangers, f"{module_name(path)} imports {strangers}"


def test_root_folders_are_reached_through_the_package_only() -> None:
    for path in [*SOURCES, *LABORATORY, *(ROOT / "tests").rglob("*.py")]:
        direct = {n for n in imports(path) if n.split(".")[0] in ("models", "samplers")}
        assert not direct, f"{path} imports {direct}"


def test_the_program_knows_nothing_of_the_laboratory() -> None:
    for path in SOURCES:
        strangers = {n for n in imports(path) if n.split(".")[0] in ("lab", "tests")}
        assert not strangers, f"{module_name(path)} imports {strangers}"


def test_links_are_relative() -> None:
    for name in ("models", "samplers"):
        link = PACKAGE / name
        assert link.is_symlink()
        assert link.readlink() == Path("..") / name


def length(path: Path) -> int:
    """Lines of a module without its docstrings."""
    text = path.read_text(encoding="utf-8")
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docstrings = [
        node.body[0]
        for node in ast.walk(ast.parse(text))
        if isinstance(node, documented) and ast.get_docstring(node, clean=False) is not None
    ]
    return len(text.splitlines()) - sum(
        (d.end_lineno or d.lineno) - d.lineno + 1 for d in docstrings
    )


def test_modules_are_short() -> None:
    lengths = {module_name(path): length(path) for path in [*SOURCES, *LABORATORY]}
    assert {m: n for m, n in lengths.items() if n > LONGEST_MODULE} == {}


@cache
def words(path: Path) -> frozenset[str]:
    return frozenset(re.findall(r"\w+", path.read_text(encoding="utf-8")))


def exported(path: Path) -> tuple[str, ...]:
    """Names in a module's ``__all__``; those of the package are made from a table."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return tuple(ast.literal_eval(node.value)) if isinstance(node.value, ast.List) else ()
    return ()


@pytest.mark.parametrize("path", [*SOURCES, *LABORATORY], ids=module_name)
def test_a_public_name_is_used_by_another_file(path: Path) -> None:
    users = [
        *SOURCES,
        *LABORATORY,
        *(ROOT / "tests").rglob("*.py"),
        *(ROOT / "notebooks").iterdir(),
    ]
    others = [words(p) for p in users if p != path and p.is_file()]
    assert [name for name in exported(path) if not any(name in used for used in others)] == []


def has_number(value: object) -> bool:
    if isinstance(value, dict):
        return any(map(has_number, value.values()))
    if isinstance(value, (tuple, list)):
        return any(map(has_number, value))
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def is_number(node: ast.expr) -> bool:
    try:
        return has_number(ast.literal_eval(node))
    except ValueError:
        return False


def bare_constants(text: str) -> Iterator[str]:
    """Lines that set numbers without a text: a comment above the group, or a string below it."""
    lines, body = text.split("\n"), ast.parse(text).body
    group: list[ast.Assign | ast.AnnAssign] = []
    for node, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, (ast.Assign, ast.AnnAssign)):
            continue
        if group and node.lineno > (group[-1].end_lineno or 0) + 1:
            group = []
        group.append(node)
        goes_on = (
            isinstance(after, (ast.Assign, ast.AnnAssign))
            and after.lineno == (node.end_lineno or 0) + 1
        )
        if goes_on:
            continue
        below = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        above = lines[group[0].lineno - 2].startswith("#")
        if not below and not above:
            yield from (
                lines[one.lineno - 1] for one in group if one.value and is_number(one.value)
            )
        group = []


def test_a_bare_constant_is_noticed() -> None:
    assert list(bare_constants("\nA = 1\nB = 2.0\n")) == ["A = 1", "B = 2.0"]
    assert list(bare_constants('\nA = 1\n"""Metres."""\n# Seconds.\nB = 2\nC = {"a": 3}\n')) == []
    assert list(bare_constants('\nA = 1\n\nB = (2, 3)\n"""Pixels."""\nC = "a"\n')) == ["A = 1"]


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_every_constant_says_what_it_is(path: Path) -> None:
    """Its unit and where it comes from; the words are for readers to judge."""
    assert list(bare_constants(path.read_text(encoding="utf-8"))) == []


def test_every_import_is_a_declared_dependency() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [project["optional-dependencies"][e] for e in ("video", "cluster", "notebook")]
    declared = {
        re.split(r"[^A-Za-z0-9_-]", requirement)[0].replace("-", "_")
        for requirement in sum(extras, project["dependencies"])
    }
    for path in SOURCES:
        for name in imports(path):
            top = name.split(".")[0]
            if top != "imapper_prob" and top not in sys.stdlib_module_names:
                distribution = DISTRIBUTIONS.get(top, top).replace("-", "_")
                assert distribution in declared, f"{module_name(path)} imports {top}"


def test_an_installation_without_extras_imports_every_module() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {re.split(r"[^A-Za-z0-9_-]", r)[0].replace("-", "_") for r in project["dependencies"]}
    for path in SOURCES:
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Import):
                tops = [alias.name.split(".")[0] for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                tops = [str(node.module).split(".")[0]]
            else:
                continue
            for top in set(tops) - {"imapper_prob", "__future__"} - set(sys.stdlib_module_names):
                distribution = DISTRIBUTIONS.get(top, top).replace("-", "_")
                assert distribution in needed, f"{module_name(path)} imports {top} at once"


def test_every_file_of_the_packages_is_installed() -> None:
    """Other files than modules are those that the wheel is told to have."""
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    told = {
        (ROOT / package.replace(".", "/") / name).resolve()
        for package, names in setup["setuptools"]["package-data"].items()
        for name in names
    }
    there = {
        path.resolve()
        for folder in ("imapper_prob", "models", "samplers")
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts
    }
    assert there == told


def test_every_direct_dependency_is_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    direct = {
        re.split(r"[^A-Za-z0-9_-]", requirement)[0]
        for requirement in sum(extras, project["dependencies"])
        if "python_version >= '3.12'" not in requirement
    }
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {line.split("==")[0] for line in lines if "==" in line}
    assert direct - pinned == set()


def test_a_process_of_chains_loads_nothing_but_their_compiler() -> None:
    program = "import sys, imapper_prob.sampling.chain; sys.stdout.write(' '.join(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert set(done.stdout.split()) & HEAVY == {"numba"}


def test_who_samples_or_reads_a_run_loads_no_torch() -> None:
    program = "import sys, imapper_prob.api; sys.stdout.write(' '.join(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "torch" not in done.stdout.split()


def test_importing_is_quick_and_light() -> None:
    program = (
        "import sys, time; start = time.perf_counter(); import imapper_prob; "
        "sys.stdout.write(' '.join([str(time.perf_counter() - start), *sys.modules]))"
    )

    def measured() -> tuple[float, set[str]]:
        done = subprocess.run(
            [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
        )
        seconds, *modules = done.stdout.split()
        return float(seconds) / unit(), set(modules)

    # The best of three: the machine may be busy, the program is not at fault then.
    runs = [measured() for _ in range(3)]
    assert runs[0][1] & HEAVY == set()
    assert min(units for units, _ in runs) < LONGEST_IMPORT
