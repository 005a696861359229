"""Observers: bounds on the state of a plant from its measurements, for all time."""

from .certificate import IntervalObserverCertificate
from .observer import IntervalObserver, interval_observer

__all__ = ["IntervalObserver", "IntervalObserverCertificate", "interval_observer"]
