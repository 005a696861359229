"""Certificates in shards: the independent checker, by hand and against the package."""

import ast
import signal
from pathlib import Path

import checker_grown_shards
import checker_shards
import pytest
import shards_by_hand
import tampering

from control_kpos import checker

CASES = checker_shards.CASES | checker_grown_shards.CASES
SMALL = {"FREE_SIZES": 0, "ONE_PIECE": (6, 29, 1)}


def outcome(path, shard, names=None):
    names = vars(checker) if names is None else names
    try:
        return names["in_shards"](path, shard, None)[0]
    except names["Wrong"]:
        return "WRONG"
    except Exception:  # noqa: BLE001 - whatever it raises
        return "UNREADABLE"


@pytest.mark.parametrize("name", CASES)
def test_cases_by_hand(name, tmp_path, monkeypatch):
    for limit, value in SMALL.items():
        monkeypatch.setattr(checker, limit, value)
    case, shard, expected = CASES[name]
    assert outcome(shards_by_hand.write(tmp_path / "net", case), shard) == expected


# -- every operator of this part of the checker matters; the others are changed in test_checker

SOURCE = Path(checker.__file__).read_text(encoding="utf-8").split("if __name__")[0]
OWN = SOURCE[SOURCE.index("# -- networks in shards") : SOURCE.index("# -- files")]
# Changes that leave every verdict as it is, and why.
EQUIVALENT = {
    "beside_doubles: a < b -> a <= b": "the second time it is no double that stands there",
    "away_from: 0 <= j < net.nodes() -> 0 <= j <= net.nodes()": "it would be in a shard that is not there",
    "shard_with_halo: 0 <= c < len(owners) -> 0 <= c <= len(owners)": "column c has no owner: an error either way",
}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """The folder of every case, its shard and what is expected."""
    place = tmp_path_factory.mktemp("cases")
    cases = enumerate(CASES.values())
    return [(shards_by_hand.write(place / str(k), case), shard, expected) for k, (case, shard, expected) in cases]


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="nothing stops what runs for ever")
def test_changed_operators_are_noticed(folders):
    names, survivors, count = tampering.compiled(ast.parse(SOURCE), "changed_shards"), [], 0
    names |= SMALL
    for count, (where, top) in enumerate(tampering.changed_functions(OWN), 1):  # noqa: B007
        with tampering.installed(top, names):
            if not any(where.endswith(text) for text in EQUIVALENT) and all(
                outcome(path, shard, names) == expected for path, shard, expected in folders
            ):
                survivors.append(where)
    assert count > 100
    assert not survivors, "\n".join(survivors)


def test_harmless_changes_are_still_there():
    changes = [where for where, _ in tampering.changed_functions(OWN)]
    for text in EQUIVALENT:
        assert any(where.endswith(text) for where in changes), text
