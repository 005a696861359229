"""Networks in Parquet tables: the shards of the same network in memory, or an error that names file, column and row."""

import sys

import numpy as np
import pytest
import random_networks
import scipy.sparse as sp
from sharded_networks import masses, written

import control_kpos as kp
from control_kpos.shards import columns, tables

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")


def saved(path, table, **more):
    pq.write_table(pa.table(table) if isinstance(table, dict) else table, path, **more)
    return path


def of_nodes(systems):
    """A table with a list of entries for every matrix of every node."""
    return {name: [np.asarray(getattr(s, name)).ravel().tolist() for s in systems] for name in "ABCD"}


def of_links(W, systems, rng=None):
    """A table of links with their places at the nodes, in any order."""
    u, y = (np.cumsum([0, *(getattr(s, size) for s in systems)]) for size in ("ninputs", "noutputs"))
    coo = sp.coo_array(W)
    order = np.arange(coo.nnz) if rng is None else rng.permutation(coo.nnz)
    rows, cols = (np.asarray(k)[order] for k in coo.coords)
    target, source = np.searchsorted(u, rows, side="right") - 1, np.searchsorted(y, cols, side="right") - 1
    ends = {"source": source, "output": cols - y[source], "target": target, "input": rows - u[target]}
    return {**ends, "weight": coo.data[order]}


def lags(n):
    return {"A": [[-3.0 - j % 5] for j in range(n)], "B": [[1.0]] * n, "C": [[1.0]] * n}


def ring(n):
    return {"source": list(range(n)), "target": [(j + 1) % n for j in range(n)], "weight": [1.0] * n}


def tables_in(place, nodes, links, **more):
    return kp.shards.parquet(saved(place / "nodes.parquet", nodes), saved(place / "links.parquet", links), **more)


def same_files(one, other):
    return (one / "manifest.json").read_text() == (other / "manifest.json").read_text()


# -- the same shards as from memory


@pytest.mark.parametrize("rows", [1, 3, 2**17])
def test_tables_give_the_same_files(tmp_path, monkeypatch, rows):
    monkeypatch.setattr(tables, "_ROWS", rows)
    source = tables_in(tmp_path, lags(10), ring(10))
    folder = kp.shards.write(source, tmp_path / "tables", 3)
    A = -3.0 - np.arange(10)[:, None, None] % 5
    W = np.roll(np.eye(10), 1, axis=0)
    assert same_files(folder, written(tmp_path, kp.stack(A, [[1.0]], [[1.0]]), W, 3))
    assert kp.shards.certify(folder, folder / "proof").status == "PROVED"
    assert {path.name for path in folder.iterdir()} == {"manifest.json", "proof", *(f"shard-0000{p}" for p in range(3))}


@pytest.mark.parametrize("seed", range(4))
def test_nodes_of_several_kinds_in_any_order(tmp_path, monkeypatch, seed):
    """Mixed sizes and cones with ports, rows of both tables shuffled and in several files, in small row groups."""
    rng = np.random.default_rng(seed)
    discrete = bool(seed % 2)
    monkeypatch.setattr(tables, "_ROWS", 5)
    kinds = [random_networks.random_node(rng, discrete=discrete, feedthrough=True, damping=0.5) for _ in range(3)]
    which = rng.integers(0, 3, 20)
    nodes = [kinds[k] for k in which.tolist()]
    blocks = [
        [0.01 * random_networks.positive_map(rng, b.Y, a.U, 1) if rng.random() < 0.3 else None for b in nodes]
        for a in nodes
    ]
    W = random_networks.dense_coupling(nodes, blocks)
    order = rng.permutation(20)
    table = of_nodes([nodes[j] for j in order]) | {
        "node": order.astype(np.uint32),
        "kind": pa.array([f"kind {which[j]}" for j in order]).dictionary_encode(),
    }
    table = pa.table(table)
    files = [saved(tmp_path / f"{k}.parquet", table[8 * k : 8 * k + 8], row_group_size=3) for k in range(3)]
    links = saved(tmp_path / "links.parquet", of_links(W, nodes, rng), row_group_size=4)
    cones = {name: {f"kind {k}": getattr(s, name) for k, s in enumerate(kinds)} for name in "XUY"}
    source = kp.shards.parquet(files, [links], **cones, dt=kinds[0].dt)
    found = kp.shards.certify(kp.shards.write(source, tmp_path / "tables", 4), tmp_path / "proof")
    memory = kp.shards.certify(written(tmp_path, nodes, W, 4), tmp_path / "memory")
    assert found.status == memory.status == "PROVED"
    np.testing.assert_array_equal(found.rates, memory.rates)


def test_a_column_for_every_entry(tmp_path):
    nodes, W = masses(n=12)
    nodes = kp.stack(nodes.A.values, nodes.B.values, nodes.C.values, X=nodes.X)
    table = {
        f"{name}_{i}_{j}": getattr(nodes, name).values[:, i, j]
        for name, shape in (("A", (2, 2)), ("B", (2, 1)), ("C", (1, 2)))
        for i, j in np.ndindex(shape)
    }
    coo = sp.coo_array(W)
    links = {"source": coo.coords[1], "target": coo.coords[0], "weight": coo.data}
    source = tables_in(tmp_path, table, links, X=nodes.X)
    assert repr(source) == f"<network in Parquet tables: 12 nodes, {coo.nnz} links>"
    assert same_files(kp.shards.write(source, tmp_path / "tables", 3), written(tmp_path, nodes, W, 3))


@pytest.mark.parametrize("partition", ["labels", "metis"])
def test_tables_in_a_partition(tmp_path, partition):
    if partition == "metis":
        pytest.importorskip("pymetis")
    labels = np.arange(12) % 3 if partition == "labels" else "metis"
    folder = kp.shards.write(tables_in(tmp_path, lags(12), ring(12)), tmp_path / "tables", 3, partition=labels)
    A = -3.0 - np.arange(12)[:, None, None] % 5
    nodes, W = kp.stack(A, [[1.0]], [[1.0]]), np.roll(np.eye(12), 1, axis=0)
    assert same_files(folder, kp.shards.write((nodes, W), tmp_path / "memory", 3, partition=labels))


@pytest.mark.parametrize(
    "kind", [pa.list_(pa.float64()), pa.large_list(pa.float32()), pa.list_(pa.int16(), 1), pa.list_(pa.uint64())]
)
def test_numbers_of_all_types(tmp_path, kind):
    table = lags(6)
    table["B"] = pa.array([[1]] * 6, kind)
    links = ring(6) | {"weight": pa.array([1] * 6, kind.value_type), "source": pa.array(range(6), pa.int8())}
    folder = kp.shards.write(tables_in(tmp_path, table, links), tmp_path / "tables", 2)
    assert same_files(folder, kp.shards.write(tables_in(tmp_path, lags(6), ring(6)), tmp_path / "plain", 2))


def test_links_of_weight_zero_are_none(tmp_path):
    links = {name: [*values, 0] for name, values in ring(6).items()}
    folder = kp.shards.write(tables_in(tmp_path, lags(6), links), tmp_path / "tables", 2)
    assert same_files(folder, kp.shards.write(tables_in(tmp_path, lags(6), ring(6)), tmp_path / "plain", 2))


def test_no_links_at_all(tmp_path):
    links = pa.table(
        {"source": pa.array([], pa.int64()), "target": pa.array([], pa.int64()), "weight": pa.array([0.0][:0])}
    )
    folder = kp.shards.write(tables_in(tmp_path, lags(4), links), tmp_path / "tables", 3)
    assert kp.shards.certify(folder, folder / "proof").status == "PROVED"


# -- what is refused


def with_field(table, name, row, value):
    return table | {name: [value if k == row else x for k, x in enumerate(table[name])]}


NODES, LINKS = lags(6), ring(6)
BAD = {
    "no A": ({"B": NODES["B"], "C": NODES["C"]}, LINKS, kp.DataError, r"nodes\.parquet needs a column 'A'"),
    "both layouts": (NODES | {"A_0_0": [1.0] * 6}, LINKS, kp.DataError, "not both"),
    "an entry of A": ({"A_0_1": [1.0], "A_1_1": [1.0]} | {"B": [[1.0]], "C": [[1.0]]}, LINKS, kp.DataError, "'A_0_0'"),
    "B by entries": (
        {"A": NODES["A"], "B_0_0": [1.0] * 6, "B_1_0": [1.0] * 6, "C": NODES["C"]},
        LINKS,
        kp.ConeMismatchError,
        "row 0: the columns of B are 2 x 1, but must be 1 x 2",
    ),
    "numbers for lists": (NODES | {"A": [-1.0] * 6}, LINKS, kp.DataError, "column 'A' holds double; give lists"),
    "lists of text": (NODES | {"A": [["-1/3"]] * 6}, LINKS, kp.DataError, "column 'A' holds lists of string"),
    "NaN": (with_field(NODES, "A", 4, [np.nan]), LINKS, kp.DataError, r"nodes\.parquet, column 'A', row 4: nan"),
    "inf": (with_field(NODES, "B", 5, [np.inf]), LINKS, kp.DataError, r"column 'B', row 5: inf"),
    "no list": (with_field(NODES, "C", 1, None), LINKS, kp.DataError, r"column 'C', row 1: the field is empty"),
    "no entry": (with_field(NODES, "C", 3, [None]), LINKS, kp.DataError, r"column 'C', row 3: an entry is empty"),
    "2^53 + 1": (NODES | {"B": [[1]] * 5 + [[2**53 + 1]]}, LINKS, kp.DataError, r"'B', row 5: an integer beyond"),
    "-2^53 - 1": (NODES | {"B": [[1]] * 5 + [[-(2**53) - 1]]}, LINKS, kp.DataError, r"'B', row 5: an integer beyond"),
    "no square": (with_field(NODES, "A", 2, [1.0, 2.0]), LINKS, kp.ConeMismatchError, "row 2: A has 2 entries"),
    "nothing": (with_field(NODES, "A", 2, []), LINKS, kp.ConeMismatchError, "row 2: A has 0 entries"),
    "B of no size": (
        NODES | {"A": [[0.0] * 4] * 6, "B": [[1.0] * 3] * 6},
        LINKS,
        kp.ConeMismatchError,
        "B has 3 entries, but A is 2 x 2",
    ),
    "D of no size": (NODES | {"D": [[0.0, 0.0]] * 6}, LINKS, kp.ConeMismatchError, "D has 2 entries, .* give 1"),
    "a node twice": (NODES | {"node": [0, 1, 2, 3, 2, 5]}, LINKS, kp.DataError, "'node', row 4: 2 occurred before"),
    "a node too far": (NODES | {"node": [0, 1, 2, 3, 4, 6]}, LINKS, kp.DataError, "row 5: 6 is no number from 0 to 5"),
    "names for numbers": (NODES | {"node": list("abcdef")}, LINKS, kp.DataError, "'node' holds string; give integers"),
    "kind of doubles": (NODES | {"kind": [0.5] * 6}, LINKS, kp.DataError, "'kind' holds double"),
    "no kind": (NODES | {"kind": ["a", None] * 3}, LINKS, kp.DataError, "'kind', row 1: the field is empty"),
    "no nodes": ({name: pa.array([], pa.list_(pa.float64())) for name in "ABC"}, LINKS, kp.DataError, "has no rows"),
    "no weight": (NODES, {k: LINKS[k] for k in ("source", "target")}, kp.DataError, r"links\.parquet has no column"),
    "a weight of text": (NODES, LINKS | {"weight": ["1/3"] * 6}, kp.DataError, "'weight' holds string"),
    "a weight of yes": (NODES, LINKS | {"weight": [True] * 6}, kp.DataError, "'weight' holds bool"),
    "an empty weight": (NODES, with_field(LINKS, "weight", 3, None), kp.DataError, "'weight', row 3: the field is"),
    "a weight of NaN": (NODES, with_field(LINKS, "weight", 3, np.nan), kp.DataError, "'weight', row 3: nan"),
    "source beyond": (NODES, with_field(LINKS, "source", 1, 6), kp.DataError, "'source', row 1: 6 is no number from"),
    "target below": (NODES, with_field(LINKS, "target", 2, -1), kp.DataError, "'target', row 2: -1 is no number"),
    "sources of doubles": (NODES, LINKS | {"source": [0.0] * 6}, kp.DataError, "'source' holds double; give integers"),
    "a link twice": (
        NODES,
        {name: [*values, values[2]] for name, values in LINKS.items()},
        kp.DataError,
        r"links\.parquet has two links from output 0 of node 2 to input 0 of node 3",
    ),
    "a port too far": (NODES, LINKS | {"input": [0, 0, 0, 1, 0, 0]}, kp.DataError, "'input', row 3: 1 is no number"),
    "no ports": (
        NODES | {"B": [[1.0, 1.0]] * 6},
        LINKS,
        kp.DataError,
        "row 0: node 1 has 2 inputs; add a column 'input'",
    ),
}


@pytest.mark.parametrize("rows", [2, 2**17])
@pytest.mark.parametrize("case", BAD)
def test_tables_that_are_refused(tmp_path, monkeypatch, case, rows):
    nodes, links, error, says = BAD[case]
    monkeypatch.setattr(tables, "_ROWS", rows)
    with pytest.raises(error, match=says):
        kp.shards.write(tables_in(tmp_path, nodes, links), tmp_path / "network", 2)
    assert not (tmp_path / "network" / "manifest.json").exists()


def test_cones_that_do_not_fit(tmp_path):
    with pytest.raises(kp.ConeMismatchError, match="row 0: the node has 1 states, but X is a cone in dimension 2"):
        kp.shards.write(tables_in(tmp_path, NODES, LINKS, X=kp.orthant(2)), tmp_path / "network")
    with pytest.raises(kp.DataError, match=r"U has a cone for every kind, but .* has no column 'kind'"):
        tables_in(tmp_path, NODES, LINKS, U={"home": kp.orthant(1)})
    source = tables_in(tmp_path, NODES | {"kind": ["bus"] * 6}, LINKS, Y={"home": kp.orthant(1)})
    with pytest.raises(kp.DataError, match="nodes of kind 'bus' have no cone Y"):
        kp.shards.write(source, tmp_path / "network")
    with pytest.raises(kp.NotProperConeError, match=r"X\['home'\]"):
        tables_in(tmp_path, NODES | {"kind": ["home"] * 6}, LINKS, X={"home": [[1], [-1]]})


def test_files_that_are_no_tables(tmp_path):
    links = saved(tmp_path / "links.parquet", LINKS)
    text = tmp_path / "text.parquet"
    text.write_text("PAR1 no table")
    with pytest.raises(kp.DataError, match=r"text\.parquet cannot be read as a Parquet file"):
        kp.shards.parquet(text, links)
    with pytest.raises(FileNotFoundError):
        kp.shards.parquet(tmp_path / "nowhere.parquet", links)
    with pytest.raises(kp.DataError, match="nodes is an empty list"):
        kp.shards.parquet([], links)
    nodes = saved(tmp_path / "nodes.parquet", NODES)
    with pytest.raises(kp.DataError, match=r"but .* has others"):
        kp.shards.parquet([nodes, links], links)
    with pytest.raises(kp.DataError, match="nodes is 3"):
        kp.shards.parquet(3, links)
    with pytest.raises(kp.TimebaseError):
        kp.shards.parquet(nodes, links, dt=-1)


def test_a_damaged_page_names_the_file(tmp_path):
    source = tables_in(tmp_path, NODES, LINKS)
    path = tmp_path / "links.parquet"
    data = bytearray(path.read_bytes())
    data[4:40] = bytes(36)
    path.write_bytes(data)
    with pytest.raises(kp.DataError, match=r"links\.parquet"):
        kp.shards.write(source, tmp_path / "network")


def test_without_pyarrow(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(kp.SolverError, match=r'pip install "control_kpos\[parquet\]"'):
        kp.shards.parquet(tmp_path / "nodes.parquet", tmp_path / "links.parquet")


# -- memory


def test_no_more_than_a_batch_of_rows_is_read_at_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "_ROWS", 4)
    most = []
    original = columns.doubles

    def noted(column, name, where):
        most.append(len(column))
        return original(column, name, where)

    monkeypatch.setattr(tables, "doubles", noted)
    kp.shards.write(tables_in(tmp_path, lags(30), ring(30)), tmp_path / "network", 5)
    assert len(most) == 8
    assert max(most) == 4


def test_what_was_read_is_released(tmp_path):
    """Of a file with many row groups only some are held at a time."""
    path = saved(tmp_path / "links", {"weight": np.random.default_rng(0).random(200_000)}, row_group_size=5000)
    before, most = pa.total_allocated_bytes(), 0
    for _, batch in tables.File.open(path).batches(["weight"]):
        assert len(batch["weight"])
        most = max(most, pa.total_allocated_bytes() - before)
    assert most < 2**17 * 8 * 1.5


def test_numbers_of_nodes_may_be_given_in_any_order(tmp_path):
    order = np.random.default_rng(3).permutation(12)
    table = {name: [values[j] for j in order] for name, values in lags(12).items()} | {"node": order}
    folder = kp.shards.write(tables_in(tmp_path, table, ring(12)), tmp_path / "tables", 3)
    assert same_files(folder, kp.shards.write(tables_in(tmp_path, lags(12), ring(12)), tmp_path / "plain", 3))
