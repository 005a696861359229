"""Pictures of cones and of the flow inside them; the only importers of matplotlib."""

from .cones import plot_cone
from .design import plot_closed_loop, plot_tradeoff
from .network import plot_network, plot_poles
from .observer import plot_observer
from .phase import phase_portrait
from .responses import plot_responses

__all__ = [
    "phase_portrait",
    "plot_closed_loop",
    "plot_cone",
    "plot_network",
    "plot_observer",
    "plot_poles",
    "plot_responses",
    "plot_tradeoff",
]
