"""Options of a command that are generated from the fields of a dataclass."""

import importlib
import inspect
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

import pytest
import typer
from typer.testing import CliRunner

from structsel.cli import app
from structsel.cli.dataclass_options import takes_dataclass
from structsel.options import option


@dataclass(frozen=True)
class Options:
    F_in: float | Literal["auto"] = option(4.0, help="Partial F.", group="Search")
    free: Iterable[str] | Literal["all"] = option("all", help="Parameters.")
    outputs: Iterable[str] | None = option(None, help="Outputs.")
    delay: bool | Iterable[str] = option(False, help="Delayed inputs.")
    band: tuple[float, float] | None = option(None, help="Band.")
    weights: Mapping[str, float] | None = option(None, help="Weights.")
    bounds: Mapping[str, tuple[float, float]] | None = option(None, help="Bounds.")
    cost: Literal["ml", "weighted"] = option("ml", help="Cost.")
    workers: int | None = option(None, help="Threads.")
    exact: bool = option(False, help="Exact.")
    callback: object = option(None)  # no help text: from Python only


@dataclass(frozen=True)
class Shape:
    size: Annotated[float, typer.Option("--size", help="Size.")] = 1.0


@pytest.fixture
def run():
    seen, program = {}, typer.Typer()

    @program.command()
    @takes_dataclass(Options, without=("exact",), renamed={"loss": "cost"})
    def fit(name: Annotated[str, typer.Argument()], *, options: dict) -> None:
        seen.update(options, name=name)

    def call(*words, code=0):
        seen.clear()
        result = CliRunner().invoke(program, ["one", *words])
        assert result.exit_code == code, result.output
        return seen if code == 0 else result.output

    return call


def test_what_is_not_given_has_the_default_of_the_field(run):
    assert run() == {
        "name": "one", "F_in": 4.0, "free": "all", "outputs": None, "delay": [], "band": None, "weights": None,
        "bounds": {}, "cost": "ml", "workers": None,
    }  # fmt: skip


def test_each_type_is_read_from_its_text(run):
    words = "--f-in auto --free Cm:alpha,Cm:de --outputs q,az --delay all --band 0.1,2 --weights q=0.1,az=2"
    seen = run(*words.split(), "--bounds", "Cm:alpha=-3,0", "--bounds", "Cm:de=-2,0", "--workers", "3")
    assert (seen["F_in"], seen["free"], seen["outputs"]) == ("auto", ["Cm:alpha", "Cm:de"], ["q", "az"])
    assert (seen["delay"], seen["band"], seen["weights"]) == (True, (0.1, 2.0), {"q": 0.1, "az": 2.0})
    assert seen["bounds"] == {"Cm:alpha": (-3.0, 0.0), "Cm:de": (-2.0, 0.0)}
    assert seen["workers"] == 3


@pytest.mark.parametrize(
    ("words", "message"),
    [(["--f-in", "much"], "neither a number nor one of auto"), (["--band", "1"], "is not LOW,HIGH"),
     (["--weights", "q"], "is not NAME=NUMBER"), (["--cost", "none"], "'none' is not one of")],
)  # fmt: skip
def test_a_value_that_cannot_be_read_is_refused_with_its_form(run, words, message):
    assert message in " ".join(run(*words, code=2).replace("│", " ").split())


def test_an_old_name_works_for_one_release_and_is_not_shown(run, capsys):
    assert run("--loss", "weighted")["cost"] == "weighted"
    help_page = CliRunner().invoke(app, ["select", "--help"], env={"COLUMNS": "200"}).stdout
    assert "--max-ar-order" in help_page
    assert "--max-order" not in help_page


def test_a_parameter_that_is_a_dataclass_is_replaced_by_its_options():
    seen, program = {}, typer.Typer()

    @program.command()
    @takes_dataclass()
    def fit(shape: Shape, name: Annotated[str, typer.Argument()]) -> None:
        seen.update(shape=shape, name=name)

    assert CliRunner().invoke(program, ["one", "--size", "2"]).exit_code == 0
    assert seen == {"shape": Shape(2.0), "name": "one"}
    assert CliRunner().invoke(program, ["one"]).exit_code == 0
    assert seen["shape"] == Shape()


@pytest.mark.parametrize("command", ["inputs", "simulate", "validate", "refine", "select"])
def test_a_command_declares_twelve_parameters_or_fewer(command):
    module = importlib.import_module(f"structsel.cli.{command}")
    assert len(inspect.signature(inspect.unwrap(module.run), follow_wrapped=False).parameters) <= 12
