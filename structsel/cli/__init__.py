"""The command line: one command per verb; the only importer of the CLI library."""

from structsel.cli.program import app, main

__all__ = ["app", "main"]
