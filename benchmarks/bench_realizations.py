"""How often hidden positive realizations are found, with how many states, how fast; every success proven."""

import sys
import time
from pathlib import Path

import numpy as np

import control_kpos as kp

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from realized_systems import hidden


def test_hidden_realizations(benchmark, size):
    systems = [hidden(seed) for seed in range(size(120, 8))]
    times, orders = [], []

    def run():
        for G, n in systems:
            start = time.perf_counter()
            found = kp.positive_realization(G)
            times.append(time.perf_counter() - start)
            if found and found.check():
                orders.append((found.order / n, found.order == found.lower_bound))

    benchmark.pedantic(run, rounds=1)
    info = {
        "proved": f"{len(orders)} of {len(systems)}",
        "orders by those hidden, largest": max(ratio for ratio, _ in orders),
        "proven to be the smallest": sum(smallest for _, smallest in orders),
        "median seconds": round(float(np.median(times)), 3),
        "longest": round(max(times), 2),
    }
    benchmark.extra_info.update(info)
    print(f"\n    {benchmark.name}: {info}")
    assert sum(ratio <= 1.5 for ratio, _ in orders) >= 0.95 * len(systems)
