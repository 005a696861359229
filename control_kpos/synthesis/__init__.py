"""Feedback design: gains that make a system K-positive, stable and fast, by linear programs."""

from .output import observer_gain as observer_gain
from .output import output_feedback as output_feedback
from .result import DesignResult as DesignResult
from .state import state_feedback as state_feedback
