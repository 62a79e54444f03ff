"""fit_transfer_function(): transfer functions and low-order equivalent systems fitted to frequency responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.errors import DataError, ModelError
from structsel.formatting import finite_or_none, format_number, join_names
from structsel.frequency_domain.forms import TransferForm, read_form
from structsel.frequency_domain.frequency_response import USABLE, FrequencyResponse
from structsel.nomenclature import suggest
from structsel.numerics.frequency_response import error_correlation
from structsel.numerics.transfer_functions import (
    FactoredModel,
    ModelFactor,
    ResponseData,
    fit_factored,
)
from structsel.recording.arguments import require_kind
from structsel.results import NamedEstimates, Result
from structsel.tables import Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd

ACCEPTABLE, GOOD = 100.0, 50.0
"""Costs J below which a fit is usually acceptable, and nearly perfect [TR12], [H79]."""
_DELAY, _GAIN = "tau", "K"
_AGREEING = 3  # starts that should end at the least cost; chosen, not critical


@dataclass(frozen=True, eq=False, repr=False)
class TransferFunction(NamedEstimates, Result):
    """Transfer functions fitted to frequency responses.

    Attributes
    ----------
    pairs : tuple of (output, input)
    forms : tuple of str
        In shorthand: (a) is s + a, [zeta, omega] is s^2 + 2 zeta omega s + omega^2.
    names : tuple of str
        Parameters; K is the gain and tau the delay, with the pair where there are several pairs.
    values : (k,) array
    std : (k,) array
        Standard errors from the random errors of the frequency response; zero for parameters that were held.
    covariance : (k, k) array
    held : tuple of str
    costs : tuple of float
        J of each pair.
    bands : tuple of (low, high) [rad/s]
    omega : tuple of (n,) array [rad/s]
        Frequencies of the fit, for each pair.
    models : tuple of FactoredModel
    doubts : tuple of str
        Warnings.
    """

    pairs: tuple[tuple[str, str], ...]
    forms: tuple[str, ...]
    names: tuple[str, ...]
    values: np.ndarray
    std: np.ndarray
    covariance: np.ndarray
    held: tuple[str, ...]
    costs: tuple[float, ...]
    bands: tuple[tuple[float, float], ...]
    omega: tuple[np.ndarray, ...]
    models: tuple[FactoredModel, ...]
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.freeze()

    def evaluate(self, omega: np.ndarray, pair: tuple[str, str] | None = None) -> np.ndarray:
        """(f,) complex response [SI units] at frequencies [rad/s]; of the first pair if none is given."""
        return self.models[self._place(pair)].evaluate(omega, self.values)

    def poles(self, pair: tuple[str, str] | None = None) -> np.ndarray:
        """Poles [1/s], without those of the delay."""
        return self._roots(pair, -1)

    def zeros(self, pair: tuple[str, str] | None = None) -> np.ndarray:
        """Zeros [1/s]."""
        return self._roots(pair, 1)

    def _place(self, pair: tuple[str, str] | None) -> int:
        if pair is None:
            return 0
        if tuple(pair) not in self.pairs:
            raise ModelError(f"no transfer function of {pair}; there are {', '.join(map(_name_of, self.pairs))}.")
        return self.pairs.index(tuple(pair))  # type: ignore[arg-type]

    def _roots(self, pair: tuple[str, str] | None, power: int) -> np.ndarray:
        factors = [f for f in self.models[self._place(pair)].factors if f.power == power]
        return np.concatenate([np.zeros(0, dtype=complex), *(f.roots(self.values) for f in factors)])

    def to_frame(self) -> pd.DataFrame:
        """One row for each parameter: name, value, std, held."""
        return super().to_frame().assign(held=[name in self.held for name in self.names])

    def to_dict(self) -> dict[str, Any]:
        """Everything, for JSON."""
        responses = [
            {
                "output": output, "input": given, "form": form, "cost": cost, "band": list(band),
                "poles": [[float(r.real), float(r.imag)] for r in self.poles((output, given))],
                "zeros": [[float(r.real), float(r.imag)] for r in self.zeros((output, given))],
            }
            for (output, given), form, cost, band in zip(self.pairs, self.forms, self.costs, self.bands)
        ]  # fmt: skip
        content = {
            "schema": "structsel.transfer_function/1",
            "responses": responses,
            "parameters": self.to_frame().to_dict("records"),
            "covariance": self.covariance.tolist(),
            "doubts": list(self.doubts),
        }
        found: dict[str, Any] = finite_or_none(content)
        return found

    def summary(self) -> Summary:
        """Parameters with standard errors, cost, poles and zeros."""
        rows = [
            (name, float(value), "held" if name in self.held else float(std))
            for name, value, std in zip(self.names, self.values, self.std)
        ]
        parameters = Table((text_column("parameter"), Column("value", "5g"), Column("std error", "2g")), tuple(rows))
        fits = [
            (_name_of(pair), f"K {form} exp(-tau s)", cost, *band, len(omega))
            for pair, form, cost, band, omega in zip(self.pairs, self.forms, self.costs, self.bands, self.omega)
        ]
        heads = (text_column("response"), text_column("form"), Column("cost J", "3g"), Column("from", "3g", "rad/s"))
        roots = [
            (_name_of(pair), kind, _root_text(root))
            for pair in self.pairs
            for kind, all_roots in (("pole", self.poles(pair)), ("zero", self.zeros(pair)))
            for root in all_roots
            if root.imag >= 0.0
        ]
        return Summary(
            "Transfer function",
            join_names(map(_name_of, self.pairs)),
            tables=(
                Table((*heads, Column("to", "3g", "rad/s"), Column("points")), tuple(fits), "Fit"),
                Table(parameters.columns, parameters.rows, "Parameters, SI units and radians"),
                Table(
                    (text_column("response"), text_column("root"), text_column("value [1/s]")), tuple(roots), "Roots"
                ),
            ),
            notes=(
                f"J below {ACCEPTABLE:g} is usually acceptable, below {GOOD:g} nearly perfect. The standard errors "
                "follow from the random errors of the frequency response; they leave out what the form cannot follow.",
            ),
            warnings=self.doubts,
        )


def _name_of(pair: tuple[str, str]) -> str:
    return "/".join(pair)


def _root_text(root: complex) -> str:
    if root.imag == 0.0:
        return format_number(root.real)
    size = abs(root)
    detail = f"zeta {format_number(-root.real / size, 3)}, omega {format_number(size, 3)} rad/s"
    return f"{format_number(root.real)} +- {format_number(root.imag)}i ({detail})"


def fit_transfer_function(
    response: FrequencyResponse,
    forms: str | tuple[int, int] | Mapping[str, str | tuple[int, int]],
    *,
    band: tuple[float, float] | None = None,
    points: int = 20,
    delay: bool = True,
    held: Mapping[str, float] | None = None,
) -> TransferFunction:
    """Fit transfer functions to frequency responses: magnitude and phase, weighted with the coherence.

    Several responses are fitted at once. A parameter that occurs in the forms of several is common to them; each has
    its own gain and delay.

    Parameters
    ----------
    response : FrequencyResponse
    forms : str, (zeros, poles) or mapping of str to these
        Form of each response, such as ``{"q/de": "short-period"}``; without a mapping, of the first response. A form
        is a name of `structsel.frequency_domain.FORMS`, numbers of zeros and poles, or factors in shorthand,
        ``"(1/Ttheta2) / [zeta, omega]"``.
    band : (low, high), optional [rad/s]
        By default the longest band in which the partial coherence is 0.6 or more.
    points : int
        Frequencies of the fit, evenly spaced in the logarithm.
    delay : bool
        Whether each response has an equivalent time delay.
    held : mapping of str to float, optional
        Values of parameters that are not estimated.

    Returns
    -------
    TransferFunction

    Raises
    ------
    ArgumentError
        The response is an object of another type.
    ModelError
        A form that cannot be read, or a parameter that does not exist.
    ChannelError
        A response that does not exist.
    DataError
        No usable band, or fewer equations than parameters.

    References
    ----------
    [TR12], [H79].
    """
    require_kind(response, FrequencyResponse, "fit_transfer_function(response, forms)")
    if not isinstance(forms, Mapping):
        forms = {_name_of(response.pairs[0]): forms}
    pairs = [_pair_of(name, response) for name in forms]
    read = [read_form(form) for form in forms.values()]
    several = len(pairs) > 1
    gains = [f"{_GAIN} {_name_of(p)}" if several else _GAIN for p in pairs]
    delays = [f"{_DELAY} {_name_of(p)}" if several else _DELAY for p in pairs] if delay else []
    factors = list(dict.fromkeys(name for form in read for factor in form.factors for name in factor.names))
    names = (*gains, *factors, *delays)
    for name in held or {}:
        if name not in names:
            raise ModelError(f"held names '{name}', which is no parameter.{suggest(name, names)} "
                             f"There are {', '.join(names)}.")  # fmt: skip
    models = [_model(form, names, j, delays) for j, form in enumerate(read)]
    bands, data = zip(*(_data(response, pair, band, points) for pair in pairs))
    damping = {f.names[0] for form in read for f in form.factors if f.kind == "second"}
    fit = fit_factored(
        models,
        data,
        np.array([(held or {}).get(name, np.nan) for name in names]),
        positive=np.array([name in factors and name not in damping for name in names]),
        delays=np.array([name in delays for name in names]),
    )
    values = _with_positive_frequencies(fit.theta, read, names)
    std = np.sqrt(np.diag(fit.covariance))
    return TransferFunction(
        tuple(pairs), tuple(form.text for form in read), names, values, std, fit.covariance, tuple(held or {}),
        tuple(fit.costs.tolist()), tuple(bands), tuple(one.omega for one in data), tuple(models),
        tuple(_doubts(pairs, fit.costs, fit.agreeing, names, values, std, delays)),
    )  # fmt: skip


def _pair_of(name: str, response: FrequencyResponse) -> tuple[str, str]:
    pair = next((pair for pair in response.pairs if _name_of(pair) == name), None)
    if pair is None:
        response.places(*([*name.split("/", 1), ""][:2]))
    assert pair is not None
    return pair


def _model(form: TransferForm, names: Sequence[str], place: int, delays: Sequence[str]) -> FactoredModel:
    factors = tuple(
        ModelFactor(factor.kind, tuple(names.index(name) for name in factor.names), factor.power)
        for factor in form.factors
    )
    return FactoredModel(factors, place, names.index(delays[place]) if delays else None)


def _data(
    response: FrequencyResponse, pair: tuple[str, str], band: tuple[float, float] | None, points: int
) -> tuple[tuple[float, float], ResponseData]:
    """Band, and the frequencies of the response that are nearest to evenly spaced ones."""
    limits = band or response.usable_band(*pair)
    if limits is None:
        raise DataError(
            f"fit_transfer_function finds no frequency at which the coherence of {_name_of(pair)} is {USABLE:g} or "
            "more.\nGive band=(low, high), or record a sweep with more power."
        )
    o, i = response.places(*pair)
    inside = np.flatnonzero(
        (response.omega >= limits[0] * (1.0 - 1e-9)) & (response.omega <= limits[1] * (1.0 + 1e-9))
        & np.isfinite(response.random_error[:, o, i]) & (np.abs(response.response[:, o, i]) > 0.0)
    )  # fmt: skip
    if not inside.size:
        raise DataError(
            f"fit_transfer_function finds no frequency of {_name_of(pair)} in {limits} rad/s with an error."
        )
    log = np.log(response.omega[inside])
    wanted = np.linspace(log[0], log[-1], points)
    rows = inside[np.unique(np.abs(log[:, None] - wanted).argmin(axis=0))]
    omega, error = response.omega[rows], response.random_error[rows, o, i]
    covariance = error[:, None] * error * error_correlation(omega, response.window[rows, o, i])
    data = ResponseData(omega, response.response[rows, o, i], response.coherence[rows, o, i], covariance)
    return (float(omega[0]), float(omega[-1])), data


def _with_positive_frequencies(theta: np.ndarray, forms: Sequence[TransferForm], names: Sequence[str]) -> np.ndarray:
    """[zeta, omega] and [-zeta, -omega] are the same; the frequency is positive."""
    made = theta.copy()
    second = {factor.names for form in forms for factor in form.factors if factor.kind == "second"}
    for zeta, omega in second:
        places = [names.index(zeta), names.index(omega)]
        if made[places[1]] < 0.0:
            made[places] *= -1.0
    return made


def _doubts(
    pairs: Sequence[tuple[str, str]],
    costs: np.ndarray,
    agreeing: int,
    names: Sequence[str],
    values: np.ndarray,
    std: np.ndarray,
    delays: Sequence[str],
) -> list[str]:
    doubts = [
        f"{_name_of(pair)}: J is {cost:.0f}, above {ACCEPTABLE:g}: the form does not follow the response."
        for pair, cost in zip(pairs, costs)
        if cost > ACCEPTABLE
    ]
    if agreeing < _AGREEING:
        doubts.append(f"Only {agreeing} of the random starts end at the least cost; there may be a better fit.")
    for name, value, error in zip(names, values, std):
        if name in delays and value + 2.0 * error < 0.0:
            doubts.append(f"{name} is negative, {format_number(value, 3)} s: the form lacks phase lead.")
        elif error > abs(value):
            doubts.append(f"{name} is not determined: its standard error is larger than its value.")
    return doubts
