"""Every argument of every public function, with every malformed value: an error that names it, or a right answer."""

import inspect

import matplotlib.pyplot as plt
import pytest
from malformations import VALUES
from malformed_calls import CALLS

import control_kpos as kp

# Parameters that are no data of this package: python-control's own, passed on as they come, and callables of the
# user, whose errors are theirs.
NOT_OURS = {"args", "kwargs", "names", "demands", "self", "cls"}
# Other words by which a message may name an argument.
OTHER_NAMES = {
    "time_limit": ("time limit",),
    "inputs": ("B matrix", "input"),
    "outputs": ("C matrix", "output"),
    "states": ("A matrix", "state"),
    "systems": ("nodes",),
    "types": ("nodes",),
    "T": ("U is",),
    "A": ("contains", "discrete", "max_rays", "names"),
    "x": ("the cones",),
    "other": ("sys[", "dt =", "incompatible"),
    "discrete": ("positive",),
    "sys": ("A[", "X has dimension"),
    "jacobians": ("region",),
    "out": ("the folder",),
}
# Errors of the operating system are what they are.
ALSO = {"load_certificate": OSError, "Certificate.save": OSError}
ALSO |= dict.fromkeys(["shards.write", "shards.parquet", "shards.certify", "shards.check"], OSError)
# Called with lines of text: what a callable makes of them is its own business.
CALLABLES = {"progress", "solver", "constraints", "objective"}


def argument_of(case):
    name, argument = case
    return f"{name}-{argument}"


CASES = [(name, argument) for name, (_, arguments) in CALLS.items() for argument in arguments]


@pytest.mark.filterwarnings("ignore::control_kpos.errors.ActuatorLossWarning")
@pytest.mark.parametrize("name", CALLS)
def test_the_valid_call_is_valid(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    function, arguments = CALLS[name]
    if name == "load_certificate":
        return
    function(**arguments)


@pytest.mark.filterwarnings("ignore::control_kpos.errors.ActuatorLossWarning")
@pytest.mark.parametrize("case", CASES, ids=argument_of)
def test_malformed_arguments(case, tmp_path, monkeypatch):
    name, argument = case
    function, arguments = CALLS[name]
    monkeypatch.chdir(tmp_path)  # text is a path to some
    for label, make in VALUES.items():
        value = make()
        if argument in CALLABLES and callable(value):
            continue
        try:
            answer = function(**{**arguments, argument: value})
        except kp.KposError as error:
            text = str(error)
            assert any(word in text for word in (argument, *OTHER_NAMES.get(argument, ()))), f"{label}: {text}"
        except ALSO.get(name, ()):
            pass
        else:
            if isinstance(answer, kp.Certificate) and answer.status is not kp.Status.UNDECIDED:
                assert answer.check(), label
        plt.close("all")


def test_every_public_argument_is_tried():
    tried = {}
    for name, (_, arguments) in CALLS.items():
        tried.setdefault(name.split(" ")[0], set()).update(arguments)
    for name, thing in public_callables().items():
        missing = set(inspect.signature(thing).parameters) - NOT_OURS - tried.get(name, set())
        assert not missing, f"{name}: try {missing} in malformed_calls.py"


def public_callables():
    """Functions, constructors and methods that a user calls with data of their own, by name."""
    out = {}
    rooms = [("", vars(kp) | {n: getattr(kp, n) for n in dir(kp)})]
    rooms += [("examples.", vars(kp.examples)), ("shards.", vars(kp.shards))]
    for prefix, names in rooms:
        for name, thing in names.items():
            own = getattr(thing, "__module__", "").startswith(f"control_kpos.{prefix}".rstrip("."))
            if own and inspect.isfunction(thing) and not name.startswith("_"):
                out[prefix + name] = thing
    out["PolyhedralCone"] = kp.PolyhedralCone.__init__
    out["PolyhedralCone.from_facets"] = kp.PolyhedralCone.from_facets
    for cls, skipped in (
        (kp.Cone, {"require_proper"}),
        (kp.ConeStateSpace, {"linearize", "to_ss"}),
        (kp.ConeNetwork, {"linearize", "to_ss", "updfcn", "outfcn", "horner"}),
        (kp.OutWeightCertificate, set()),
    ):
        for parent in cls.__mro__:
            for name, thing in vars(parent).items():
                if (
                    inspect.isfunction(thing)
                    and thing.__module__.startswith("control_kpos")
                    and not name.startswith("_")
                    and not hasattr(kp.Certificate, name)
                    and name not in skipped
                ):
                    out[f"{cls.__name__}.{name}"] = thing
    return out
