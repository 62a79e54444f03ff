import inspect
import pickle
import sys
from dataclasses import dataclass, fields
from types import ModuleType

import pytest

from structsel.deprecation import renamed_arguments, renamed_attribute, renamed_names, renamed_value


@renamed_arguments(pool="candidates", keep="force")
def chosen(response, *, candidates=(), force=None):
    return response, candidates, force


@renamed_arguments(std="standard_error")
@dataclass(frozen=True)
class Estimate:
    value: float
    standard_error: float = 0.0
    std = renamed_attribute("standard_error")
    interval = renamed_attribute("conf_int")

    def conf_int(self):
        return self.value - 2 * self.standard_error, self.value + 2 * self.standard_error


def test_old_argument_is_passed_under_its_new_name_and_the_warning_names_both():
    with pytest.warns(DeprecationWarning, match=r"argument 'pool' of chosen\(\) is deprecated: use candidates") as seen:
        assert chosen("Cm", pool=["alpha"]) == ("Cm", ["alpha"], None)
    assert seen[0].filename == __file__  # the caller's line, not the library's


def test_new_argument_does_not_warn(recwarn):
    assert chosen("Cm", candidates=["alpha"], force=1) == ("Cm", ["alpha"], 1)
    assert not recwarn


def test_old_and_new_argument_together_are_refused():
    with pytest.raises(TypeError, match=r"chosen\(\) got 'force' twice: 'keep' is its old name"):
        chosen("Cm", force=1, keep=2)


def test_signature_shows_the_new_names_only():
    assert list(inspect.signature(chosen).parameters) == ["response", "candidates", "force"]


def test_class_takes_the_old_argument():
    with pytest.warns(DeprecationWarning, match=r"argument 'std' of Estimate\(\)"):
        assert Estimate(1.0, std=0.5) == Estimate(1.0, 0.5)


def test_old_attribute_and_method_are_found_and_are_no_fields():
    with pytest.warns(DeprecationWarning, match=r"Estimate\.std is deprecated: use standard_error") as seen:
        assert Estimate(1.0, 0.5).std == 0.5
    assert seen[0].filename == __file__
    with pytest.warns(DeprecationWarning, match="conf_int"):
        assert Estimate(1.0, 0.5).interval() == (0.0, 2.0)
    assert [field.name for field in fields(Estimate)] == ["value", "standard_error"]


def test_class_with_old_names_pickles_without_a_warning(recwarn):
    assert pickle.loads(pickle.dumps(Estimate(1.0, 0.5))) == Estimate(1.0, 0.5)
    assert not recwarn


def test_old_module_name_leads_to_the_new_one_here_or_elsewhere(monkeypatch):
    module = ModuleType("somewhere")
    module.builtin = 1
    module.__getattr__ = renamed_names("somewhere", {"ready": "builtin", "root": "math:sqrt"})
    monkeypatch.setitem(sys.modules, "somewhere", module)
    with pytest.warns(DeprecationWarning, match=r"somewhere\.ready is deprecated: use builtin instead"):
        assert module.ready == 1
    with pytest.warns(DeprecationWarning, match=r"somewhere\.root is deprecated: use math\.sqrt") as seen:
        assert module.root(4.0) == 2.0
    assert seen[0].filename == __file__
    with pytest.raises(AttributeError, match="module 'somewhere' has no attribute 'nothing'"):
        _ = module.nothing


def test_old_value_of_an_option_is_translated_and_others_are_not(recwarn):
    assert renamed_value("residuals", "white", {"colour": "coloured"}) == "white"
    assert renamed_value("order", 3, {"colour": "coloured"}) == 3
    assert not recwarn

    def fitted(residuals):
        return renamed_value("residuals", residuals, {"colour": "coloured"})

    with pytest.warns(DeprecationWarning, match="residuals='colour' is deprecated: use residuals='coloured'") as seen:
        assert fitted("colour") == "coloured"
    assert seen[0].lineno == inspect.currentframe().f_lineno - 1
