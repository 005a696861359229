"""Observers: bounds on the state of a plant from its measurements, for all time."""

from .certificate import IntervalObserverCertificate
from .network_certificate import NetworkObserverCertificate
from .observer import IntervalObserver, interval_observer

__all__ = ["IntervalObserver", "IntervalObserverCertificate", "NetworkObserverCertificate", "interval_observer"]
