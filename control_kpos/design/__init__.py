"""Feedback design: gains that make a system K-positive, stable and fast, by linear programs."""

from .bounded.certificate import OrderIntervalCertificate
from .bounded.interval import OrderInterval, order_interval
from .bounded.network_certificate import NetworkIntervalCertificate
from .feedback import observer_gain, output_feedback, state_feedback
from .network.scale_free import scale_free_feedback
from .network.search import network_feedback
from .optimal.answer import OptimalFeedback
from .optimal.certificate import OptimalCostCertificate
from .optimal.finite import FiniteCostCertificate
from .optimal.search import optimal_feedback
from .result import DesignResult
from .tradeoff import Tradeoff, gain_rate_tradeoff

__all__ = [
    "DesignResult",
    "FiniteCostCertificate",
    "NetworkIntervalCertificate",
    "OptimalCostCertificate",
    "OptimalFeedback",
    "OrderInterval",
    "OrderIntervalCertificate",
    "Tradeoff",
    "gain_rate_tradeoff",
    "network_feedback",
    "observer_gain",
    "optimal_feedback",
    "order_interval",
    "output_feedback",
    "scale_free_feedback",
    "state_feedback",
]
