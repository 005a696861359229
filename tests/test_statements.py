"""docs/statements.md holds every sentence that a verdict can say, and texts go by what is proven."""

import ast
import inspect
import re
from dataclasses import replace

import certified
import control as ct
import pytest
from sources import ROOT, TREES

import control_kpos as kp

PAGE = (ROOT / "docs" / "statements.md").read_text(encoding="utf-8").replace("&#124;", "|")
# Text of systems: what they are, no verdict.
SYSTEMS = {"ConeStateSpace", "ConeNetwork"}
SEARCHING = ("data", "design", "families", "find", "observers")


def alternatives(node):
    """The texts of an expression, with … for what is filled in."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return [node.value]
    if isinstance(node, ast.BinOp):
        return [a + b for a in alternatives(node.left) for b in alternatives(node.right)]
    if isinstance(node, ast.IfExp):
        return alternatives(node.body) + alternatives(node.orelse)
    if isinstance(node, ast.JoinedStr):
        return ["".join(v.value if isinstance(v, ast.Constant) else "…" for v in node.values)]
    return ["…"]


def sentences():
    """Every text that a method `explain` or `__str__` of the package returns, with its class."""
    for name, tree in TREES.items():
        if not name.endswith("checker"):
            for c in [c for c in ast.walk(tree) if isinstance(c, ast.ClassDef) and c.name not in SYSTEMS]:
                for f in [f for f in c.body if isinstance(f, ast.FunctionDef) and f.name in ("explain", "__str__")]:
                    for r in [r for r in ast.walk(f) if isinstance(r, ast.Return) and r.value is not None]:
                        yield from ((c.name, text) for text in alternatives(r.value) if re.search("[a-z]", text))


def parts_of(node, names):
    """All nodes of the calls of functions with these names, of exceptions raised, and of docstrings."""
    for n in ast.walk(node):
        called = getattr(n, "func", None)
        name = getattr(called, "attr", getattr(called, "id", ""))
        if isinstance(n, ast.Raise) or name in names or name.endswith("Error"):
            yield from ast.walk(n)
        if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant):
            yield n.value


def messages():
    """Every text of five words or more in the modules that search, outside errors and progress, with its module."""
    for module, tree in TREES.items():
        name = module.partition(".")[2]
        if name.split(".")[0] in ("data", "design", "families", "find", "observers") or name in (
            "networks.certificate",
            "networks.any_size",
            "theorems.robust_margin",
        ):
            silent = {id(n) for n in parts_of(tree, ("stage", "report", "Condition", "_report"))}
            silent |= {id(v) for n in ast.walk(tree) if isinstance(n, ast.JoinedStr) for v in n.values}
            for n in ast.walk(tree):
                if id(n) not in silent and isinstance(n, (ast.Constant, ast.JoinedStr)):
                    text = alternatives(n)[0].strip()
                    if len(re.findall("[a-z]{2,}", text)) >= 5 and "_" not in text.split()[0]:
                        yield name, text


SENTENCES = sorted(set(sentences()))
MESSAGES = sorted(set(messages()) - {(name, text) for name, text in messages() if any(text in s for _, s in SENTENCES)})


def test_every_message_has_a_row_and_every_row_a_message():
    table = PAGE.partition("## Messages")[2].partition("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("| `")]
    stated = {(row[0].strip("`"), row[1]) for row in rows}
    assert len(MESSAGES) > 60
    assert stated == set(MESSAGES), sorted(stated ^ set(MESSAGES))
    assert all(len(row) == 3 and len(row[2]) > 5 for row in rows)


def test_every_sentence_has_a_row_and_every_row_a_sentence():
    rows = {
        tuple(cell.strip() for cell in line.split(" | ")[:2]) for line in PAGE.splitlines() if line.startswith("| `")
    }
    stated = {(f"| `{name}`", text) for name, text in SENTENCES}
    assert len(SENTENCES) > 60
    assert stated <= rows, f"docs/statements.md lacks {sorted(stated - rows)}"
    table = PAGE.partition("## Sentences")[2].partition("\n## ")[0]
    for line in table.splitlines():
        if line.startswith("| `"):
            name, text, proof = line.strip("| ").split(" | ")
            assert (name.strip("`"), text) in SENTENCES, f"docs/statements.md has a row nobody says: {name} {text}"
            assert len(proof) > 5 and "?" not in proof


def public_names():
    """Fields and methods of what the package returns, beyond those of python-control and of the machinery."""
    machinery = {
        *(
            "beside_witness",
            "claim",
            "conditions",
            "contents",
            "data",
            "evidence",
            "explain",
            "no_margin",
            "parts",
            "proof",
            "refutation",
        ),
        *("refuted_by", "restore", "save", "settle", "facts", "explanation", "restated"),
    }
    for name in kp.__all__:
        c = getattr(kp, name)
        if inspect.isclass(c) and issubclass(c, (kp.Certificate, kp.Cone, kp.DesignResult)):
            fields = set(getattr(c, "__dataclass_fields__", ()))
            for member in {m for m in dir(c) if not m.startswith("_")} | fields:
                if member not in machinery and member not in dir(ct.StateSpace):
                    yield f"{name}.{member}"


@pytest.mark.parametrize("name", sorted(public_names()))
def test_every_public_name_is_in_the_tables(name):
    assert f"`{name.partition('.')[2]}`" in PAGE, f"docs/statements.md says nothing about {name}"


VERDICT = re.compile("^(Proved|Refuted|Not positive|No invariant|Not certified|Not differentially|All .* proven)")


@pytest.mark.parametrize("name", list(certified.CERTIFICATES))
def test_texts_go_by_the_status(name):
    certificate = certified.CERTIFICATES[name]()
    said, undecided = certificate.explain(), replace(certificate, status=kp.Status.UNDECIDED).explain()
    assert VERDICT.search(said)
    assert not VERDICT.search(undecided), undecided
