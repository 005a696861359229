"""Feedback design: gains that make a system K-positive, stable and fast, by linear programs."""

from .network.scale_free import scale_free_feedback
from .network.search import network_feedback
from .output import observer_gain, output_feedback
from .result import DesignResult
from .state import state_feedback
from .tradeoff import Tradeoff, gain_rate_tradeoff

__all__ = [
    "DesignResult",
    "Tradeoff",
    "gain_rate_tradeoff",
    "network_feedback",
    "observer_gain",
    "output_feedback",
    "scale_free_feedback",
    "state_feedback",
]
