"""Polyhedral cones: geometry that knows no system."""

from .base import Cone
from .lorentz import lorentz
from .orthant import Orthant, orthant
from .polyhedral import PolyhedralCone, as_cone
from .product import ProductCone, product

__all__ = ["Cone", "Orthant", "PolyhedralCone", "ProductCone", "as_cone", "lorentz", "orthant", "product"]
