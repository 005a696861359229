"""Answers of searches for cones, taken wherever a cone is asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from control import StateSpace
from numpy.typing import NDArray

from ..cones import Cone
from ..cones.base import HoldsCone
from ..proof.answer import Answer
from ..proof.certificate import Status
from .certificate import ConeCertificate, Obstruction
from .proven import Proven
from .question import FLAT, Question


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ConeAnswer(Answer, HoldsCone):
    """The answer of a search for a cone, taken wherever a cone is asked for.

    Attributes
    ----------
    cone : Cone or None
    """

    cone: Cone | None = None

    def __cone__(self) -> Cone | str:
        return self.cone if self and self.cone is not None else self.explain()

    @property
    def explanation(self) -> str:
        """`message`, by its earlier name."""
        return self.message

    def __repr__(self) -> str:
        if self.cone is None:
            return super().__repr__()
        return f"<{type(self).__name__} {self.status.name}, {self.cone!r}>"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FoundCone(ConeAnswer):
    """A cone with the proof that it is invariant, a proof that there is none, or neither.

    `bool(found)` is True only if a cone was found, proven, and is not numerically flat.  A `FoundCone` is taken
    wherever a cone is asked for; one without a cone is refused there with its reason.

    Attributes
    ----------
    certificate : ConeCertificate
        The proof, which recomputes itself with `check()`.
    cone : Cone or None
        Proper and invariant; None unless the certificate is PROVED.
    fewest_rays : int
        Lower bound on the number of generators (`few="facets"`: of facets) of any invariant cone, from
        eigenvalues in floating point: computed, not proven.
    conditioning : float
        Condition number of the generators scaled to length 1, states in balanced units.
    system : StateSpace or None
        For a transfer function: its realization by `control.ss`, whose states the cone is in.
    """

    certificate: ConeCertificate  # type: ignore[reportGeneralTypeIssues]  (never without one)
    fewest_rays: int = 1
    conditioning: float = np.inf
    system: StateSpace | None = None

    @classmethod
    def of(cls, question: Question, proven: Proven, fewest_rays: int) -> FoundCone:
        """The answer for a cone that is proven; UNDECIDED if it is numerically flat.

        Parameters
        ----------
        question : Question
        proven : Proven
        fewest_rays : int
        """
        conditioning = proven.candidate.conditioning
        flat = not conditioning <= FLAT
        message = (
            "This is numerically flat, hence no success: rescale the states, or separate the dominant eigenvalue more."
        )
        return cls(
            status=Status.UNDECIDED if flat else Status.PROVED,
            certificate=proven.certificate,
            message=message if flat else "",
            cone=proven.cone(),
            fewest_rays=fewest_rays,
            conditioning=conditioning,
        )

    @property
    def is_flat(self) -> bool:
        """True if the cone is so thin that nothing should be built on it."""
        return self.certificate.status is Status.PROVED and not self.conditioning <= FLAT

    @property
    def obstruction(self) -> Obstruction | None:
        """For REFUTED: why no such cone exists."""
        return self.certificate.witness

    @property
    def rays(self) -> NDArray[np.float64] | None:
        """Generators of the cone, one a row; None if there is no cone."""
        return None if self.cone is None else self.cone.rays

    @property
    def n_rays(self) -> int:
        """Number of rays of the cone (of facets, if few facets were asked for); 0 if there is no cone."""
        if self.cone is None:
            return 0
        return self.cone.n_facets if self.certificate.by_facets else self.cone.n_rays

    @property
    def v(self) -> NDArray[np.float64] | None:
        """Common Lyapunov vector on the cone, if one was found."""
        return self.certificate.v

    def explain(self) -> str:
        """A few sentences a person can act on.

        Returns
        -------
        str
        """
        parts = [self.certificate.explain()]
        if self.certificate.status is Status.PROVED:
            kind = "facets" if self.certificate.by_facets else "rays"
            parts.append(
                f"Computed, not proven: every such cone has at least {self.fewest_rays} {kind}; conditioning "
                f"{self.conditioning:.3g}."
            )
        if self and self.certificate.matrices.shape[0] > 1:
            stable = "" if self.v is None else "; v proves stability under arbitrary switching"
            parts.append(f"It is invariant under the whole convex hull of the family{stable}.")
        return " ".join([*parts, self.message]).strip()

    def facts(self) -> list[tuple[str, str]]:
        """Names and values for the card that a notebook shows.

        Returns
        -------
        list of (str, str)
        """
        if self.cone is None:
            return []
        return [
            ("cone", repr(self.cone)),
            ("fewest rays of any such cone, computed", str(self.fewest_rays)),
            ("conditioning, computed", f"{self.conditioning:.3g}"),
        ]
