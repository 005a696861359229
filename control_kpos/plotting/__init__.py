"""Pictures of cones and of the flow inside them; the only importers of matplotlib."""

from .cones import plot_cone as plot_cone
from .phase import phase_portrait as phase_portrait
