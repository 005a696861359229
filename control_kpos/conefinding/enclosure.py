"""Nonnegative solutions of R Q = T: see `control_kpos.generators.enclosure`."""

from ..generators.enclosure import Bounds as Bounds
from ..generators.enclosure import Generators as Generators
from ..generators.enclosure import enclosed_product as enclosed_product
