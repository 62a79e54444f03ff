"""Names come from files: none is a command to LaTeX, a formula to a spreadsheet or an escape code to a terminal."""

import csv
import io
import json
import re

import matplotlib.mathtext
import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from structsel import AeroModel, ResponseModel, export_model
from structsel.cli.messages import json_text, say
from structsel.cli.tables import print_files, print_summary
from structsel.formatting import csv_text, printable
from structsel.nomenclature import latex_of
from structsel.tables import Column, Summary, Table, csv_of_frame, text_column

HOSTILE = "\\input{/etc/passwd}$^~%#&_\x1b[2J\n"


def model(name=HOSTILE, response=HOSTILE):
    part = ResponseModel(("1", "alpha"), [0.1, -0.5], np.diag([0.01, 0.04]), method=HOSTILE)
    return AeroModel({response: part}, name, (HOSTILE,), refinement=f"worse {HOSTILE}")


def active_latex(text):
    """Commands that LaTeX would execute, comments left out."""
    lines = [re.sub(r"(?<!\\)%.*", "", line) for line in text.splitlines()]
    return set(re.findall(r"\\[a-zA-Z]+", "\n".join(lines)))


def test_a_name_is_no_command_in_latex(tmp_path):
    text = export_model(model(), tmp_path / "model.tex", to="latex").read_text()
    known = {"begin", "end", "toprule", "midrule", "bottomrule", "multicolumn", "mathrm", "alpha", "times", "backslash",
             "wedge", "sim"}  # fmt: skip
    assert active_latex(text) <= {f"\\{name}" for name in known}
    assert "\\backslash input\\{/etc/passwd\\}" in text
    assert text.isascii()
    assert all(line.isprintable() for line in text.splitlines())
    balanced = re.sub(r"\\[{}]", "", "\n".join(line for line in text.splitlines() if not line.startswith("%")))
    assert balanced.count("{") == balanced.count("}")


def test_an_escaped_name_is_set_as_it_is_written():
    for name in (HOSTILE, "my_response", "50%", "a&b", "{x}", "c^2", "#1"):
        drawn = matplotlib.mathtext.MathTextParser("path").parse(f"${latex_of(name)}$")
        assert drawn.width > 0.0
    assert latex_of("my_response") == r"\mathrm{my\_response}"
    assert latex_of("alpha") == r"\alpha"


@pytest.mark.parametrize("name", ["=cmd|' /C calc'!A0", "+1+1", "-2+3", "@SUM(A1)", "\t=1", "\n=1"])
def test_a_name_is_no_formula_in_a_spreadsheet(name, tmp_path):
    path = export_model(model("m", name), tmp_path / "terms.csv", to="csv")
    table = path.read_text()[path.read_text().index("response,term") :]
    rows = list(csv.reader(io.StringIO(table, newline="")))
    assert rows[1][0] == f"'{name}"
    frame = pd.DataFrame({name: ["a", name], "value": [-1.5, 2.0], "held": [True, False]})
    read = list(csv.reader(io.StringIO(csv_of_frame(frame), newline="")))
    assert read == [[f"'{name}", "value", "held"], ["a", "-1.5", "True"], [f"'{name}", "2.0", "False"]]


def test_an_escape_code_is_no_part_of_a_csv_file(tmp_path):
    text = export_model(model("m", "\x1b[2J\r=1"), tmp_path / "terms.csv", to="csv").read_text()
    assert r"\x1b[2J\r=1,1,0.1" in text
    assert "\x1b" not in text


@pytest.mark.parametrize("text", ["Cm:alpha", "-1.5", "+2e-3", "-inf", "(-alpha*beta)", "", "a=b"])
def test_other_text_of_a_csv_file_is_not_changed(text):
    assert csv_text(text) == text


def test_escape_codes_are_shown_and_not_sent_to_the_terminal(capsys):
    code = "m01\x1b[31m\x07\x9b2J\u202e\r"
    shown = r"m01\x1b[31m\x07\x9b2J\u202e\r"
    assert printable(code) == shown
    assert printable("two\nlines\tof text with a \N{NO-BREAK SPACE}") == "two\nlines\tof text with a \N{NO-BREAK SPACE}"
    table = Table((text_column(code), Column("value")), ((f"{code}\n  ! forged", 1.0),), code, note=code)
    summary = Summary(code, code, (code,), ((code, code),), (table,), (code,), (code,))
    stream = io.StringIO()
    console = Console(file=stream, width=200, force_terminal=False)
    print_summary(console, summary)
    print_files(console, code, [code])
    say("error", code)
    for text in (summary.to_text(), stream.getvalue(), capsys.readouterr().err, str(model())):
        assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e]", text)
        assert "\n  ! forged" not in text
    assert stream.getvalue().count(shown) >= 10
    assert r"\x1b[2J" in str(model())


def test_json_on_a_terminal_holds_no_escape_code_and_reads_back():
    content = {"name": "m01\x1b[31m\x9b2J\x7f, \N{GREEK SMALL LETTER ALPHA}"}
    text = json_text(content)
    assert not re.search("[\x00-\x09\x0b-\x1f\x7f-\x9f]", text)
    assert json.loads(text) == content
