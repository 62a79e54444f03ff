"""Numbers and lists as text, the one table model, and what every result can do."""

import copy
import doctest
import pickle
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pandas as pd
import pytest

from structsel import formatting
from structsel.formatting import (
    count_of,
    finite_or_none,
    format_estimate,
    format_explained,
    format_in_unit,
    format_number,
    format_range,
    join_names,
)
from structsel.results import Result
from structsel.tables import Bar, Cell, Column, Summary, Table, table_of_frame, text_column


def test_examples_of_the_docstrings_hold():
    assert doctest.testmod(formatting).failed == 0


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [(110.0, 2, "110"), (-100.0, 1, "-100"), (12345.6, 4, "12346"), (1.6e5, 3, "1.6e5"), (0.0, 4, "0"),
     (float("nan"), 4, "-"), (None, 4, "-"), (5.84e-6, 3, "5.8e-6"), (99.7, 2, "100"), (-9996.0, 3, "-9996"),
     (1.6e12, 3, "1.6e12")],
)  # fmt: skip
def test_numbers_have_no_exponent_between_a_ten_thousandth_and_a_hundred_thousand(value, digits, text):
    assert format_number(value, digits) == text


def test_lists_units_and_fractions_read_as_in_a_sentence():
    assert join_names("abc") == "a, b and c"
    assert join_names("abc", last="or") == "a, b or c"
    assert join_names("abcdefgh", 4) == "a, b, c and 5 more"
    assert join_names([]) == ""
    assert (count_of(1, "recording"), count_of(2, "recording")) == ("1 recording", "2 recordings")
    assert format_in_unit(0.1, "rad/s") == "5.73 deg/s"
    assert format_explained(0.99999) == "99.99 %"
    assert finite_or_none({"a": [np.inf, 1.0], "b": ("x", None)}) == {"a": [None, 1.0], "b": ["x", None]}


TABLE = Table(
    (text_column("term"), Column("value", "5g"), Column("R2", "3f"), Column("fraction", "%"), Column("V", unit="m/s")),
    (("1", 0.123456789, 0.5, 0.25, 45.0), ("alpha^2", -12.0, float("nan"), None, Cell(100.0, "bad"))),
    rules=(1,),
)


def test_a_table_as_text_aligns_words_left_and_numbers_right():
    assert TABLE.to_text().splitlines() == [
        "term       value     R2  fraction  V [m/s]",
        "1        0.12346  0.500      25 %       45",
        "",
        "alpha^2      -12      -         -      100",
    ]


def test_a_summary_leads_with_its_title_and_ends_with_its_warnings():
    summary = Summary(
        "Cm", "2 terms", ("BIASED",), (("n", "12"), ("R2", "0.9")), (TABLE,), ("A note.",), ("Doubt it.",)
    )
    lines = summary.to_text().splitlines()
    assert lines[:3] == ["Cm: 2 terms", "  ! BIASED", "  n 12   R2 0.9"]
    assert lines[-2:] == ["A note.", "  ! Doubt it."]
    both = Summary("Two", parts=(summary, summary))
    assert both.to_text().count("Cm: 2 terms") == 2
    assert both.all_tables() == (TABLE, TABLE)


def test_a_frame_becomes_a_table_with_numbers_to_the_right():
    table = table_of_frame(pd.DataFrame({"name": ["a"], "n": [3], "value": [0.5], "good": [True]}))
    assert [column.align for column in table.columns] == ["left", "right", "right", "left"]
    assert table.texts() == [["a", "3", "0.5", "yes"]]


def test_estimates_and_ranges_have_no_exponent_in_a_sentence():
    assert format_estimate(12345.0, float("nan"), "N") == "12345 N"
    assert format_estimate(3.25e-6, 1e-7) == "3.25e-6 +- 1e-7"
    assert format_range("h", (999.6, 12345.0)) == "h 1000 to 12345 m"
    assert format_range("h", (-np.inf, 12345.0)) == "h below 12345 m"


def test_columns_are_added_and_removed_and_a_bar_is_text_outside_of_pages():
    cells = [Bar(10.0, 40.0, "0.1 to 0.4"), None]
    table = TABLE.with_column(1, Column("interval"), cells)
    for _ in range(3):
        table = table.without_column(3)
    assert [column.name for column in table.columns] == ["term", "interval", "value"]
    assert table.texts() == [["1", "0.1 to 0.4", "0.12346"], ["alpha^2", "-", "-12"]]
    assert table.rules == TABLE.rules
    note = Table((Column("a", note="first"),), ((1.0,),), note="All of it.")
    assert note.legend == "a: first. All of it."
    two = Table((Column("a", note="first"), Column("b", note="second")), ((1.0, 2.0),), note="All of it.")
    assert two.without_column(1).legend == note.legend


@dataclass(frozen=True, eq=False, repr=False)
class Estimates(Result):
    values: np.ndarray
    noise: dict

    def __post_init__(self):
        self.freeze()

    def summary(self):
        return Summary("Estimates", "of " + "a long list, " * 40, tables=(TABLE,))


@pytest.fixture
def result():
    return Estimates(np.arange(3.0), {"a": {"b": np.ones(2)}})


def test_a_result_is_one_line_at_the_prompt_and_a_report_in_print(result):
    assert repr(result).startswith("<Estimates Estimates: of a long list")
    assert len(repr(result)) < 200
    assert str(result) == result.summary().to_text()
    assert list(result.to_frame().columns) == ["term", "value", "R2", "fraction", "V"]


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_a_copied_or_pickled_result_keeps_its_content_and_stays_read_only(result, duplicate):
    made = duplicate(result)
    assert isinstance(made.noise, MappingProxyType)
    assert isinstance(made.noise["a"], MappingProxyType)
    np.testing.assert_array_equal(made.values, result.values)
    with pytest.raises(ValueError, match="read-only"):
        made.values[0] = 1.0
    with pytest.raises(TypeError):
        made.noise["c"] = 1.0
