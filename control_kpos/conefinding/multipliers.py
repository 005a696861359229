"""Multipliers P with A R = R P: see `control_kpos.generators.multipliers`."""

from ..generators.multipliers import Frame as Frame
from ..generators.multipliers import multipliers as multipliers
from ..generators.multipliers import nonnegative_combination as nonnegative_combination
from ..generators.multipliers import pointing_functional as pointing_functional
