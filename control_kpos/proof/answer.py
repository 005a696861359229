"""Answer: what every search returns, a verdict with its certificate and what to do next.

Candidates are untrusted: a linear program, an eigenvector, a random start.  `first_proven` takes them in order
of cost, and the first one that the kernel proves ends the search.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from os import PathLike
from typing import Any, TypeVar

from ..cards import card
from ..errors import DataError
from .certificate import Certificate, Status

C = TypeVar("C")
T = TypeVar("T")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Answer:
    """Outcome of a search.  `bool(answer)` is True only for PROVED.

    Attributes
    ----------
    status : Status
        PROVED: found and proven.  REFUTED: `certificate` proves that it does not exist, in the scope that
        `explain` states.  UNDECIDED: not found, or not proven.
    certificate : Certificate or None
        The proof of either; None, or itself undecided, for UNDECIDED.
    message : str
        What stands in the way of an answer, and what to try.  Empty for PROVED.
    """

    status: Status
    certificate: Certificate | None = None
    message: str = ""

    @property
    def witness(self) -> Any:
        """For REFUTED: what the proof rests on; None otherwise."""
        return self.certificate.witness if self.status is Status.REFUTED and self.certificate is not None else None

    @property
    def margin(self) -> float:
        """Scale-free margin of the certificate; NaN without one."""
        return float("nan") if self.certificate is None else float(self.certificate.margin)

    def check(self) -> bool:
        """Recompute the verdict from the data in the certificate, without any solver.

        Returns
        -------
        bool
            False also for UNDECIDED: there is nothing to check.
        """
        return (
            self.status is not Status.UNDECIDED
            and self.certificate is not None
            and self.certificate.status is self.status
            and self.certificate.check()
        )

    def save(self, path: str | PathLike[str]) -> None:
        """Write the certificate to a file; see `Certificate.save` and `load_certificate`.

        Parameters
        ----------
        path : path-like
            Written whole or not at all.

        Raises
        ------
        DataError
            There is no certificate, because nothing was proven.
        """
        if self.certificate is None or self.status is Status.UNDECIDED:
            raise DataError(f"nothing was proven, so there is no certificate to save: {self.message or 'undecided.'}")
        self.certificate.save(path)

    def explain(self) -> str:
        """The verdict, why it holds, and what to do next, for a person.

        Returns
        -------
        str
        """
        parts = (self.message, "" if self.certificate is None else self.certificate.explain())
        return " ".join(part for part in parts if part)

    def facts(self) -> list[tuple[str, str]]:
        """Names and values for the card that a notebook shows.

        Returns
        -------
        list of (str, str)
        """
        return []

    def __bool__(self) -> bool:
        return self.status is Status.PROVED

    def __repr__(self) -> str:
        more = f": {self.message}" if self.message else ""
        return f"<{type(self).__name__} {self.status.name}{more}>"

    def _repr_html_(self) -> str:
        return card(type(self).__name__, self.facts(), status=self.status.name, text=self.explain())


def first_proven(candidates: Iterable[C], prove: Callable[[C], T | None]) -> T | None:
    """The proof of the first candidate that has one, or None.

    Parameters
    ----------
    candidates : iterable
        In order of cost; a generator makes each only when those before it have failed.
    prove : callable
        Returns a true value (a certificate that is PROVED, an accepted gain) or a false one.

    Examples
    --------
    >>> first_proven((n for n in (3, 4, 5)), lambda n: n * n if n % 2 == 0 else None)
    16
    """
    for candidate in candidates:
        proven = prove(candidate)
        if proven:
            return proven
    return None
