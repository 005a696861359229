"""The long campaign: random systems with exact truth, changed descriptions, changed files, changed operators.

    python benchmarks/campaign.py systems 100000 --seed 1
    python benchmarks/campaign.py descriptions 1000
    python benchmarks/campaign.py cones 10000
    python benchmarks/campaign.py files 100000
    python benchmarks/campaign.py stated 10000
    python benchmarks/campaign.py shards 1000
    python benchmarks/campaign.py hostile
    python benchmarks/campaign.py kills 100
    python benchmarks/campaign.py threads 500
    python benchmarks/campaign.py digest 500
    python benchmarks/campaign.py kernel
    python benchmarks/campaign.py theorems

Prints what was found and a line with the seed and the time; the exit status is 1 if anything false was found.
`digest` prints a SHA-256 of verdicts, to be compared between machines and versions of Python.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))
sys.path.insert(0, str(ROOT))

# The tests are no package: their folder, and the tree, come first.
import campaigns  # noqa: E402
import certified  # noqa: E402
import sharded_networks  # noqa: E402
import stated_designs  # noqa: E402
import stated_functions  # noqa: E402
import statements  # noqa: E402
import unnoticed  # noqa: E402

import control_kpos as kp  # noqa: E402
from control_kpos import checker  # noqa: E402
from control_kpos.exact import enclosure  # noqa: E402
from control_kpos.exact import signs as exact  # noqa: E402
from control_kpos.proof import certificate, inclusion  # noqa: E402
from control_kpos.theorems import decay_rates, positivity, stability  # noqa: E402
from control_kpos.theorems import growing_direction as growth  # noqa: E402

# Changes that prove the same: parts of their descriptions, and why.
LARGER = "the bound becomes larger, so that more signs are left to integers"
INTEGERS = "the same sign is left to integers"
WORK = "an estimate of work, or a limit on it"
EITHER = "both ways give the same"
AXIS = "axis 1 is the last one of a matrix"
KERNEL = {
    "3 * 10 ** 8 -> ": WORK,
    "cost > EXACT_LIMIT -> ": WORK,
    "_decide_by_integers: len(": WORK,
    "_decide_by_integers: out.ndim": WORK,
    "_decide_by_integers: self.middle is not None -> ": WORK,
    "_decide_by_integers: -1 -> +1": WORK,
    "_stacked: -1 -> +1": WORK,
    "_stacked: self.left.shape[-1] * self.right.shape[-1] -> ": WORK,
    "_sparse_pairs: start + step": WORK,
    "_sparse_pairs: _CHUNK // ": WORK,
    "_row_work: ": WORK,
    "_dense_if_small: m.shape[0]": EITHER,
    "__init__: not self.is_sparse -> ": EITHER,
    "_norm: 0 < count <= _SHORT -> ": EITHER,
    "_csr_integers: m.integer_rows is None -> ": EITHER,
    "_csr_integers: m.numerators is None -> ": EITHER,
    "signs: out == UNKNOWN -> ": INTEGERS,
    "signs: magnitudes <= limit -> ": INTEGERS,
    "g * nl -> g + nl": LARGER,
    "g * self.magnitudes.data -> ": LARGER,
}
POSITIVITY = {
    "index < rows.shape[0] -> ": "a row that is not there is refused when it is used",
    "B is not None and U is not None -> ": "B and its cone U come together",
    "broken_by: '==' -> '<='": "h'x is not negative on the cone",
}
STABILITY = {
    "w.weights is None and ": "a vector that is missing is refused when it is read",
    "-1 -> +1": AXIS,
    "conditions: '>' -> '>='": "v'x = 0 on a generator would make v'A x nonnegative there",
}
SLACK = "the rest of the bound is larger than what is lost"
CAUTION = "claims less"
ENCLOSURE = {
    "3 * 10 ** 6 -> ": WORK,
    "_EXACT -> ": WORK,
    "good.size * self.rays.shape[1] -> ": WORK,
    "sum(self.rays.shape) -> ": WORK,
    "len(blocks)) -> ": SLACK,
    "len(blocks) -> ": SLACK,
    "top > 0 -> top >= 0": EITHER,
    "2 * HALF_ULP -> ": SLACK,
    "1 + 4 * HALF_ULP -> ": SLACK,
    "2.0 ** (-50) -> ": SLACK,
    "residual + value -> residual - value": "both parts change their sign",
    "(4 * HALF_ULP) -> ": SLACK,
    "4 * HALF_ULP -> ": LARGER,
    "np.abs(residual) + np.abs(value) -> ": SLACK,
    "np.abs(value) + np.abs(product) -> ": SLACK,
    "Q >= 0 -> Q > 0": CAUTION,
    "Q[:, open_] >= 0 -> ": CAUTION,
    "lower > 0 -> lower >= 0": CAUTION,
    "entries.data >= 0 -> ": CAUTION,
    "defect < 0.9 -> ": "a limit",
    "residual.radius -> ": SLACK,
    "sum(axis=1) * defect -> ": LARGER,
    "(8 * HALF_ULP) -> ": LARGER,
    "np.abs(Q) + np.abs(step) -> ": SLACK,
    "8 * HALF_ULP -> ": LARGER,
    "SMALLEST_NORMAL -> ": SLACK,
    "-exponent -> +exponent": LARGER,
    "integers == 0 -> ": SLACK,
    "_size: ": "the size that a margin refers to",
}
INCLUSION = {"B is not None and U is not None -> ": "what is missing is refused when it is read"}
DISSIPATIVITY = {
    "-1 -> +1": AXIS,
    "self.v is None and self.r is None": "a vector that is missing is refused when it is read",
}


def systems(count, seed):
    """Near-marginal Metzler matrices against exact minors."""
    found = campaigns.wrong_verdicts(count, seed)
    print(f"{count} systems, {found['stable']} stable: {len(found['false'])} false, {found['undecided']} undecided")
    return found["false"]


def descriptions(count, seed):
    """Similarity, order, scalings, repeated generators."""
    found = campaigns.changed_verdicts(count, seed)
    print(f"{count} systems in eight descriptions: {len(found)} changed verdicts {sorted({name for name, _ in found})}")
    return found


def cones(count, seed):
    """Both readers of files on claims of every kind, on cones with many generators."""
    with tempfile.TemporaryDirectory() as folder:
        found, seen = campaigns.disagreements(count, seed, Path(folder) / "file.json")
    print(f"{count} systems on polyhedral cones: {len(found)} disagreements {[item[:3] for item in found[:3]]}")
    print(", ".join(f"{number} {name}" for name, number in sorted(seen.items())))
    return found


def files(count, seed):
    """Mutants of certificate files of every kind: none is accepted falsely, and both readers say the same of them."""
    with tempfile.TemporaryDirectory() as folder:
        path, contents = Path(folder) / "file.json", []
        for make in certified.CERTIFICATES.values():
            make().save(path)
            contents.append(json.loads(path.read_text()))
        each = -(-count // len(contents))
        found, accepted = campaigns.contradictions(contents, each, seed, path)
        print(f"{each * len(contents)} changed files: {accepted} accepted, {len(found)} of them falsely", flush=True)
        apart, accepted = campaigns.divided(contents, each, seed, path)
    print(f"one thing changed: {accepted} accepted, of {len(apart)} the readers say two things {apart[:3]}")
    return found + apart


def stated(count, seed):
    """What methods promise: gains, limits, refusals, rates, brackets, edits, coverage, slopes; and foreign errors."""
    out = []
    for falsehoods in (
        statements.false_coverage,
        statements.false_networks,
        stated_designs.false_designs,
        stated_functions.false_functions,
    ):
        found = falsehoods(count, seed)
        print(f"{falsehoods.__name__}: {len(found)} of {count} {found[:3]}", flush=True)
        out += found
    with tempfile.TemporaryDirectory() as folder:
        for mode in ("warn", "raise"):
            found = statements.foreign_errors(count, seed, mode, Path(folder) / "file.json")
            print(f"foreign errors, np.errstate(all={mode!r}): {len(found)} of {count} {found[:3]}", flush=True)
            out += found
    return out


def shards(count, seed):
    """Random networks in one piece and in shards, half of them at the margin or around it."""
    with tempfile.TemporaryDirectory() as folder:
        found = sharded_networks.verdicts(range(seed, seed + count), Path(folder))
    print(", ".join(f"{found[name]} {name}" for name in ("PROVED", "REFUTED", "UNDECIDED", "in one piece")))
    print(f"{count} networks in shards: {found['false']} false, {found['less decided']} decided in one process only")
    return ["shards"] * (found["false"] + found["less decided"])


def hostile(_, seed):
    """Time and memory of both readers on every hostile file."""
    worst, found, count = {}, [], 0
    with tempfile.TemporaryDirectory() as folder:
        for name, path in campaigns.hostile_files(Path(folder)):
            for reader in (kp.load_certificate, checker.main):
                count += 1
                seconds, megabytes, outcome = campaigns.cost(reader, path)
                key = reader.__module__.rpartition(".")[2]
                if (
                    not seconds < 1
                    or not megabytes < 200
                    or outcome not in ("CertificateFileError", "FalseClaimError", "read")
                ):
                    found.append((name, key, seconds, megabytes, outcome))
                for what, size in (("s", seconds), ("MB", megabytes)):
                    worst[key, what] = max(worst.get((key, what), (0.0, "")), (size, name))
    for (key, what), (size, name) in sorted(worst.items()):
        print(f"{key}: at most {size:.2f} {what} ({name})")
    print(f"{count} readings of hostile files: {len(found)} too slow, too large or not refused {found}")
    return found


def kills(count, seed):
    """Writers killed at random moments."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for suffix in ("json", "npz"):
            path = Path(folder) / f"file.{suffix}"
            found += campaigns.half_written(count, seed, path)
    print(f"{2 * count} writers killed, half of them writing archives: {len(found)} files damaged {found[:3]}")
    return found


def digest(count, seed):
    """One number for the verdicts of a seed."""
    print(campaigns.digest(count, seed))
    return []


def threads(count, seed):
    """The same verdicts with one and with four threads."""
    seen = {}
    for number in ("1", "4"):
        environment = {**os.environ, "OMP_NUM_THREADS": number, "OPENBLAS_NUM_THREADS": number}
        command = [sys.executable, __file__, "digest", str(count), "--seed", str(seed)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        seen[number] = done.stdout.split()[0]
    print(f"verdicts on {count} systems with 1 and 4 threads: {sorted(set(seen.values()))}")
    return sorted(set(seen.values()))[1:]


def kernel(_, seed):
    """Every comparison, sign and connective of the trusted kernel changed, its tests run on each."""
    return changed_operators(exact, ["tests/test_exact.py"], None, KERNEL)


def theorems(_, seed):
    """The same for the conditions of Theorems 1 to 3 and the forms they are made of."""
    shared = {"conditions", "refutation", "is_consistent", "_evaluate", "settle_positivity"}
    positive = shared | {"condition", "broken_by", "_incident_entries"}
    stable = shared | {"exactly", "drift_forms", "transposed_drift", "transpose", "_slow_conditions"}
    stable |= {"instability_conditions", "combination_conditions"}
    dissipative = shared | {"_state_forms", "_input_forms", "_motion_forms", "_supply_forms"}
    tests = ["tests/test_positivity.py", "tests/test_generators.py"]
    found = []
    for module in (positivity, inclusion):
        found += changed_operators(module, tests, positive, POSITIVITY)
    for module in (stability, decay_rates, growth, certificate):
        found += changed_operators(module, ["tests/test_stability.py", "tests/test_generators.py"], stable, STABILITY)
    return found + changed_operators(
        sys.modules["control_kpos.theorems.dissipativity"], ["tests/test_dissipativity.py"], dissipative, DISSIPATIVITY
    )


def enclosures(_, seed):
    """The same for combinations of generators in floating point, which prove found cones and cones with many facets."""
    found = changed_operators(enclosure, ["tests/test_enclosure.py"], None, ENCLOSURE)
    own = {"conditions"}
    return found + changed_operators(inclusion, ["tests/test_generators.py"], own, INCLUSION)


def changed_operators(module, tests, functions, harmless):
    """Changes that the tests do not notice and that are not known to be harmless; prints both."""
    os.chdir(ROOT)
    found, known, count = [], 0, 0
    for count, where in unnoticed.unnoticed(module, tests, functions):  # noqa: B007  (the last count is all of them)
        if where is None:
            continue
        reason = next((reason for change, reason in harmless.items() if change in where), None)
        known += reason is not None
        found += [where] * (reason is None)
        print(f"  {'harmless' if reason else 'UNNOTICED'}: {where}{f': {reason}' if reason else ''}", flush=True)
    print(f"{module.__name__}: {count} changed operators, {known} harmless, {len(found)} others not noticed by {tests}")
    return found


def main():
    """Run one part."""
    parts = {
        part.__name__: part
        for part in (
            systems,
            descriptions,
            cones,
            files,
            stated,
            shards,
            hostile,
            kills,
            digest,
            threads,
            kernel,
            theorems,
            enclosures,
        )
    }
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=parts)
    parser.add_argument("count", type=int, nargs="?", default=1000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    start = time.perf_counter()
    found = parts[options.part](options.count, options.seed)
    print(f"seed {options.seed}, {time.perf_counter() - start:.0f} s")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
