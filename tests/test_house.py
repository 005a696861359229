"""The rules of the house: who imports whom, what is documented, what importing costs."""

import ast
import dataclasses
import doctest
import enum
import graphlib
import importlib
import inspect
import re
import subprocess
import sys

import matplotlib.pyplot as plt
import pytest
from sources import LEVEL, MODULES, PACKAGE, ROOT, TREES, import_nodes, imported_names, imports_of, room

import control_kpos as kp

# Packages that only some rooms may import.
RESTRICTED = {
    "cvxpy": {"design"},
    "matplotlib": {"plotting"},
    "mpl_toolkits": {"plotting"},
    "networkx": {"networks", "plotting"},
    "highspy": {"exact"},
    "mpi4py": {"shards"},
    "scipy.optimize": {"exact", "design", "find"},
    "scipy.spatial": {"cones"},
}

# Packages that may be imported inside functions, each with its reason.
HIDDEN_IMPORTS = {
    "cvxpy": "takes longer to import than everything else together, and only design needs it",
    "flint": "takes a sixth of what this package adds to `import control`, and most verdicts need no exact solve",
    "mpi4py": "starts MPI, and is installed by who runs networks in shards on many machines",
    "highspy": "takes a tenth of what this package adds to `import control`, and Theorems 1 and 2 solve no program",
    "pyarrow.parquet": "an extra, for networks in tables",
    "pymetis": "an extra, for partitions of networks",
}

# Above this length a file is likely to hold two ideas.  Longer ones need a reason.
MAX_LINES = 450
LONG_FILES = {"control_kpos.checker": "stands alone: one file is copied, read and run without any other"}

# Public functions and methods that pass keywords on, and a call with one that nobody knows.
PASSES_KEYWORDS = {
    "ConeStateSpace": lambda: kp.ConeStateSpace(*SMALL_SYSTEM, nonsense=1),
    "ConeStateSpace.sample": lambda: kp.ConeStateSpace(*SMALL_SYSTEM).sample(0.1, nonsense=1),
    "ConeStateSpace.linearize": lambda: kp.ConeStateSpace(*SMALL_SYSTEM).linearize(0, 0, nonsense=1),
    "ConeStateSpace.to_ss": lambda: kp.ConeStateSpace(*SMALL_SYSTEM).to_ss(nonsense=1),
    "ConeNetwork.sample": lambda: small_network().sample(0.1, nonsense=1),
    "ConeNetwork.linearize": lambda: small_network().linearize(0, 0, nonsense=1),
    "ConeNetwork.to_ss": lambda: small_network().to_ss(nonsense=1),
    "gain_rate_tradeoff": lambda: kp.gain_rate_tradeoff(SMALL_PLANT, nonsense=1),
    "plot_closed_loop": lambda: kp.plot_closed_loop(SMALL_PLANT, kp.state_feedback(SMALL_PLANT), nonsense=1),
    "phase_portrait": lambda: kp.phase_portrait([[-1.0, 0.0], [0.0, -1.0]], nonsense=1),
    "examples.mass_spring_node": lambda: kp.examples.mass_spring_node(nonsense=1),
}


def small_network() -> kp.ConeNetwork:
    return kp.feedback_interconnect([kp.ConeStateSpace(*SMALL_SYSTEM)], [[0.5]])


SMALL_SYSTEM = [[-1.0]], [[1.0]], [[1.0]], [[0.0]]
SMALL_PLANT = kp.ConeStateSpace([[1.0, 1.0], [1.0, -3.0]], [[1.0], [0.0]], [[1.0, 0.0]], 0)


# -- imports


@pytest.mark.parametrize("module", MODULES)
def test_imports_point_down(module):
    assert room(module) in LEVEL, f"give {room(module)} a place in FLOORS"
    for name in imports_of(module) & set(MODULES):
        assert LEVEL[room(name)] <= LEVEL[room(module)], f"{module} may not import {name}"


def test_imports_are_acyclic():
    graph = {module: (imports_of(module) & set(MODULES)) - {module} for module in MODULES}
    graphlib.TopologicalSorter(graph).prepare()


@pytest.mark.parametrize("module", MODULES)
def test_no_import_hides_inside_a_function(module):
    nodes = import_nodes(TREES[module], inside_functions=True)
    hidden = set().union(*(imported_names(module, node) for node in nodes))
    assert hidden <= set(HIDDEN_IMPORTS)


@pytest.mark.parametrize("module", MODULES)
def test_only_some_rooms_use_solvers_and_pictures(module):
    hidden = import_nodes(TREES[module], inside_functions=True)
    for name in imports_of(module).union(*(imported_names(module, node) for node in hidden)):
        for package, rooms in RESTRICTED.items():
            if name == package or name.startswith(package + "."):
                assert room(module) in rooms, f"{module} imports {name}"


def modules_after(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(*sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return set(result.stdout.split())


def test_import_brings_no_solver_and_no_pictures():
    extra = modules_after("import control_kpos") - modules_after("import control")
    packages = {name.split(".")[0] for name in extra if not name.startswith("_")}
    optional = {"mpi4py", "distributed", "dask", "pyarrow", "pymetis"}
    assert not packages & ({"cvxpy", "flint", "highspy", "networkx", "IPython", "pandas", "tqdm"} | optional)
    assert not {name for name in extra if name.startswith("matplotlib")}
    assert "control_kpos.plotting" not in extra


# -- the text of the files


@pytest.mark.parametrize("module", MODULES)
def test_no_assert_in_the_package(module):
    asserts = [node.lineno for node in ast.walk(TREES[module]) if isinstance(node, ast.Assert)]
    assert not asserts, f"{MODULES[module]}, lines {asserts}: python -O removes asserts"


@pytest.mark.parametrize("module", MODULES)
def test_files_hold_one_idea(module):
    lines = MODULES[module].read_text(encoding="utf-8").count("\n")
    assert lines <= MAX_LINES or module in LONG_FILES, f"{MODULES[module]} has {lines} lines; split it"


@pytest.mark.parametrize("path", sorted((ROOT / "tests").glob("*.py")), ids=lambda path: path.stem)
def test_files_of_tests_are_no_longer(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= MAX_LINES


def test_the_house_has_fourteen_folders():
    folders = {path.relative_to(PACKAGE).parts[0] for path in MODULES.values() if path.parent != PACKAGE}
    assert len(folders) <= 14
    assert folders <= set(LEVEL)


@pytest.mark.parametrize("module", [name for name, path in MODULES.items() if path.name != "__init__.py"])
def test_names_are_imported_from_where_they_live(module):
    """A module hands no name on: what others import from it, it defines."""
    elsewhere = {
        (name.module or "", alias.name): name.lineno
        for name in import_nodes(TREES[module], inside_functions=False)
        if isinstance(name, ast.ImportFrom)
        for alias in name.names
        if alias.asname == alias.name
    }
    assert not elsewhere, f"{module} hands on {sorted(elsewhere)}"
    for node in import_nodes(TREES[module], inside_functions=False):
        homes = imported_names(module, node) & set(MODULES) if isinstance(node, ast.ImportFrom) else set()
        for home in (h for h in homes if MODULES[h].name != "__init__.py" and h.endswith(f".{node.module}")):
            borrowed = {alias.name for alias in node.names} - names_defined_in(home)
            assert not borrowed, f"{module} takes {sorted(borrowed)} from {home}, which only imports them"


def names_defined_in(module: str) -> set[str]:
    """Names that a module defines itself."""
    out: set[str] = set()
    for node in ast.walk(TREES[module]):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            out.add(node.name)
        elif isinstance(node, ast.Assign):
            out |= {t.id for target in node.targets for t in ast.walk(target) if isinstance(t, ast.Name)}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            out.add(node.target.id)
    return out


@pytest.mark.parametrize("module", MODULES)
def test_modules_open_with_their_subject(module):
    assert ast.get_docstring(TREES[module])


# -- public names


@pytest.mark.parametrize("module", [kp, kp.examples, kp.errors])
def test_tab_completion_offers_public_names_alone(module):
    offered = {name for name in dir(module) if not name.startswith("__")}
    assert offered == {name for name in module.__all__ if not name.startswith("__")}
    assert len(set(module.__all__)) == len(module.__all__)
    assert all(getattr(module, name) is not None for name in module.__all__)


@pytest.mark.parametrize("module", [name for name, path in MODULES.items() if path.name == "__init__.py"])
def test_names_handed_on_are_listed(module):
    """A folder that hands names on lists them, and no others."""
    handed = {
        alias.asname or alias.name
        for node in TREES[module].body
        if isinstance(node, ast.ImportFrom) and node.level
        for alias in node.names
    }
    listed = set(getattr(importlib.import_module(module), "__all__", ()))
    assert handed <= listed


def public_names() -> dict[str, object]:
    """Public functions and classes by the name a user types, without errors."""
    out = {name: getattr(kp, name) for name in dir(kp) if not name.startswith("_")}
    out.update({f"examples.{name}": thing for name, thing in vars(kp.examples).items() if not name.startswith("_")})
    out.update({f"shards.{name}": getattr(kp.shards, name) for name in kp.shards.__all__})
    return {
        name: thing
        for name, thing in out.items()
        if callable(thing)
        and getattr(thing, "__module__", "").startswith("control_kpos")
        and (not name.startswith("examples.") or thing.__module__ == "control_kpos.examples")
        and not (inspect.isclass(thing) and issubclass(thing, (Exception, enum.Enum)))
    }


def own_methods(cls):
    """Public methods that are not python-control's; its `updfcn` and `outfcn` are for its simulations only."""
    for name in sorted(set(dir(cls)) - {"updfcn", "outfcn"}):
        member = inspect.getattr_static(cls, name)
        member = getattr(member, "__func__", member)  # of a classmethod or staticmethod
        if not name.startswith("_") and inspect.isfunction(member) and member.__module__.startswith("control_kpos"):
            yield name, member


PUBLIC = public_names()
METHODS = {
    f"{name}.{method}": function
    for name, cls in PUBLIC.items()
    if inspect.isclass(cls)
    for method, function in own_methods(cls)
}


def docstring(name: str) -> str:
    """The docstring of a public name, inherited where an override has none."""
    owner, _, method = name.rpartition(".")
    return inspect.getdoc(PUBLIC[name] if name in PUBLIC else getattr(PUBLIC[owner], method)) or ""


def sections(doc: str) -> dict[str, str]:
    """Sections of a numpydoc docstring by title."""
    parts = re.split(r"^(\w[\w ]*)\n-{3,}\n", doc, flags=re.M)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def documented_names(doc: str) -> set[str]:
    out: set[str] = set()
    for title in ("Parameters", "Other Parameters", "Attributes"):
        for names in re.findall(r"^(\*{0,2}\w[\w, *]*?)\s*(?::|$)", sections(doc).get(title, ""), flags=re.M):
            out |= {name.strip().lstrip("*") for name in names.split(",")}
    return out


def parameters(name: str) -> set[str]:
    """Parameters, or for a data class those fields that it adds to its parents."""
    thing = PUBLIC.get(name) or METHODS[name]
    if dataclasses.is_dataclass(thing):
        return {field.name for field in dataclasses.fields(thing)} & set(thing.__annotations__)
    return set(inspect.signature(thing).parameters) - {"self", "cls"}


@pytest.mark.parametrize("name", [*PUBLIC, *METHODS])
def test_every_parameter_is_documented(name):
    doc = docstring(name)
    assert doc, f"{name} has no docstring"
    missing = parameters(name) - documented_names(doc)
    if name == "ConeStateSpace":
        missing -= {"args"}  # A, B, C, D and dt, as control.StateSpace takes them
    assert not missing


@pytest.mark.parametrize("name", PUBLIC)
def test_every_docstring_has_an_example(name):
    if dataclasses.is_dataclass(PUBLIC[name]) or inspect.isabstract(PUBLIC[name]):
        return  # made by functions that have one
    assert ">>>" in sections(docstring(name)).get("Examples", "")


@pytest.mark.parametrize("name", [*PUBLIC, *METHODS])
def test_unknown_keywords_are_refused(name):
    kinds = {p.kind for p in inspect.signature(PUBLIC.get(name) or METHODS[name]).parameters.values()}
    if inspect.Parameter.VAR_KEYWORD not in kinds or name.endswith("Certificate.settle"):
        return  # Python itself refuses them; `settle` hands them to the data class
    assert name in PASSES_KEYWORDS, f"{name} passes keywords on; show that unknown ones are refused"
    with pytest.raises(TypeError, match="nonsense"):
        PASSES_KEYWORDS[name]()


def test_errors_are_value_errors():
    errors = [getattr(kp, name) for name in dir(kp) if name.endswith("Error")]
    assert errors
    assert all(issubclass(error, kp.KposError) and issubclass(error, ValueError) for error in errors)


# -- README


README = (ROOT / "README.md").read_text(encoding="utf-8")


def readme_blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, flags=re.M | re.S)


def test_examples_in_the_readme_run():
    example = "\n".join(readme_blocks("pycon"))
    flags = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    test = doctest.DocTestParser().get_doctest(example, {}, "README.md", "README.md", 0)
    runner = doctest.DocTestRunner(optionflags=flags)
    runner.run(test)
    assert runner.summarize(verbose=False).failed == 0
    assert runner.tries > 3


def test_readme_and_ci_run_the_same_tests():
    commands = "\n".join(readme_blocks("console"))
    assert "-m pytest -n auto" in commands
    assert "python -m pytest -n auto" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def test_modules_named_in_the_readme_exist():
    named = set(re.findall(r"^\| [^|]* \| `([\w/.]+)`", README, flags=re.M))
    assert len(named) > 5
    assert all((PACKAGE / name).exists() for name in named)


def test_names_in_the_readme_exist():
    rows = [re.findall(r"`(\w+)`", row.split("|")[3]) for row in README.splitlines() if row.count("|") == 4]
    names = {name for row in rows for name in row}
    assert len(names) > 10
    assert all(hasattr(kp, name) for name in names)


# -- the environment of the tests


def test_pictures_need_no_screen():
    assert plt.get_backend().lower() == "agg"


def test_changelog_tells_of_this_version():
    assert f"## [{kp.__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
