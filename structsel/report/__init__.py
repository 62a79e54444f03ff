"""Reports: one self-contained HTML page that needs no network."""

from structsel.report.page import render, write_comparison, write_qualification, write_report

__all__ = ["render", "write_comparison", "write_qualification", "write_report"]
