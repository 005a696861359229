"""Feedback design: gains that make a system K-positive, stable and fast, by linear programs."""

from .network.scale_free import scale_free_feedback as scale_free_feedback
from .network.search import network_feedback as network_feedback
from .output import observer_gain as observer_gain
from .output import output_feedback as output_feedback
from .result import DesignResult as DesignResult
from .state import state_feedback as state_feedback
from .tradeoff import Tradeoff as Tradeoff
from .tradeoff import gain_rate_tradeoff as gain_rate_tradeoff
