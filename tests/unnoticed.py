"""Which changed operators of a module of the package do its tests not notice?  For the campaign.

A process is forked for each change.  It puts the changed code into the functions that are already imported, so that
every module that uses them sees it, and runs the tests.
"""

import ast
import inspect
import os
import signal
import types
from functools import cached_property
from pathlib import Path

import pytest
import tampering

from control_kpos.proof import encoding, files

_SECONDS = 300


def unnoticed(module, tests, functions=None, constants=False):
    """Descriptions of the changes that the tests do not notice, and the number of all changes.

    Parameters
    ----------
    module : module of the package
    tests : list of str
        Arguments for pytest.
    functions : set of str, optional
        Only inside functions of these names.
    constants : bool
        Change numbers as well.

    Yields
    ------
    count : int
    where : str or None
        The change if it was not noticed.
    """
    source, own = Path(module.__file__).read_text(), dict(code(vars(module), module.__name__))
    for count, (where, tree) in enumerate(tampering.source_mutants(source, functions, constants), 1):
        child = os.fork()
        if child == 0:
            os._exit(int(notices(module, own, tree, tests)))
        _, status = os.waitpid(child, 0)
        yield count, where if status == 0 else None


def notices(module, own, tree, tests):
    """True if the tests fail, or do not end, with the changed module."""
    names = {**vars(module)}
    registered = [(registry, dict(registry)) for registry in (encoding._records, files._restorers)]
    try:
        exec(compile(ast.fix_missing_locations(tree), module.__file__, "exec"), names)
    except Exception:  # noqa: BLE001 - a module that cannot be imported is noticed
        return True
    for registry, entries in registered:  # the classes stay the ones that everybody has
        registry.update(entries)
    for name, changed in code(names, module.__name__):
        own[name].__code__, own[name].__defaults__ = changed.__code__, changed.__defaults__
    for name, value in names.items():
        if type(value) in (int, float, tuple):
            setattr(module, name, value)
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    signal.alarm(_SECONDS)  # what runs for ever is noticed
    os.environ["CI"] = "1"  # the same examples every time, and none that an earlier change left behind
    options = [
        "-x",
        "-q",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "-W",
        "ignore::pytest.PytestAssertRewriteWarning",
    ]
    return pytest.main([*options, *tests]) != 0


def code(names, module):
    """Functions and methods that a module defines, by name, without what decorates them."""
    for name, thing in names.items():
        if getattr(thing, "__module__", None) != module:
            continue
        if isinstance(thing, types.FunctionType):
            yield name, inspect.unwrap(thing)
        elif isinstance(thing, type):
            for attribute, method in vars(thing).items():
                inner = method.func if isinstance(method, cached_property) else method
                inner = getattr(inner, "__func__", getattr(inner, "fget", inner))
                if isinstance(inner, types.FunctionType):
                    yield f"{name}.{attribute}", inspect.unwrap(inner)
