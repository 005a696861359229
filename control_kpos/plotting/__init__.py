"""Pictures of cones and of the flow inside them; the only importers of matplotlib."""

from .cones import plot_cone as plot_cone
from .design import plot_closed_loop as plot_closed_loop
from .design import plot_tradeoff as plot_tradeoff
from .network import plot_network as plot_network
from .network import plot_poles as plot_poles
from .phase import phase_portrait as phase_portrait
