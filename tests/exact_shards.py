"""Rows for networks in shards: what "1/3" becomes in the files."""

import pathlib
import tempfile
from fractions import Fraction

import control_kpos as kp
from control_kpos.shards.network import ShardedNetwork

THIRD = Fraction(1, 3)
CONE, SAME = [["1/3", "1/7"], [0, 1]], kp.PolyhedralCone([[7, 3], [0, 1]])


def in_a_shard(source):
    """A network of one node in one shard."""
    return ShardedNetwork.open(kp.shards.write(source, pathlib.Path(tempfile.mkdtemp()) / "network")).model(0)


def tables(**cones):
    """A network of one node with two states, inputs and outputs in tables, and its cones."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    place, one = pathlib.Path(tempfile.mkdtemp()), [1.0, 0.0, 0.0, 1.0]
    pq.write_table(pa.table({"A": [[-1.0, 0.0, 0.0, -1.0]], "B": [one], "C": [one]}), place / "nodes.parquet")
    ends = {name: pa.array([], pa.int64()) for name in ("source", "target")}
    pq.write_table(pa.table({**ends, "weight": pa.array([], pa.float64())}), place / "links.parquet")
    return kp.shards.parquet(place / "nodes.parquet", place / "links.parquet", **cones)


ROWS = {
    "shards.write": {
        "source": lambda: (
            [in_a_shard((kp.stack([[["-1/3"]]], [[1]], [[1]]), [["1/3"]])).stacks[0].A]
            + [in_a_shard((kp.stack([[[-1]]], [[1]], [[1]]), [["1/3"]])).coupling],
            [[[[-THIRD]]], [[THIRD]]],
        )
    },
    "shards.parquet": {
        name: lambda name=name: (getattr(in_a_shard(tables(**{name: CONE})).stacks[0], name), SAME) for name in "XUY"
    },
}
DOUBLES = {
    "shards.write": {"partition": "numbers of shards", "resume": "yes or no"},
    "shards.parquet": {"links": "columns of doubles or integers; others are refused, see test_tables_that_are_refused"},
}
