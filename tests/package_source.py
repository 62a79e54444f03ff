"""The package as text: its modules, their syntax trees, and which module imports which."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]


def module_name(path):
    """structsel/numerics/stepwise.py -> structsel.numerics.stepwise."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules():
    """Syntax tree of every module of the package, by its name."""
    return {module_name(path): ast.parse(path.read_text()) for path in sorted((ROOT / "structsel").rglob("*.py"))}


@cache
def packages():
    """Names of the packages: the folders."""
    return {module_name(path) for path in (ROOT / "structsel").rglob("__init__.py")}


def imports(module):
    """Imports of a module from the package: (module, name, local name); the name is empty for a complete module."""
    package = module if module in packages() else module.rpartition(".")[0]
    for node in ast.walk(modules()[module]):
        if isinstance(node, ast.Import):
            for one in node.names:
                if one.name.partition(".")[0] == "structsel":
                    yield one.name, None, one.asname or one.name
        elif isinstance(node, ast.ImportFrom):
            near = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*near, *([node.module] if node.module else [])])
            if base.partition(".")[0] != "structsel":
                continue
            for one in node.names:
                local = one.asname or one.name
                if f"{base}.{one.name}" in modules():
                    yield f"{base}.{one.name}", None, local
                else:
                    yield base, one.name, local
