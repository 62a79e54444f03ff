"""Aerodynamic coefficients of the measured motion, sample by sample.

``compute_coefficients`` computes the six body-axis coefficients, lift and drag, and the dimensionless channels of
candidate terms from measured or reconstructed states. What a recording lacks is left out, or taken as zero where only
a small term needs it. A finding states either.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from structsel.aircraft import Aircraft
from structsel.coefficients.computation import WHO, CoefficientComputation
from structsel.recording import Recording
from structsel.recording.arguments import as_one_recording, as_recordings, require_kind

if TYPE_CHECKING:
    import pandas as pd


def compute_coefficients(
    recording: Recording | pd.DataFrame,
    aircraft: Aircraft,
    *,
    V0: float | None = None,
    method: str = "central",
    order: int = 4,
) -> Recording:
    """Add the aerodynamic coefficients, and the candidate channels, to a recording.

    Needs ``V``, ``alpha``, ``ax``, ``az``, and ``qbar`` or ``rho`` or ``h``. With ``ay`` come CY, with ``q``
    Cm, with ``p``, ``q`` and ``r`` Cl and Cn. ``mass`` overrides the aircraft's. ``p_dot``, ``q_dot``,
    ``r_dot``, ``alpha_dot`` and ``beta_dot`` are used where recorded, else differentiated.

    Parameters
    ----------
    recording : Recording or DataFrame
        A DataFrame has a column ``t`` and is in SI units and radians, or states its units in ``attrs["units"]``; see
        `Recording.from_frame`.
    aircraft : Aircraft
        Places of ``accelerometer`` and ``vane`` (alpha, beta, V) carry the readings to the centre of
        gravity; the thrust line takes the thrust out of forces and moments.
    V0 : float, optional [m/s]
        Reference of ``V_ratio``; the aircraft's if not given, else this recording's mean V. Several
        recordings need a common one: see `compute_all`.
    method, order
        Of the differentiation, as `structsel.numerics.differentiation.differentiate` takes them.

    Returns
    -------
    Recording
        With CX, CY, CZ, Cl, Cm, Cn, CL, CD, CT, qbar, mach, p_hat, q_hat, r_hat, alpha_dot, beta_dot,
        alpha_dot_hat, beta_dot_hat, V_ratio, as far as its channels allow. V, alpha and beta are those at
        the centre of gravity; ax, ay, az stay as read. Findings of kind "left-out" and "assumed" list
        what could not be computed and what was taken as zero; the provenance has the sources of the rest.

    Raises
    ------
    ChannelError
        When a channel that nothing can be done without is missing.
    ArgumentError
        The recording or the aircraft is an object of another type.
    DataError
        When a channel used is not finite, or is to be differentiated across a gap.
    DomainError
        Where V or qbar is not above zero.
    AircraftError
        When neither recording nor aircraft gives a mass.

    References
    ----------
    [H17] for the coefficients, [M86] for vanes and rotor, [KM16] ch. 3.
    """
    recording = as_one_recording(recording, f"{WHO}(recording, aircraft)", "compute_all(recordings, aircraft)")
    require_kind(aircraft, Aircraft, f"{WHO}(recording, aircraft)")
    return CoefficientComputation(recording, aircraft, method, order).run(V0)


def compute_all(
    recordings: Iterable[Recording | pd.DataFrame],
    aircraft: Aircraft,
    *,
    V0: float | None = None,
    method: str = "central",
    order: int = 4,
) -> list[Recording]:
    """Coefficients of several manoeuvres with one reference airspeed; see `compute_coefficients`.

    Parameters
    ----------
    recordings : iterable of Recording or DataFrame
    aircraft, method, order
        As for `compute_coefficients`.
    V0 : float, optional
        Reference airspeed [m/s]. Where neither it nor the aircraft's is given, it is the mean V of the first
        recording, and a finding in each states it.

    Returns
    -------
    list of Recording
        In the same order.

    Raises
    ------
    ChannelError, DomainError, AircraftError
        As `compute_coefficients`.
    """
    made: list[Recording] = []
    require_kind(aircraft, Aircraft, "compute_all(recordings, aircraft)")
    shared = aircraft.V0 if V0 is None else V0
    source = ""
    for recording in as_recordings(recordings, "compute_all(recordings, aircraft)"):
        one = CoefficientComputation(recording, aircraft, method, order)
        if shared is None:
            shared = one.mean_airspeed()
            source = f"the mean V of '{recording.name}'"
        made.append(one.run(shared, source))
    return made
