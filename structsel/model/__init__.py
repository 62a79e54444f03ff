"""AeroModel: per response the terms, values, standard errors, covariance and the recorded ranges."""

from structsel.deprecation import renamed_names
from structsel.model.aero_model import AeroModel
from structsel.model.dynamics import Quantity, State
from structsel.model.files import SCHEMA
from structsel.model.ranges import RangeExcursion, recorded_ranges
from structsel.model.response import ResponseModel

__all__ = ["SCHEMA", "AeroModel", "Quantity", "RangeExcursion", "ResponseModel", "State", "recorded_ranges"]

__getattr__ = renamed_names(__name__, {"Excursion": "RangeExcursion", "flown_region": "recorded_ranges"})
