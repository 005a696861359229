"""The pages of docs/: their examples run, what they name exists, and their tables miss nothing."""

import ast
import doctest
import re
from pathlib import Path

import pytest

import control_kpos as kp

ROOT = Path(__file__).parent.parent
DOCS, PACKAGE = ROOT / "docs", ROOT / "control_kpos"
FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL
PAGES = [page for page in sorted(DOCS.rglob("*.md")) if not {"_build", "api"} & set(page.parts)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_examples_on_the_page_run(page):
    blocks = re.findall(r"^```pycon\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    test = doctest.DocTestParser().get_doctest("\n".join(blocks), {}, page.name, str(page), 0)
    runner = doctest.DocTestRunner(optionflags=FLAGS)
    runner.run(test)
    assert runner.summarize(verbose=False).failed == 0


def test_reference_lists_every_public_name():
    listed = set(re.findall(r"^   (\w+)", (DOCS / "reference.md").read_text(encoding="utf-8"), flags=re.M))
    public = {
        name
        for name in dir(kp)
        if not name.startswith("_")
        and callable(getattr(kp, name))
        and getattr(getattr(kp, name), "__module__", "").startswith("control_kpos")
    }
    assert not public - listed


# -- for developers


DEVELOPER = [DOCS / "architecture.md", *sorted((DOCS / "developer").glob("*.md"))]
NAMING = [*DEVELOPER, ROOT / "CONTRIBUTING.md", ROOT / "README.md", *sorted((DOCS / "guide").glob("*.md"))]
NAMING += [DOCS / name for name in ("what_it_promises.md", "what_is_trusted.md", "faq.md", "rounding.md")]
LABELS = {"cone_inv", "cone_s", "cone_d", "cone_ic_s"}  # of the theorems in the source of the paper
WRITTEN = {"kpos-demo/"}  # by the command line
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(PACKAGE.rglob("*.py"))}


def spans(page: Path) -> list[str]:
    """What stands in backquotes on a page, without blocks of code."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return re.findall(r"`([^`\n]+)`", text)


def defined_names() -> set[str]:
    """Names of functions, classes, parameters, fields and variables in the package."""
    names = {path.stem for path in TREES}
    for node in (node for tree in TREES.values() for node in ast.walk(tree)):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.add(node.name)
        elif isinstance(node, ast.arg):
            names.add(node.arg)
        elif isinstance(node, ast.Name):
            names.add(node.id)
        elif isinstance(node, ast.Attribute):
            names.add(node.attr)
    return names


@pytest.mark.parametrize("page", NAMING, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_named_on_the_page_exist(page):
    named = [span for span in spans(page) if re.fullmatch(r"\.?[\w./-]+(\.py|\.md|/)|\.ci/run", span)]
    places = (ROOT, PACKAGE, page.parent)
    missing = [name for name in named if not any((place / name).exists() for place in places) and name not in WRITTEN]
    assert not [name for name in missing if "/" in name or not list(ROOT.glob(f"*/**/{name}"))]


@pytest.mark.parametrize("page", DEVELOPER, ids=lambda page: page.name)
def test_functions_named_on_the_page_exist(page):
    """Dotted names and calls in backquotes whose parts look like code: an underscore, or a capital inside."""
    code = [span for span in spans(page) if not span.endswith(".py")]
    dotted = [re.fullmatch(r"([A-Za-z_]\w*(?:\.\w+)*)(?:\(.*\))?", span) for span in code]
    named = {name for match in dotted if match for name in match[1].split(".")}
    named = {name for name in named if re.search(r"_|[a-z][A-Z]", name)} - LABELS
    tests = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").glob("*.py"))
    assert not named - defined_names() - set(re.findall(r"\w+", tests))


def rows(page: str) -> dict[tuple[str, str], str]:
    """Third column of the tables on a page, by the file and the name in the first two."""
    text = (DOCS / "developer" / page).read_text(encoding="utf-8")
    found = re.findall(r"^\| `([^`]+\.py)` \| `(\w+)` \| ([^|]+) \|", text, flags=re.M)
    assert len({row[:2] for row in found}) == len(found), "a constant stands there twice"
    return {(file, name): value.strip("` ") for file, name, value in found}


FOLDERS = (
    "exact",
    "cones",
    "proof",
    "theorems",
    "networks",
    "families",
    "design",
    "find",
    "nonlinear",
    "observers",
    "shards",
    "data",
)


def constants() -> dict[tuple[str, str], str]:
    """Constants with numbers in the folders that decide something, as they stand in the source."""
    out = {}
    for path, tree in TREES.items():
        file = path.relative_to(PACKAGE).as_posix()
        if file.split("/")[0] not in FOLDERS:
            continue
        source = path.read_text(encoding="utf-8")
        for node in tree.body:
            if not isinstance(node, (ast.Assign, ast.AnnAssign)) or node.value is None:
                continue
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            several = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
            pairs = zip(target.elts, node.value.elts, strict=True) if several else [(target, node.value)]
            for name, value in pairs:
                is_constant = isinstance(name, ast.Name) and re.fullmatch(r"_?[A-Z][A-Z0-9_]+", name.id)
                numbers = [n for n in ast.walk(value) if isinstance(n, ast.Constant) and type(n.value) in (int, float)]
                if is_constant and numbers:
                    out[file, name.id] = " ".join(ast.get_source_segment(source, value).split())
    return out


def test_the_table_of_limits_is_complete():
    listed, found = rows("limits.md"), constants()
    assert not set(found) - set(listed), "docs/developer/limits.md does not say what these are"
    assert not set(listed) - set(found), "docs/developer/limits.md names what is gone"


def test_the_table_of_limits_has_the_values_of_the_code():
    text = (
        (DOCS / "developer" / "limits.md").read_text(encoding="utf-8").partition("## Numbers that change no answer")[0]
    )
    listed, found = rows("limits.md"), constants()
    changing = {key: value for key, value in listed.items() if f"| `{key[0]}` | `{key[1]}` |" in text}
    assert {key: value for key, value in changing.items() if found[key] != value} == {}
    assert len(changing) > 150


def test_the_map_of_tests_names_every_file_once():
    named = [name for name in spans(DOCS / "developer" / "tests.md") if re.fullmatch(r"\w+\.py", name)]
    assert len(named) == len(set(named))
    assert {path.name for path in (ROOT / "tests").glob("*.py")} - set(named) == set()


def test_every_folder_has_a_floor_in_the_architecture():
    named = set(spans(DOCS / "architecture.md"))
    folders = {f"{path.name}/" for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    assert folders <= named
