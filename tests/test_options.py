import inspect
from dataclasses import dataclass
from typing import Literal

import pytest

from structsel.errors import ModelError
from structsel.inputs import DesignOptions, InputOptions, compare_inputs, design_inputs
from structsel.options import choices_of, option, takes_options
from structsel.refinement import RefineOptions, refine


@dataclass(frozen=True)
class Options:
    """Of `verb`."""

    size: float = option(1.0, help="Size, in m.", group="Shape", metavar="SIZE")
    shape: Literal["round", "square"] = option("round", help="Shape.")
    seed: int = option(0)


@takes_options(Options)
def verb(thing, *, weight=1.0, options):
    """Do something."""
    return thing, weight, options


def test_options_are_given_as_keywords_or_together_and_keywords_win():
    assert verb("a") == ("a", 1.0, Options())
    assert verb("a", size=2.0, weight=3.0) == ("a", 3.0, Options(size=2.0))
    assert verb("a", options=Options(size=4.0, seed=1), size=2.0) == ("a", 1.0, Options(size=2.0, seed=1))


def test_a_misspelt_option_is_refused_with_the_nearest_name():
    with pytest.raises(TypeError, match=r"verb\(\) got an unexpected keyword argument 'sise'. Did you mean 'size'"):
        verb("a", sise=2.0)


def test_a_value_that_is_not_among_the_choices_is_refused_with_the_choices():
    with pytest.raises(ModelError, match=r"verb was given shape='sqare'; it is 'round' or 'square'. Did you mean 's"):
        verb("a", shape="sqare")
    assert choices_of(Literal["a", "b"] | None) == ("a", "b")
    assert choices_of(Literal["a"] | float) == ()


@pytest.mark.parametrize(
    ("function", "options"), [(refine, RefineOptions), (design_inputs, DesignOptions), (compare_inputs, InputOptions)]
)
def test_the_signature_shows_every_option(function, options):
    shown = inspect.signature(function).parameters
    fields = inspect.signature(options).parameters
    assert set(fields) <= set(shown)
    assert all(shown[name].default == fields[name].default for name in fields)
    assert all(name in (options.__doc__ or "") or name in (InputOptions.__doc__ or "") for name in fields)
