"""Name what ``palpate._core`` exports and the product does not use: part of ``make lint``.

Exports are the functions, classes, methods and properties of ``_core.pyi``, and their options, which
are parameters with a default. Used is what a module of the product that imports ``_core`` names or passes.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]

SPARED = {"SharedPath", "SharedPath.gradient", "SparseFactor.precondition", "nmse"}
"""What Measured.along makes; what searches by slopes will call; and one application of a factor, whose laws
are tested by it; and what scores of plugins call.
"""


STUB = ast.parse((ROOT / "python/palpate/_core.pyi").read_text("utf-8"))

EXPORTED = {node.name for node in STUB.body if isinstance(node, ast.ClassDef | ast.FunctionDef)}
"""Names that ``palpate.api`` may hand on."""


def product() -> list[ast.AST]:
    """Every node of the modules that import ``_core``."""
    paths = [*ROOT.glob("python/**/*.py"), *ROOT.glob("plugins/*/src/**/*.py")]
    modules = (list(ast.walk(ast.parse(path.read_text("utf-8")))) for path in paths)
    return [node for module in modules if "_core" in set(imported(module)) for node in module]


def imported(nodes: list[ast.AST]) -> Iterator[str]:
    """``_core``, and what is imported from it by name."""
    for node in nodes:
        names = [alias.name for alias in node.names] if isinstance(node, ast.ImportFrom) else []
        is_api = isinstance(node, ast.ImportFrom) and str(node.module).startswith("palpate.api")
        if names and is_api:
            names = [name for name in names if name in EXPORTED]
        if "_core" in names or (names and (is_api or node.module == "palpate._core")):
            yield from ("_core", *names)


def unused(stub: ast.Module, used: list[ast.AST]) -> Iterator[str]:
    """Exports of a stub that are neither named nor passed by these nodes."""
    attributes = [node for node in used if isinstance(node, ast.Attribute)]
    names = {a.attr for a in attributes if getattr(a.value, "id", "") == "_core"} | set(imported(used))
    keywords = {node.arg for node in used if isinstance(node, ast.keyword)}
    counts: dict[str, int] = {}
    for call in (node for node in used if isinstance(node, ast.Call)):
        name = getattr(call.func, "attr", getattr(call.func, "id", ""))
        counts[name] = max(counts.get(name, 0), len(call.args))
    for top in stub.body:
        known = names | {"__new__", *(a.attr for a in attributes if isinstance(top, ast.ClassDef))}
        for node in (top, *getattr(top, "body", ())):
            if not isinstance(node, ast.ClassDef | ast.FunctionDef):
                continue
            label = node.name if node is top else f"{top.name}.{node.name}"
            if label not in SPARED and node.name not in (names if node is top else known):
                yield label
            elif label not in SPARED and isinstance(node, ast.FunctionDef):
                n_given = counts.get(top.name if node.name == "__new__" else node.name, 0) + (node is not top)
                yield from (f"{label}({o})" for o in options(node.args, n_given) if o not in keywords)


def options(parameters: ast.arguments, n_given: int) -> list[str]:
    """Parameters with a default that so many positional arguments do not reach."""
    first = max(len(parameters.args) - len(parameters.defaults), n_given)
    by_keyword = zip(parameters.kwonlyargs, parameters.kw_defaults, strict=True)
    return [a.arg for a in parameters.args[first:]] + [a.arg for a, d in by_keyword if d is not None]


if __name__ == "__main__":
    if found := list(unused(STUB, product())):
        sys.exit(f"palpate._core exports what nothing uses: {', '.join(found)}")
