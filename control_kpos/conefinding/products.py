"""Sums of matrix products: see `control_kpos.generators.products`."""

from ..generators.products import as_doubles as as_doubles
from ..generators.products import exact_product as exact_product
from ..generators.products import summed_products as summed_products
