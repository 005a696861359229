"""Files that mean harm, for the tests of reading and the campaign: texts, data within a certificate, archives."""

import json
import random
import zipfile

import numpy as np
import tampering

from control_kpos.proof.files import FORMAT


def with_data(content, **data):
    return json.dumps(tampering.redigested({**content, "data": {**content["data"], **data}}))


HALF = {"rays": [[1]], "w": [1], "Z": [[1]]}


def many_facets(rays, n):
    """A cone in R^n of which nobody has listed the facets."""
    draw = random.Random(n)
    rows = [[draw.randint(-9, 9) for _ in range(n - 1)] + [30] for _ in range(rays)]
    factor = {"rays": rows, "w": [0] * (n - 1) + [1], "Z": [[0] * n] * rays}
    return {"X": {"cone": [[1, factor]]}, "A": {"sparse": [], "shape": [n, n]}}


HOSTILE = {
    "empty": "",
    "binary": bytes(range(256)),
    "not an object": "[1, 2]",
    "deep nesting": "[" * 200_000,
    "deep objects": '{"a":' * 100_000,
    "a float": '{"format": "kpos-certificate/1", "x": 0.1}',
    "NaN": '{"format": "kpos-certificate/1", "x": NaN}',
    "infinity": '{"format": "kpos-certificate/1", "x": Infinity}',
    "a huge exponent": '{"format": "kpos-certificate/1", "x": 1e9999}',
    "a long integer": '{"format": "kpos-certificate/1", "x": ' + "9" * 10**5 + "}",
    "a key twice": '{"format": "kpos-certificate/1", "format": "kpos-certificate/1"}',
    "another version": '{"format": "kpos-certificate/2", "claim": "stable", "status": "PROVED", "data": {}}',
    "no format": '{"claim": "stable", "status": "PROVED", "data": {}}',
    "nothing else": json.dumps({"format": FORMAT}),
    "an unknown claim": json.dumps({"format": FORMAT, "claim": "lovely", "status": "PROVED", "data": {}, "proof": {}}),
    "an unknown key": json.dumps({"format": FORMAT, "run": "rm"}),
}
WRONG_DATA = {
    "a cone of 1e7 half-lines": {"X": {"cone": [[10**7, HALF]]}},
    "a cone of 1e18 half-lines": {"X": {"cone": [[10**18, HALF]]}},
    "a negative count": {"X": {"cone": [[-1, HALF]]}},
    "no cone": {"X": {"cone": []}},
    "a ragged cone": {"X": {"cone": [[1, {"rays": [[1, 2], [3]], "w": [1, 1], "Z": [[1]]}]]}},
    "a sparse matrix of 1e9 rows": {"A": {"sparse": [], "shape": [10**9, 10**9]}},
    "an index out of range": {"A": {"sparse": [[0, 4, 1]], "shape": [4, 4]}},
    "a negative index": {"A": {"sparse": [[-1, 0, 1]], "shape": [4, 4]}},
    "an entry twice": {"A": {"sparse": [[0, 0, 1], [0, 0, 2]], "shape": [4, 4]}},
    "a bool as index": {"A": {"sparse": [[True, 0, 1]], "shape": [4, 4]}},
    "a ragged matrix": {"A": {"matrix": [[1, 2], [3]]}},
    "text that is no number": {"A": {"matrix": [["one"]]}},
    "a decimal exponent": {"A": {"matrix": [["1e400000000"]]}},
    "a hexadecimal exponent": {"A": {"matrix": [["0x1p+999999999"]]}},
    "an overflowing double": {"A": {"matrix": [["0x1p+9999"]]}},
    "1e5 digits": {"A": {"matrix": [["9" * 10**5]]}},
    "a division by zero": {"A": {"matrix": [["1/0"]]}},
    "an unknown record": {"witness": {"record": "os.system", "fields": {}}},
    "a bare list": {"A": [[1]]},
    "a string": {"A": "x"},
    "nothing": {"A": None},
    "v that is not finite": {"v": {"array": ["nan", 1, 1, 1]}},
    "v of the wrong length": {"v": {"array": [1]}},
    "another v": {"v": {"array": [1, -1, 1, -1]}},
    "a rate that is not proven": {"decay_rate": {"double": 1000}},
    "unknown data": {"more": 1},
    "long fractions": {"A": {"matrix": [["0x" + "f1" * 9999 + "/0x" + "e3" * 9999] * 4] * 4}},
    "fractions that are too long": {"A": {"matrix": [["0x" + "f1" * 10**5 + "/0x" + "e3" * 10**5] * 4] * 4}},
    "three cones of 1e5 half-lines": {
        **{key: {"cone": [[10**5, HALF]]} for key in "XUY"},
        **{key: {"sparse": [], "shape": [10**5] * 2} for key in "ABCD"},
    },
    "three cones of 2e4 half-lines": {
        **{key: {"cone": [[20_000, HALF]]} for key in "XUY"},
        **{key: {"sparse": [], "shape": [20_000] * 2} for key in "ABCD"},
    },
    "facets without end": many_facets(60, 20),
    "facets in high dimension": many_facets(90, 30),
    "a family of 1e4": {"A": {"tuple": [{"sparse": [], "shape": [4, 4]}] * 10**4}},
    "a deep vector": {"v": {"array": json.loads("[" * 900 + "1" + "]" * 900)}},
    "a vector of lists": {"v": {"array": [[]] * 10**5}},
    "a long vector": {"v": {"array": [1] * 10**6}},
}


def thousand_parts(content):
    """A feedback with a thousand loops, each with a cone as large as it can be."""
    loop = {"certificate": {**content, "data": {**content["data"], "X": {"cone": [[20_000, HALF]]}}}}
    return {**content, "claim": "feedback", "data": {"loops": {"tuple": [loop] * 1000}, "others": {"tuple": []}}}


def texts(content):
    """Hostile files by name, made of a certificate of stability in R^4 that is in order."""
    yield from HOSTILE.items()
    for name, data in WRONG_DATA.items():
        yield name, with_data(content, **data)
    yield "a thousand parts", json.dumps(tampering.redigested(thousand_parts(content)))


def write_archive(path, members):
    with zipfile.ZipFile(path, "w") as archive:
        for member, data, compression in members:
            archive.writestr(member, data, compression)


def header(kind, shape):
    text = str({"descr": kind, "fortran_order": False, "shape": shape}).ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def archives():
    """Hostile archives by name: lists of members (name, bytes, compression)."""
    good = json.dumps(
        {"format": FORMAT, "claim": "stable", "status": "PROVED", "data": {"A": {"matrix": {"member": "a0"}}}}
    )
    text = ("certificate.json", good.encode(), zipfile.ZIP_STORED)
    numbers = np.zeros(4).tobytes()
    yield "a bomb", [("certificate.json", b" " * 10**8, zipfile.ZIP_DEFLATED)]
    yield "a lying header", [text, ("a0.npy", header("<f8", (10**12,)) + numbers, zipfile.ZIP_STORED)]
    yield "a header too small", [text, ("a0.npy", header("<f8", (1,)) + numbers, zipfile.ZIP_STORED)]
    yield "a negative size", [text, ("a0.npy", header("<f8", (-4,)) + numbers, zipfile.ZIP_STORED)]
    yield "objects", [text, ("a0.npy", header("|O", (4,)) + numbers, zipfile.ZIP_STORED)]
    yield "complex", [text, ("a0.npy", header("<c16", (2,)) + numbers, zipfile.ZIP_STORED)]
    yield "many dimensions", [text, ("a0.npy", header("<f8", (1, 1, 1, 4)) + numbers, zipfile.ZIP_STORED)]
    yield "code in the header", [text, ("a0.npy", header("<f8", "__import__('os')") + numbers, zipfile.ZIP_STORED)]
    yield "no array", [text]
    yield "no text", [("a0.npy", header("<f8", (4,)) + numbers, zipfile.ZIP_STORED)]
    yield "not numpy", [text, ("a0.npy", b"x" * 200, zipfile.ZIP_STORED)]
    yield "a path", [text, ("../../a0.npy", header("<f8", (4,)) + numbers, zipfile.ZIP_STORED)]
    yield "a pickle", [text, ("a0.pkl", b"cos\nsystem\n", zipfile.ZIP_STORED)]
    yield "not finite", [text, ("a0.npy", header("<f8", (2, 2)) + np.full(4, np.nan).tobytes(), zipfile.ZIP_STORED)]
