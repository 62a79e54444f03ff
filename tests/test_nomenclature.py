"""The table of channels."""

from __future__ import annotations

import pytest

from structsel.errors import ChannelError
from structsel.nomenclature import (
    close_names,
    find_channel,
    is_known,
    latex_of,
    list_channels,
    suggest,
    unit_of,
)
from structsel.readers.units import convert, is_convertible, is_unit, si_unit

# Name and unit as the house style's table gives them.
STYLE_TABLE = {
    "t": "s",
    "V": "m/s",
    "qbar": "Pa",
    **dict.fromkeys(("alpha", "beta", "phi", "theta", "psi", "de", "da", "dr", "df"), "rad"),
    **dict.fromkeys(("p", "q", "r"), "rad/s"),
    **dict.fromkeys(("p_dot", "q_dot", "r_dot"), "rad/s^2"),
    **dict.fromkeys(("alpha_dot", "beta_dot"), "rad/s"),
    **dict.fromkeys(("ax", "ay", "az"), "m/s^2"),
    **dict.fromkeys(("p_hat", "q_hat", "r_hat", "alpha_dot_hat", "beta_dot_hat"), "-"),
    **dict.fromkeys(("CX", "CY", "CZ", "Cl", "Cm", "Cn", "CL", "CD", "CT"), "-"),
    **dict.fromkeys(("mach", "throttle", "gear", "V_ratio"), "-"),
    **dict.fromkeys(("h", "h_agl", "x", "y"), "m"),
    **dict.fromkeys(("u", "v", "w", "vn", "ve", "vd"), "m/s"),
    "mass": "kg",
    "rho": "kg/m^3",
    "thrust": "N",
    "rpm": "rpm",
}


@pytest.mark.parametrize(("name", "unit"), STYLE_TABLE.items())
def test_every_channel_of_the_style_table_has_its_unit(name, unit):
    assert find_channel(name).unit == unit
    assert unit_of(name) == unit


def test_every_unit_can_be_read_and_is_si_already():
    for row in list_channels():
        assert is_unit(row.unit), row
        if row.unit != "rpm":  # shaft speed keeps the unit everybody uses
            assert convert([2.0], row.unit, si_unit(row.unit))[0] == 2.0, row
        assert is_convertible(row.unit, row.unit), row


def test_ranges_are_intervals_and_hold_a_trimmed_flight():
    cruise = {"V": 120.0, "alpha": 0.1, "theta": 0.1, "az": -9.81, "qbar": 4500.0, "h": 3000.0, "mach": 0.4}
    for row in list_channels():
        assert row.low < row.high, row
        assert row.low <= cruise.get(row.name, 0.0 if row.low <= 0.0 else row.low) <= row.high, row


def test_names_are_unique_and_dt_is_not_one():
    names = [row.name for row in list_channels()]
    assert len(names) == len(set(names))
    assert not is_known("dt")


def test_a_wrong_name_is_answered_with_the_nearest():
    with pytest.raises(ChannelError, match=r"no channel 'alpah'\. Did you mean 'alpha'"):
        find_channel("alpah")
    assert suggest("zzzz", ["alpha"]) == ""


def test_close_names_look_past_case_but_never_answer_the_name_itself():
    assert close_names("cl", ["CL", "Cl", "qbar"]) == ["CL", "Cl"]
    assert close_names("alpha", ["alpha"]) == []
    assert close_names("alpha", ["beta", "alpha_deg", "ALPHA [deg]"]) == ["alpha_deg", "ALPHA [deg]"]


def test_groups_pick_their_channels():
    assert [row.name for row in list_channels("rates")] == ["p", "q", "r"]


def test_unknown_channels_take_the_recordings_own_unit():
    assert unit_of("n1_left", {"n1_left": "-"}) == "-"
    assert unit_of("n1_left") == "?"
    # The table's unit cannot be overruled.
    assert unit_of("alpha", {"alpha": "deg"}) == "rad"


def test_latex_is_the_symbol_and_unknown_names_stand_upright():
    assert latex_of("alpha") == r"\alpha"
    assert latex_of("n1_left") == r"\mathrm{n1\_left}"
