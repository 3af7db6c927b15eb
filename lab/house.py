"""How easily is a line found in the program? Sizes and shapes of its modules, of any checkout.

    python -m lab.house [ROOT ...]

prints Markdown: a row a measure, a column a checkout (this one, if none is named). Sources are
parsed, not imported, so that checkouts of other versions can be measured beside this one. It takes
seconds.

Counted are the packages that are installed: ``imapper_prob``, ``models`` and ``samplers``.

- Import lines are those of import statements, wherever they are.
- A private function is one at the top of a module whose name begins with an underscore; it is used
  once if the module names it once.
- A module has one importer if one other module imports it.
- The length of a function leaves out its docstring.
- A docstring is complete if it has a summary and names all parameters or attributes, in a section
  Returns or Yields what is returned, and in a section Raises that bad input is refused. Public are
  the names in ``__all__``, and public methods and properties of these.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Final

__all__ = ["measure"]

PACKAGES: Final = ("imapper_prob", "models", "samplers")
ROOT: Final = Path(__file__).parents[1]
SHORT: Final = 120
"""Lines below which a module with a single importer might be merged into it."""
Function = ast.FunctionDef | ast.AsyncFunctionDef


def measure(root: Path) -> dict[str, str]:
    """Parse the packages of a checkout.

    Parameters
    ----------
    root : Path
        Folder of the checkout.

    Returns
    -------
    dict of str to str
        Values by name of the measure.

    Raises
    ------
    FileNotFoundError
        None of the packages exists.
    """
    # Links to packages are not followed, so that each file is counted once.
    paths = [path for name in PACKAGES for path in sorted((root / name).rglob("*.py"))]
    if not paths:
        raise FileNotFoundError(f"{root}: holds none of {', '.join(PACKAGES)}")
    texts = {path: path.read_text(encoding="utf-8") for path in paths}
    trees = {path: ast.parse(text) for path, text in texts.items()}
    nodes = [node for tree in trees.values() for node in ast.walk(tree)]
    lengths = {path: len(text.splitlines()) for path, text in texts.items()}
    lines, documented = sum(lengths.values()), sum(map(_docstring_lines, nodes))
    private = [count for tree in trees.values() for count in _uses_of_private(tree)]
    importers = Counter(name for path in paths for name in _imported(path, trees[path], root))
    lonely = [n for path, n in lengths.items() if n < SHORT and importers[_module(path, root)] == 1]
    stems = Counter(path.stem for path in paths if not path.stem.startswith("__"))
    longest, name = max((_length(n), n.name) for n in nodes if isinstance(n, Function))
    public = [node for tree in trees.values() for node in _public(tree)]
    complete = sum(map(_is_complete, public))
    examples = sum("Examples" in _sections(node) for node in public)
    return {
        "files": f"{len(paths)}",
        "lines": f"{lines:,}",
        "lines without docstrings": f"{lines - documented:,}",
        "median lines of a file": f"{median(lengths.values()):g}",
        "import lines": _share(sum(map(_import_lines, trees.values())), lines),
        "private functions used once": f"{private.count(1)} of {len(private)}",
        f"modules under {SHORT} lines with one importer": f"{len(lonely)} ({sum(lonely):,} lines)",
        "names of files in several folders": f"{sum(count > 1 for count in stems.values())}",
        "longest function, lines": f"{longest} (`{name}`)",
        "complete public docstrings": f"{_share(complete, len(public))} of {len(public):,}",
        "public docstrings with an example": f"{examples}",
    }


def _share(part: int, whole: int) -> str:
    return f"{100 * part / max(whole, 1):.1f} %"


def _module(path: Path, root: Path) -> str:
    """Dotted name below the package; by links ``models`` is also part of ``imapper_prob``."""
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(part for part in parts if part not in ("imapper_prob", "__init__"))


def _imported(path: Path, tree: ast.Module, root: Path) -> set[str]:
    """Modules of the program that a module imports."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {name.removeprefix("imapper_prob.") for name in found} - {_module(path, root)}


def _import_lines(tree: ast.Module) -> int:
    imports = [n for n in ast.walk(tree) if isinstance(n, ast.Import | ast.ImportFrom)]
    return sum((node.end_lineno or node.lineno) - node.lineno + 1 for node in imports)


def _uses_of_private(tree: ast.Module) -> list[int]:
    """Number of times a module names each of its private functions."""
    named = Counter(node.id for node in ast.walk(tree) if isinstance(node, ast.Name))
    return [
        named[node.name]
        for node in tree.body
        if isinstance(node, Function) and node.name.startswith("_")
    ]


def _length(node: Function) -> int:
    return (node.end_lineno or node.lineno) - node.lineno + 1 - _docstring_lines(node)


def _docstring_lines(node: ast.AST) -> int:
    if not isinstance(node, ast.Module | ast.ClassDef | Function):
        return 0
    if ast.get_docstring(node) is None:
        return 0
    return (node.body[0].end_lineno or 0) - node.body[0].lineno + 1


# ------------------------------------------------------------------------------------------------
# Docstrings.


def _public(tree: ast.Module) -> Iterator[Function | ast.ClassDef]:
    """Functions and classes in ``__all__``, and public methods and properties of these."""
    names: set[str] = set()
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            names |= set(re.findall(r"'(\w+)'", ast.unparse(node.value)))
    for node in tree.body:
        if isinstance(node, Function | ast.ClassDef) and node.name in names:
            yield node
            for method in node.body if isinstance(node, ast.ClassDef) else ():
                if isinstance(method, Function) and not method.name.startswith("_"):
                    yield method


def _sections(node: Function | ast.ClassDef) -> dict[str, str]:
    """The text of a docstring by underlined heading; the text before the first has the key
    ``""``."""
    parts = re.split(r"^(\w+)\n-+$", ast.get_docstring(node) or "", flags=re.MULTILINE)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def _is_complete(node: Function | ast.ClassDef) -> bool:
    sections = _sections(node)
    listed = sections.get("Parameters", "") + sections.get("Attributes", "")
    described = re.findall(r"^([\w*, ]+?)(?: : .*)?$", listed, re.MULTILINE)
    named = {name.strip(" *") for line in described for name in line.split(",")}
    if not sections[""].strip() or not set(_parameters(node)) <= named:
        return False
    if isinstance(node, ast.ClassDef) or _is_property(node):
        return True
    says = node.returns is None or ast.unparse(node.returns) in ("None", "NoReturn")
    refuses = any(isinstance(n, ast.Raise) and "InputError" in ast.unparse(n)
                  for n in ast.walk(node))  # fmt: skip
    return (says or bool({"Returns", "Yields"} & set(sections))) and (
        not refuses or "Raises" in sections
    )


def _is_property(node: Function) -> bool:
    return any(ast.unparse(d).endswith("property") for d in node.decorator_list)


def _parameters(node: Function | ast.ClassDef) -> list[str]:
    """Parameters of a function or constructor, or the fields of a dataclass."""
    if isinstance(node, ast.ClassDef):
        made = [n for n in node.body if isinstance(n, Function) and n.name == "__init__"]
        if made:
            return _parameters(made[0])
        fields = [n for n in node.body if isinstance(n, ast.AnnAssign)]
        return [
            ast.unparse(n.target)
            for n in fields
            if not re.search("ClassVar|init=False", ast.unparse(n))
        ]
    a = node.args
    several = [a.vararg, a.kwarg]
    every = [*a.posonlyargs, *a.args, *a.kwonlyargs, *(x for x in several if x is not None)]
    return [x.arg for x in every if x.arg not in ("self", "cls")]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a column for each checkout."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("roots", type=Path, nargs="*", metavar="ROOT", help="folders of checkouts")
    roots = parser.parse_args(arguments).roots or [ROOT]
    columns = [measure(root) for root in roots]
    lines = [f"| | {' | '.join(f'`{root.resolve().name}`' for root in roots)} |"]
    lines.append(f"|---|{'---:|' * len(roots)}")
    for name in columns[0]:
        lines.append(f"| {name} | {' | '.join(column[name] for column in columns)} |")
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
