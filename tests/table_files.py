"""A small table of channels, and text files of it."""

from __future__ import annotations

import numpy as np

T = np.arange(8) * 0.25
ALPHA = 0.1 + 0.01 * np.sin(T)
V = 100.0 + T
TABLE = np.column_stack([T, ALPHA, V])
MAP = {"channels": {"t": 1, "alpha": 2, "V": 3}}


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def lines(separator=",", columns=TABLE):
    return "\n".join(separator.join(repr(float(x)) for x in row) for row in columns) + "\n"
