"""Systems that several files of tests start from."""

import pytest
from mass_spring import NAMES, RAYS, A, B, C, D

from control_kpos import ConeStateSpace


@pytest.fixture
def node():
    return ConeStateSpace(A, B, C, D, X=RAYS, **NAMES)


@pytest.fixture
def orthant_node():
    return ConeStateSpace([[-2, 1], [1, -3]], [[1], [0]], [[1, 0]], [[0.5]])
