"""The pages of docs/: their examples run, and the reference misses no public name."""

import doctest
import re
from pathlib import Path

import pytest

import control_kpos as kp

DOCS = Path(__file__).parent.parent / "docs"
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
