"""What a search for a cone returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone
from ..proof.certificate import Status
from .certificate import ConeCertificate, Obstruction

# A cone with a larger condition number is numerically flat: proven, but of no use.
FLAT = 1e12


@dataclass(frozen=True, eq=False)
class FoundCone:
    """A cone with the proof that it is invariant, a proof that there is none, or neither.

    `bool(found)` is True only if a cone was found, proven, and is not numerically flat.

    Attributes
    ----------
    certificate : ConeCertificate
        The proof, which recomputes itself with `check()`.
    cone : Cone or None
        Proper and invariant; None unless the certificate is PROVED.
    fewest_rays : int
        Lower bound on the number of generators (`few="facets"`: of facets) of any invariant cone,
        from the spectrum.
    conditioning : float
        Condition number of the generators scaled to length 1, states in balanced units.
    explanation : str
        What a person should know besides: why nothing was found, what limits the cone.
    """

    certificate: ConeCertificate
    cone: Cone | None
    fewest_rays: int
    conditioning: float
    explanation: str = ""

    @property
    def status(self) -> Status:
        """PROVED, REFUTED (no such cone exists) or UNDECIDED (none found, or a numerically flat one)."""
        status = self.certificate.status
        return Status.UNDECIDED if status is Status.PROVED and self.is_flat else status

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
        """Number of generators proven about (of facets, if few facets were asked for)."""
        return 0 if self.certificate.rays is None else self.certificate.rays.shape[0]

    @property
    def margin(self) -> float:
        """Scale-free margin of the proof."""
        return self.certificate.margin

    @property
    def v(self) -> NDArray[np.float64] | None:
        """Common Lyapunov vector on the cone, if one was found."""
        return self.certificate.v

    def explain(self) -> str:
        """A few sentences a person can act on."""
        text = self.certificate.explain()
        if self.certificate.status is Status.PROVED:
            kind = "facets" if self.certificate.by_facets else "rays"
            text += (
                f" {self.n_rays} {kind}, where any such cone needs at least {self.fewest_rays};"
                f" conditioning {self.conditioning:.3g}."
            )
            if self.is_flat:
                text += (
                    " This is numerically flat, hence no success: rescale the states, or separate the dominant "
                    "eigenvalue more."
                )
        return f"{text} {self.explanation}".strip()

    def __bool__(self) -> bool:
        return self.status is Status.PROVED

    def __repr__(self) -> str:
        inside = f", {self.cone!r}" if self.cone is not None else ""
        return f"<FoundCone {self.status.name}{inside}>"
