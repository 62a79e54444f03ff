"""AeroModel: per response the terms, values, standard errors, covariance and the region flown."""

from structsel.model.aero_model import AeroModel
from structsel.model.files import SCHEMA
from structsel.model.region import Excursion, flown_region
from structsel.model.response import ResponseModel
from structsel.model.states import Quantity, State

__all__ = ["SCHEMA", "AeroModel", "Excursion", "Quantity", "ResponseModel", "State", "flown_region"]
