"""Bytes of memory a node of two states takes to certify and to check, above the interpreter and above the data.

    python benchmarks/memory.py 3-regular 1e6

Linux only: the largest resident size is set back and read in /proc.  One process measures one network.
"""

import gc
import re
import sys
import time
from pathlib import Path

import bench_networks as bench

import control_kpos as kp


def resident(name):
    """VmRSS or VmHWM of this process, in bytes."""
    return 1024 * int(re.search(rf"{name}:\s+(\d+)", Path("/proc/self/status").read_text()).group(1))


def measured(step, before, n):
    """What a step answers, its CPU time, and the bytes a node at its peak."""
    Path("/proc/self/clear_refs").write_text("5")
    start = time.process_time()
    out = step()
    return out, time.process_time() - start, (resident("VmHWM") - before) / n


def main(graph="3-regular", count="1e6"):
    n = int(float(count))
    bench.network(graph, 300).certificate.check()  # what is imported or made once
    A, B, C, D = kp.examples.mass_spring_nodes(n, seed=1)
    W = bench.GRAPHS[graph](n)
    gc.collect()
    before = resident("VmRSS")

    def certify():
        nodes = kp.stack(A, B, C, D, X=kp.examples.paper_cone())
        return kp.feedback_interconnect(nodes, W, progress=False).certificate

    certificate, seconds, size = measured(certify, before, n)
    print(f"{graph}, N = {n}: {certificate.status.name}, rate {certificate.decay_rate!r}")
    print(f"certify {seconds:.2f} s of CPU, {size:.0f} bytes a node")
    holds, seconds, size = measured(certificate.check, before, n)
    print(f"check   {seconds:.2f} s of CPU, {size:.0f} bytes a node, {holds}")


if __name__ == "__main__":
    main(*sys.argv[1:])
