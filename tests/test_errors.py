"""An error has a remedy in the library's terms, and one in terms of the command line."""

import pickle

import pytest

from structsel.errors import DataError, SimulationError


def test_the_remedy_is_the_last_line_of_the_error_and_the_command_line_has_its_own():
    error = DataError("'x.csv' exists.", remedy="Pass overwrite=True.", cli_remedy="Pass --overwrite.")
    assert str(error) == "'x.csv' exists.\nPass overwrite=True."
    assert error.cli_message == "'x.csv' exists.\nPass --overwrite."


@pytest.mark.parametrize("error", [DataError("It failed."), DataError("It failed.", remedy="Correct it.")])
def test_without_a_remedy_of_its_own_the_command_line_says_what_the_library_says(error):
    assert error.cli_message == str(error)


def test_both_remedies_and_the_partial_result_survive_another_process():
    error = SimulationError("It stopped.", [1, 2], remedy="See .partial.", cli_remedy="Give --out.")
    for one in (error, pickle.loads(pickle.dumps(error))):
        assert (str(one), one.cli_message) == ("It stopped.\nSee .partial.", "It stopped.\nGive --out.")
        assert one.partial == [1, 2]
