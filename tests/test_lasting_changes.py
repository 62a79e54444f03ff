"""Changes and instrument errors that last over the recordings of one flight."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.comparison.preparing import prepare
from structsel.comparison.tolerances import biases_of, tolerances_of
from structsel.diagnosis.signatures import work_out
from structsel.effects.lasting_changes import lasting_changes
from structsel.recording import Recording
from tests.effect_fits import best, effect_named
from tests.noisy_flights import AIRCRAFT, T, flights_with, fly

CUTS = (0, 150, 330, len(T))


def parts_of(flight):
    """A flight cut into three, which know that they are one."""
    parts = [flight.between(a, b, f"{flight.name}{k}") for k, (a, b) in enumerate(pairwise(CUTS))]
    return [replace(p, sequence=parts[0].name) for p in parts]


@pytest.fixture(scope="module")
def flown():
    return flights_with({}, speeds=(42.0, 50.0), h=(1000.0, 1100.0))


def test_a_change_is_found_across_the_recordings_with_the_time_at_which_it_is_undone(flown):
    there = (T >= 4.0) & (T < 16.0)
    whole = replace(flown[0], measured={**flown[0].measured, "Cm": flown[0].measured["Cm"] - 0.01 * there})
    (stays, undone) = lasting_changes(parts_of(whole), ("Cm",))
    assert stays.until is None
    assert (undone.flight, undone.later, undone.until[0]) == ("m010", ("m011", "m012"), "m012")
    assert_allclose([undone.start, undone.until[1]], [4.0, 16.0], atol=0.6)
    assert undone.times == {"m010": undone.start, "m012, back": undone.until[1]}
    course = np.concatenate([undone.along(p) for p in parts_of(whole)])
    assert np.mean(course == there) > 0.95
    assert np.all(undone.along(flown[1]) == 0.0)


def test_a_passenger_who_walks_forward_and_back_is_found_however_the_flight_was_cut(flown):
    there = np.clip((T - 4.0) / 5.0, 0.0, 1.0) - np.clip((T - 13.0) / 5.0, 0.0, 1.0)
    moment = 0.05 / AIRCRAFT.cbar * there * flown[0].measured["CZ"]
    whole = replace(flown[0], measured={**flown[0].measured, "Cm": flown[0].measured["Cm"] + moment})
    variant, theta, fraction = best(parts_of(whole), effect_named("cg-shift"), ["Cm"])
    assert fraction > 0.95
    assert_allclose([variant.shape["time in m010"], variant.shape["time in m011, back"]], [4.0, 13.0], atol=0.6)
    assert abs(theta["x"]) == pytest.approx(0.05, rel=0.1)


def test_recordings_of_one_flight_share_the_constant_errors_of_their_instruments():
    cut, simulated = [], {}
    for r, stated in zip(*fly({})):
        for k, part in enumerate((slice(0, 250), slice(250, None))):
            cut.append(Recording(f"{r.name}{k}", r.t[part], {c: r[c][part] for c in r.names if c != "t"}))
            simulated[cut[-1].name] = Recording(cut[-1].name, r.t[part], {c: x[part] for c, x in stated.items()})
    flights = prepare(simulated, cut, AIRCRAFT).flights
    assert [f.sequence for f in flights] == ["m010", "m010", "m020", "m020"]
    shared = [n for n in tolerances_of(flights) if n.constant]
    acts = [[bool(columns) for columns in n.columns] for n in shared]
    assert {tuple(a) for a in acts} == {(True, True, False, False), (False, False, True, True)}
    for (name, sd, _), (same, of_whole, _) in zip(biases_of(flights[0]), biases_of(replace(flights[0], sequence=""))):
        assert name == same
        assert sd == pytest.approx(of_whole if name.startswith("when ") else 0.1 * of_whole)


def test_an_effect_acts_in_the_flights_in_which_it_is_more_than_a_tail_of_what_it_does_in_another():
    flights = flights_with({}, speeds=(42.0, 46.0, 50.0), h=(1000.0,) * 3)
    faster = replace(flights[1], channels={**flights[1].channels, "alpha": flights[1]["alpha"] + 0.15})
    library = work_out([effect_named("stall-hysteresis")], [flights[0], faster, flights[2]], flights[0].responses)
    assert frozenset({faster.name}) in {s.flights for s in library.signatures}
