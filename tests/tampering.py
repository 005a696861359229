"""Certificate files with one thing changed, and source code with one operator changed."""

import ast
import contextlib
import copy
import functools
import hashlib
import json
import random
import sys
import types
from fractions import Fraction

from control_kpos import checker


def redigested(content):
    """The content with the digest that belongs to its data."""
    text = json.dumps(content["data"], sort_keys=True, separators=(",", ":"))
    return {**content, "digest": "sha256:" + hashlib.sha256(text.encode()).hexdigest()}


def leaves(node, path=()):
    """Paths to everything in JSON data that is not a list or an object."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield from leaves(value, (*path, key))
    elif isinstance(node, list):
        for index, value in enumerate(node):
            yield from leaves(value, (*path, index))
    else:
        yield path


def at(content, path):
    for key in path:
        content = content[key]
    return content


def replaced(content, path, value):
    """A copy with another value at a path, and the digest that belongs to it."""
    out = copy.deepcopy(content)
    at(out, path[:-1])[path[-1]] = value
    return redigested(out)


def is_number(value):
    return not isinstance(value, bool) and (
        isinstance(value, int) or (isinstance(value, str) and value[:1] in "-0123456789")
    )


NUMBERS = (
    0,
    1,
    -1,
    2,
    -3,
    "1/3",
    "-0x1.8000000000000p+0",
    "0x1.0000000000000p-60",
    "-1/1000000",
    "1000000000000000000",
)
THINGS = (
    None,
    True,
    False,
    [],
    {},
    "",
    "PROVED",
    "REFUTED",
    "A",
    "B",
    [1],
    {"array": [1]},
    10**5 + 7,
    "nan",
    "1e9",
    "0x",
    -1,
)


def mutants(content, count, seed):
    """Random changes of a file: numbers, other values, parts taken away or doubled."""
    rng = random.Random(seed)
    paths = [path for path in leaves(content) if path[0] in ("claim", "status", "data", "proof")]
    numbers = [path for path in paths if is_number(at(content, path))]
    for _ in range(count):
        kind = rng.random()
        if kind < 0.7 and numbers:
            yield replaced(content, rng.choice(numbers), rng.choice(NUMBERS))
        elif kind < 0.85:
            yield replaced(content, rng.choice(paths), rng.choice(THINGS))
        else:
            path = rng.choice(paths)
            out = copy.deepcopy(content)
            part = at(out, path[: rng.randint(1, len(path))][:-1])
            if isinstance(part, dict) and part:
                del part[rng.choice(list(part))]
            elif isinstance(part, list) and part:
                index = rng.randrange(len(part))
                part[index:index] = [] if rng.random() < 0.5 else [part[index]]
                if rng.random() < 0.5:
                    del part[index]
            yield redigested(out) if "data" in out else out


def spelled(x):
    """A number as files have it."""
    x = Fraction(x)
    whole = x.denominator == 1 and abs(x) < 10**18
    return int(x) if whole else float(x).hex() if Fraction(float(x)) == x else f"{x.numerator}/{x.denominator}"


def other_values(value):
    """What to put in the place of a leaf: other numbers, the same in other words, things of another kind."""
    if not is_number(value):
        return [x for x in (None, True, not value, 1, "other", "nan", [value]) if x is not value]
    x = checker.number(value)
    near = [0, x + 1, -x, -2 * x - 1, x * (1 + Fraction(1, 2**30)), x * (1 - Fraction(1, 2**30)), x + Fraction(1, 3)]
    same = [f"{x.numerator:#x}/{x.denominator:#x}", f"{2 * x.numerator}/{2 * x.denominator}"]
    return [spelled(y) for y in near if y != x] + same + [None, "x", True, [value], {"double": value}]


def other_lists(items):
    """Shorter, longer, in another order, of something else."""
    swapped = [items[:1:-1] + items[1::-1], [*items[1::-1], *items[2:]]] if len(items) > 1 else []
    return [items[:-1], [*items, items[-1]], [items[0], *items], *swapped, [], None] if items else [[0], None]


def other_objects(node):
    """Without an entry, with one more, of another kind."""
    fewer = [{key: x for key, x in node.items() if key != gone} for gone in node]
    kinds = [{kind: x} for x in node.values() for kind in ("array", "fractions", "tuple") if len(node) == 1]
    return [*fewer, {**node, "more": {"double": 1}}, {**node, "more": None}, None, *kinds]


def single_changes(content):
    """Pairs of a path and what to put there: of every leaf, list and object."""
    for path in [path for path in places_in(content) if path and path[0] in ("claim", "status", "data", "proof")]:
        value = at(content, path)
        others = {dict: other_objects, list: other_lists}.get(type(value), other_values)(value)
        yield from ((path, other) for other in others)


def places_in(node, path=()):
    """Paths to everything in JSON data."""
    yield path
    for key, value in node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ():
        yield from places_in(value, (*path, key))


# -- source code

COMPARISONS = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.GtE),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
# relations that conditions are given as text
RELATIONS = {">": (">=", "<"), ">=": (">", "<="), "<": ("<=", ">"), "<=": ("<", ">="), "==": (">=", "<=")}
OPERATORS = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Add}


def source_mutants(source, functions=None, constants=False):
    """Pairs of (where, syntax tree) with one comparison, sign, connective or negation changed.

    With `functions`, only inside functions of these names; with `constants`, numbers are changed as well.
    """
    tree = ast.parse(source)
    for parent, name in places(tree):
        if functions is not None and name not in functions:
            continue
        before = ast.unparse(parent)[:100]
        for node, change in [*changes(parent), *(numbers(parent) if constants else ())]:
            undo = change()
            yield f"line {node.lineno}: {name}: {before} -> {ast.unparse(parent)[:100]}", copy.deepcopy(tree)
            undo()


def changed_functions(source):
    """Pairs of (where, definition of a function) with one operator changed, in place until the next is asked for."""
    for top in ast.parse(source).body:
        for parent in ast.walk(top):
            for _, change in changes(parent):
                before = ast.unparse(parent)
                undo = change()
                yield f"{top.name}: {before} -> {ast.unparse(parent)}", top
                undo()


@contextlib.contextmanager
def installed(top, names):
    """The code of a changed function in a module that is there already, for a while."""
    changed = dict(names)
    exec(compile(ast.fix_missing_locations(ast.Module([top], [])), "changed", "exec"), changed)
    function, own = names[top.name], names[top.name].__code__
    function.__code__ = changed[top.name].__code__
    try:
        yield
    finally:
        function.__code__ = own


def places(tree, name=""):
    for child in ast.iter_child_nodes(tree):
        inside = child.name if isinstance(child, ast.FunctionDef) else name
        yield child, inside
        yield from places(child, inside)


def numbers(node):
    """Changes of the numbers that stand directly in a node, as those of `changes`."""
    for _, value in ast.iter_fields(node):
        items = value if isinstance(value, list) else [value]
        for item in items:
            if isinstance(item, ast.Constant) and type(item.value) in (int, float):
                old = item.value
                others = (old + 1, old - 1) if isinstance(old, int) else (2 * old, old / 2)
                for other in others:
                    yield item, functools.partial(reset, item, other)


def reset(item, value):
    old, item.value = item.value, value
    return lambda: setattr(item, "value", old)


def changes(node):
    """Changes of one node, each as a function that makes it and returns one that undoes it."""

    def setter(owner, field, value):
        def change():
            old = getattr(owner, field)
            setattr(owner, field, value)
            return lambda: setattr(owner, field, old)

        return change

    if isinstance(node, ast.Compare):
        for k, operator in enumerate(node.ops):
            for other in COMPARISONS[type(operator)]:
                yield node, setter(node, "ops", [*node.ops[:k], other(), *node.ops[k + 1 :]])
    elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in RELATIONS:
        for other in RELATIONS[node.value]:
            yield node, setter(node, "value", other)
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        yield node, setter(node, "op", OPERATORS[type(node.op)]())
    elif isinstance(node, ast.BoolOp):
        yield node, setter(node, "op", ast.And() if isinstance(node.op, ast.Or) else ast.Or())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield node, setter(node, "op", ast.UAdd())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield node, setter(node, "operand", ast.UnaryOp(ast.Not(), node.operand))


def compiled(tree, name):
    """Names that a changed module defines."""
    module = types.ModuleType(name)
    sys.modules[name] = module  # where dataclasses look for the names in annotations
    exec(compile(ast.fix_missing_locations(tree), name, "exec"), vars(module))
    return vars(module)
