"""The source files of the package, and who imports whom."""

import ast
from pathlib import Path

import control_kpos as kp

ROOT = Path(__file__).parent.parent
PACKAGE = Path(kp.__file__).parent


def module_name(path: Path) -> str:
    parts = ("control_kpos", *path.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts).removesuffix(".__init__")


MODULES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}
TREES = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in MODULES.items()}

# Floors of the house, from the ground up.  A room, a module or a folder below the package, may import
# from its own floor and from those below.
FLOORS = {
    "errors": {"errors"},
    "exact numbers": {"exact"},
    "what a reader sees of long work and of results": {"progress", "cards"},
    "cones": {"cones"},
    "verdicts": {"proof", "checker"},
    "what a verdict is about": {"systems.system"},
    "theorems about matrices": {"theorems"},
    "systems": {"systems"},
    "theorems about many systems": {"networks", "nonlinear"},
    "families of systems": {"families"},
    "networks larger than memory": {"shards"},
    "design": {"design", "data"},
    "search for cones": {"find"},
    "observers": {"observers"},
    "examples": {"examples"},
    "pictures": {"plotting"},
    "entrance": {"__init__", "__main__"},
}
LEVEL = {room: level for level, rooms in enumerate(FLOORS.values()) for room in rooms}


def room(module: str) -> str:
    """The room of a module: "cones" for control_kpos.cones.polyhedral."""
    inside = module.partition(".")[2] or "__init__"
    return inside if inside in LEVEL else inside.split(".")[0]


def is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")


def import_nodes(node: ast.AST, *, inside_functions: bool):
    """Import statements that run, at module level or inside functions."""
    for child in ast.iter_child_nodes(node):
        if is_type_checking(child):
            continue
        if isinstance(child, (ast.Import, ast.ImportFrom)) and not inside_functions:
            yield child
        elif isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            if inside_functions:
                yield from (n for n in ast.walk(child) if isinstance(n, (ast.Import, ast.ImportFrom)))
        else:
            yield from import_nodes(child, inside_functions=inside_functions)


def imported_names(module: str, node: ast.AST) -> set[str]:
    """Full names of the modules that an import statement needs."""
    if isinstance(node, ast.Import):
        return {alias.name for alias in node.names}
    base = node.module or ""
    if node.level:
        package = module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]
        parts = package.split(".")[: len(package.split(".")) - node.level + 1]
        base = ".".join([*parts, base] if base else parts)
    as_modules = {f"{base}.{alias.name}" for alias in node.names} & set(MODULES)
    everything_a_module = len(as_modules) == len(node.names)
    return as_modules | (set() if everything_a_module else {base})


def imports_of(module: str) -> set[str]:
    """Modules that a module needs when it is imported."""
    nodes = import_nodes(TREES[module], inside_functions=False)
    return set().union(*(imported_names(module, node) for node in nodes))
