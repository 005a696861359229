"""Statements about every plant that agrees with measurements: positivity, stability, gains."""

from .certificate import DataCertificate, ExcludingPlants, LeavingPlant
from .search import DataAnswer, data_feedback, data_positivity

__all__ = ["DataAnswer", "DataCertificate", "ExcludingPlants", "LeavingPlant", "data_feedback", "data_positivity"]
