"""A command that has moved says where."""

from typer.testing import CliRunner

from structsel.cli import app


def test_prove_states_its_new_command_whatever_follows():
    done = CliRunner().invoke(app, ["prove", "--cases", "3", "--out", "x"])
    assert done.exit_code == 2
    assert "python -m proof" in " ".join(done.stderr.split())
    assert "prove" not in CliRunner().invoke(app, ["--help"]).stdout
