"""Inclusions M S in T of cones, read on the facets of T and the generators of S."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms

# What is required of each matrix of a system, h being a facet of the cone it maps into.
NAMES = {"A": "h'A x >= 0", "B": "h'B u >= 0", "C": "h'C x >= 0", "D": "h'D u >= 0"}


def invariance_condition(A: Matrix, X: Cone, *, discrete: bool) -> Condition:
    """h'A x_i >= 0: for all pairs in discrete time, for pairs with h'x_i = 0 in continuous time."""
    forms = BilinearForms(X.exact_facets, A, X.exact_rays)
    where = None
    if not discrete:
        where = _incident_entries(forms, X) if forms.is_sparse else X.incidence
    return Condition(NAMES["A"], forms, ">=", where)


def inclusion_condition(name: str, target: Cone, M: Matrix, source: Cone) -> Condition:
    """M source in target, on facets of the target and generators of the source."""
    return Condition(name, BilinearForms(target.exact_facets, M, source.exact_rays), ">=")


def _incident_entries(forms: BilinearForms, X: Cone) -> NDArray[np.bool_]:
    """Entries of a sparse pattern where h'x_i = 0."""
    slack = BilinearForms(X.exact_facets, None, X.exact_rays).signs()
    slack.data = (slack.data != 0).astype(np.int8)
    slack.eliminate_zeros()
    shape = forms.pattern.shape
    keys = np.repeat(np.arange(shape[0]), np.diff(forms.pattern.indptr)) * shape[1] + forms.pattern.indices
    slack_keys = np.repeat(np.arange(shape[0]), np.diff(slack.indptr)) * shape[1] + slack.indices
    return ~np.isin(keys, slack_keys)
