"""What a verdict depends on is listed, and rests on nothing else."""

import ast
import re
import sys

import pytest
from sources import MODULES, PACKAGE, ROOT, TREES, imports_of, module_name, room

# -- what is trusted


PAGE = (ROOT / "docs" / "what_is_trusted.md").read_text(encoding="utf-8")
# Functions of the mathematical library, whose last digits nobody guarantees.
LIBM = {"log", "log2", "log10", "log1p", "exp", "exp2", "expm1", "sin", "cos", "tan", "arcsin", "arccos", "arctan"}
LIBM |= {"arctan2", "sinh", "cosh", "tanh", "hypot", "power", "float_power", "cbrt", "asin", "acos", "atan", "atan2"}


def rows_under(title: str) -> dict[str, set[str]]:
    """Modules in the table under a title of the page, with what their rows name besides."""
    table = PAGE.partition(f"## {title}\n")[2].partition("\n## ")[0]
    named = [re.findall(r"`([^`]+)`", row) for row in table.splitlines() if row.startswith("| `")]
    return {module_name(PACKAGE / first): set(rest) for first, *rest in named}


TRUSTED, PROPOSES = rows_under("Trusted"), rows_under("Proposes only")


def test_every_file_of_the_lower_rooms_is_trusted_or_only_proposes():
    lower = {name for name, path in MODULES.items() if room(name) in ("exact", "cones", "proof")}
    lower = {name for name in lower if MODULES[name].name != "__init__.py"}
    listed = set(TRUSTED) | set(PROPOSES)
    assert lower <= listed, f"docs/what_is_trusted.md says nothing about {lower - listed}"
    assert listed <= set(MODULES), f"docs/what_is_trusted.md names {listed - set(MODULES)}, which is gone"
    assert not set(TRUSTED) & set(PROPOSES)


def may_rest_on(module: str, name: str) -> bool:
    """Whether a trusted module may import another one, by the rule and by its row."""
    if name in TRUSTED or name in ("numpy", "numpy.typing", "numpy.lib", "scipy.sparse"):
        return True
    if name in MODULES:
        path = MODULES[name].relative_to(PACKAGE).as_posix()
        return path.endswith("__init__.py") or name == "control_kpos.cards" or path in TRUSTED[module]
    return name.split(".")[0] in sys.stdlib_module_names or name in TRUSTED[module]


@pytest.mark.parametrize("module", TRUSTED)
def test_what_is_trusted_rests_on_nothing_else(module):
    for name in imports_of(module):
        assert may_rest_on(module, name), f"{module} is trusted, but imports {name}"
    used = {node.attr for node in ast.walk(TREES[module]) if isinstance(node, ast.Attribute)}
    assert "linalg" not in used or "numpy.linalg" in TRUSTED[module], f"{module} uses numpy.linalg"


@pytest.mark.parametrize("module", TRUSTED)
def test_what_is_trusted_uses_no_mathematical_library(module):
    calls = [node.func for node in ast.walk(TREES[module]) if isinstance(node, ast.Call)]
    owners = [(f.value.id, f.attr) for f in calls if isinstance(f, ast.Attribute) and isinstance(f.value, ast.Name)]
    names = {attr for owner, attr in owners if owner in ("np", "math")}
    imported = {
        alias.name
        for node in ast.walk(TREES[module])
        if isinstance(node, ast.ImportFrom) and node.module == "math"
        for alias in node.names
    }
    assert not (names | imported) & LIBM, f"{module}: {(names | imported) & LIBM}"


# Where the conditions of certificates and witnesses are stated.
STATED = [
    "proof.inclusion",
    "theorems.growing_direction",
    "networks.conditions",
    "networks.witnesses",
    "networks.own_links",
]
STATED += ["design.certificates", "find.certificate", "nonlinear.certificate"]


@pytest.mark.parametrize("module", STATED)
def test_conditions_have_no_tolerance(module):
    numbers = [node.value for node in ast.walk(TREES[f"control_kpos.{module}"]) if isinstance(node, ast.Constant)]
    assert not [x for x in numbers if isinstance(x, float) and 0 < abs(x) < 0.1]
