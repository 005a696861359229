"""Small networks written to files in shards, for the tests of shards."""

import shutil
from collections import Counter

import numpy as np
import random_networks
from network_examples import cycle, lag, random_masses

import control_kpos as kp


def written(place, nodes, coupling, parts, name="network"):
    return kp.shards.write((nodes, coupling), place / name, parts, progress=False)


def certified(place, nodes, coupling, parts, name="network"):
    folder = written(place, nodes, coupling, parts, name)
    return kp.shards.certify(folder, folder / "proof", progress=False)


def masses(seed=1, n=24):
    return random_masses(np.random.default_rng(seed), n), kp.examples.random_regular(n, 3, seed=seed)


def verdicts(seeds, place):
    """Random networks, every other one at the margin or around it, in one piece and in shards: how both are decided.

    "false" counts contradictions and certificates that do not check, "less decided" what only one process decides.
    """
    counts = Counter()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        if seed % 2:
            nodes, blocks, _ = random_networks.random_network(rng)
            W = random_networks.dense_coupling(nodes, blocks)
        else:
            nodes, W, _ = random_networks.marginal_network(rng) or ([lag(2.0)] * 3, cycle(3), False)
        one = kp.feedback_interconnect(nodes, W).certificate
        found = certified(place, nodes, W, int(rng.integers(1, len(nodes) + 3)), f"{seed}")
        again = kp.shards.check(found.path)
        mine, proven = ((c.status, c.decay_rate, f"{c.witness}") for c in (found, again))
        decided = [c.status.name for c in (one, found) if c.status != "UNDECIDED"]
        counts[found.status.name] += 1
        counts["in one piece"] += found.whole is not None
        counts["false"] += len(set(decided)) > 1 or mine != proven
        counts["less decided"] += found.status == "UNDECIDED" and one.status != "UNDECIDED"
        shutil.rmtree(place / f"{seed}")
    return counts
