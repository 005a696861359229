"""Arguments of families: members as exact matrices of one size, one cone, one time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from control import StateSpace
from numpy.typing import ArrayLike

from ..cones import Cone, as_cone
from ..cones.orthant import nonnegative
from ..errors import ConeMismatchError, DataError, ShapeError, TimebaseError
from ..exact.intake import dimensions, flag, items
from ..exact.matrix import Matrix, is_sparse
from ..systems.system import System


@dataclass(frozen=True)
class Family:
    """Members A_0, .., A_S-1 on X.

    Attributes
    ----------
    matrices : tuple of Matrix, shape (n, n)
    X : Cone
    discrete : bool
    """

    matrices: tuple[Matrix, ...]
    X: Cone
    discrete: bool


def read_family(family: Any, X: Cone | ArrayLike | None, discrete: Any) -> Family:
    """Check the members and gather them.

    Raises
    ------
    DataError, ShapeError, ConeMismatchError, NotProperConeError, TimebaseError
        Naming the member, what was found and what to do.
    """
    members = _listed(family)
    read = [System.read(member, f"family[{s}]") for s, member in enumerate(members)]
    n = read[0].A.shape[0]
    if not n:
        raise ShapeError("family[0] has no states; there is nothing to switch.")
    for s, system in enumerate(read):
        if system.A.shape[0] != n:
            raise ShapeError(
                f"family[{s}] has {system.A.shape[0]} states, but family[0] has {n}; all members must be of one size."
            )
    systems = [(s, system) for s, system in enumerate(read) if isinstance(members[s], (StateSpace, System))]
    cone, steps = cone_and_time(systems, X, discrete, n)
    return Family(tuple(system.A for system in read), cone, steps)


def cone_and_time(
    systems: list[tuple[int, System]], X: Any, discrete: Any, n: int, first: str = "family[0]", whole: str = "family"
) -> tuple[Cone, bool]:
    """The proper cone of numbered systems with n states, and their time; or those given, for matrices.

    `first` and `whole` are what messages call the first of them, and what it stands in.
    """
    cone = _cone(systems, X, n, first)
    cone.require_proper("X")
    return cone, _time(systems, discrete, whole)


def _listed(family: Any) -> list[Any]:
    if isinstance(family, (StateSpace, System)) or is_sparse(family):
        raise DataError("family is one member; give a list of them, such as [A1, A2].")
    members = items(family, "family")
    if not members:
        raise DataError("family is empty; give at least one member.")
    for s, member in enumerate(members):
        if not isinstance(member, (StateSpace, System, Matrix)) and not is_sparse(member) and dimensions(member) != 2:
            raise DataError(
                f"family[{s}] is neither a matrix nor a state-space system; give a list of them, such as [A1, A2]."
            )
    return members


def _cone(systems: list[tuple[int, System]], X: Cone | ArrayLike | None, n: int, name: str) -> Cone:
    if X is not None or not systems:
        cone = nonnegative(n) if X is None else as_cone(X, "X")
        if cone.dim != n:
            raise ConeMismatchError(f"X is a cone in {cone.dim} dimensions, but {name} has {n} states.")
        return cone
    first, cone = systems[0][0], systems[0][1].X
    for s, system in systems:
        if cone != system.X:
            raise ConeMismatchError(f"family[{s}] has another cone than family[{first}]; give one with X=.")
    return cone


def _time(systems: list[tuple[int, System]], discrete: Any, whole: str) -> bool:
    kinds = {system.discrete for _, system in systems}
    if len(kinds) > 1:
        raise TimebaseError("family has members in continuous and in discrete time; all must be of one time.")
    if discrete is None:
        return kinds.pop() if kinds else False
    wanted = flag(discrete, "discrete")
    if kinds and kinds != {wanted}:
        raise TimebaseError(f"discrete is {wanted}, but the time of {whole} is another one; leave it out.")
    return wanted
