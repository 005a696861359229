"""The notebooks keep their promises of form; that they run is for .ci/run to show."""

import json
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def cells(path: Path, kind: str) -> list[str]:
    return ["".join(c["source"]) for c in json.loads(path.read_text("utf-8"))["cells"] if c["cell_type"] == kind]


def test_they_are_numbered_and_all_there():
    assert [path.name[:2] for path in NOTEBOOKS] == [f"{k:02d}" for k in range(1, len(NOTEBOOKS) + 1)]
    assert len(NOTEBOOKS) >= 10


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_each_opens_with_aims_and_ends_with_things_to_try(path):
    text = cells(path, "markdown")
    assert text[0].startswith("# ")
    assert "you can" in text[0] or "be able to" in text[0]
    assert "to try" in text[-1].lower()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_each_shows_a_mistake(path):
    assert any("mistake" in text.lower() for text in cells(path, "markdown"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_none_carries_outputs(path):
    notebook = json.loads(path.read_text("utf-8"))
    assert not any(c.get("outputs") or c.get("execution_count") for c in notebook["cells"])
    assert path.stat().st_size < 100_000


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_code_is_python(path):
    for source in cells(path, "code"):
        compile(source, path.name, "exec")
