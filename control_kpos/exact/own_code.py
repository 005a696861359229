"""The Python code that a call runs: refused if it can tell one type of argument from another.

An object can refuse comparisons and conversions, but not `type(x)`, `x is y` or an `except` clause that another
library's error leads to: a function that uses them may do with numbers something else than with intervals.  The code of
every function that is entered is read, wherever it was written; only numpy, `copy`, `fractions` and this package, with
what it calls of the standard library, are trusted.
"""

from __future__ import annotations

import builtins
import copy
import dis
import fractions
import gc
import sys
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np

_HERE, _LIBRARY = str(Path(__file__).parent.parent), str(Path(copy.__file__).parent)
_TRUSTED = (str(Path(np.__file__).parent), _HERE, copy.__file__, fractions.__file__)
# Names, of builtins, attributes and functions, that tell a type, an identity or a place in memory.
_NAMES = (
    "type id getattr hasattr vars attrgetter methodcaller is_ is_not getattr_static singledispatch "
    "__class__ __dict__ __array_interface__ __array_struct__ __mro__ __exit__ __aexit__ __getattribute__ "
    "dtype base flags data ctypes strides itemsize nbytes tobytes tolist item astype view "
    "issubdtype isscalar isrealobj iscomplexobj isreal iscomplex isdtype iterable result_type can_cast promote_types "
    "common_type min_scalar_type mintypecode typename obj2sctype asarray_chkfinite may_share_memory shares_memory "
    "getrefcount get_referents get_referrers getsizeof "
    "_getframe currentframe settrace setprofile gettrace Thread ThreadPool ThreadPoolExecutor start_new_thread"
)
_TELLING = frozenset(_NAMES.split())
_TELLING_OBJECTS = (type, id, getattr, hasattr, vars)
_SINGLE = (None, True, False, Ellipsis)


def followed(call: Callable[[], Any]) -> tuple[Any, list[str]]:
    """What a call returns, and what in the code that it ran can tell types apart; [] if there is nothing.

    Examples
    --------
    >>> followed(lambda: max(1, 2)), followed(lambda: type(1.5))
    ((2, []), (<class 'float'>, ['type']))
    """
    found: dict[str, None] = {}

    def enter(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and not _is_trusted(frame):
            found.update(dict.fromkeys(_seen(frame)))

    before, collects = sys.gettrace(), gc.isenabled()
    gc.disable()  # what others do when garbage is collected is no part of the call
    sys.settrace(enter)
    try:
        return call(), list(found)
    finally:
        sys.settrace(before)
        if collects:
            gc.enable()


def _is_trusted(frame: FrameType) -> bool:
    file, caller = frame.f_code.co_filename, frame.f_back
    if file.startswith(_LIBRARY) and caller is not None and caller.f_code.co_filename.startswith(_HERE):
        return "site-packages" not in file
    return file.startswith(_TRUSTED)


def _seen(frame: FrameType) -> Iterator[str]:
    """What the code of a frame, or a name or a variable in it, can tell."""
    code = frame.f_code
    yield from _in_code(code)
    for name in code.co_names:
        if _is_telling(frame.f_globals.get(name, getattr(builtins, name, None))):
            yield name
    yield from (name for name, value in frame.f_locals.items() if _is_telling(value))


def _is_telling(value: Any) -> bool:
    """Under whatever name."""
    if any(value is item for item in _TELLING_OBJECTS):
        return True
    if type(value).__name__ not in ("function", "builtin_function_or_method", "_ArrayFunctionDispatcher"):
        return False
    return value.__name__ in _TELLING


@lru_cache(maxsize=1000)
def _in_code(code: CodeType) -> tuple[str, ...]:
    """What stands in the code itself: `is`, `try`, telling names."""
    steps = [step for step in dis.get_instructions(code) if step.opname not in ("CACHE", "EXTENDED_ARG", "PRECALL")]
    found = [name for name in (code.co_name, *code.co_names) if name in _TELLING]
    for k, step in enumerate(steps):
        if step.opname == "IS_OP" and not _with_a_single_object(steps[max(k - 2, 0) : k]):
            found.append("is")
        if step.opname == "PUSH_EXC_INFO" and steps[k + 1].opname != "WITH_EXCEPT_START":
            found.append("try")
    return tuple(dict.fromkeys(found))


def _with_a_single_object(operands: list[dis.Instruction]) -> bool:
    """Whether `is` compares with None, True, False or `...`, which neither a number nor an interval is."""
    first, second = operands
    if _is_single(second):
        return True
    return _is_single(first) and second.opname.startswith(("LOAD_FAST", "LOAD_DEREF", "LOAD_GLOBAL", "LOAD_NAME"))


def _is_single(step: dis.Instruction) -> bool:
    return step.opname == "LOAD_CONST" and any(step.argval is item for item in _SINGLE)
