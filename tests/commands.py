"""Commands run in this process, their printed text compared, and the code blocks of a page."""

import re
import shlex

from numpy.testing import assert_allclose
from typer.testing import CliRunner

from structsel.cli.program import app

PLAIN = {"COLUMNS": "80", "NO_COLOR": "1", "TERM": "dumb"}
_NUMBER = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?%?")  # at the end of a sentence with its full stop


def run(*arguments, code=0, env=PLAIN):
    """Result of a command; a traceback would be an exception other than SystemExit. With `code=None` any exit code."""
    result = CliRunner().invoke(app, [str(a) for a in arguments], env=env)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert "Traceback" not in result.output
    assert code is None or result.exit_code == code, result.output
    return result


def assert_same_text(found, expected, between=r"\s─"):
    """Words exactly, numbers to 3 %; line breaks, rules and other characters of `between` do not matter."""
    found, expected = (re.findall(f"[^{between}]+", text) for text in (found, expected))
    for a, b in zip(found, expected):
        if _NUMBER.fullmatch(a) and _NUMBER.fullmatch(b):
            assert_allclose(float(a.rstrip("%.")), float(b.rstrip("%.")), rtol=0.03, atol=2e-5)
        else:
            assert a == b
    assert len(found) == len(expected)


def code_blocks(page, language):
    """Contents of the code blocks of a Markdown page in one language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)


def commands_of(page):
    """Arguments of the structsel commands in the sh blocks of a page, comments left out."""
    lines = "\n".join(code_blocks(page, "sh")).replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("structsel")]
