"""What a notebook shows of a result: one table with a caption and what to doubt, as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

if TYPE_CHECKING:
    from jinja2 import Template

_MOST_ROWS = 60

# Colours are the notebook's own, so that the table is at home on a dark page too.
_TEMPLATE = """\
<table style="border-collapse: collapse; font-variant-numeric: tabular-nums">
<caption style="caption-side: top; text-align: left; white-space: pre-line; font-weight: bold">{{ caption }}</caption>
{% if columns %}
<thead><tr>
{% for name, numeric in columns %}
<th scope="col" style="text-align: {{ 'right' if numeric else 'left' }}">{{ name }}</th>
{% endfor %}
</tr></thead>
<tbody>
{% for row in rows %}
<tr>
{% for cell, (_, numeric) in zip(row, columns) %}
<td style="text-align: {{ 'right' if numeric else 'left' }}">{{ cell }}</td>
{% endfor %}
</tr>
{% endfor %}
</tbody>
{% endif %}
</table>
{% if more %}
<p>{{ more }} more rows are not shown.</p>
{% endif %}
{% if notes %}
<ul>
{% for note in notes %}
<li>{{ note }}</li>
{% endfor %}
</ul>
{% endif %}
"""


def to_html(
    table: pd.DataFrame | Sequence[Mapping[str, Any]], caption: str, notes: Iterable[str] = (), *, digits: int = 5
) -> str:
    """Table with its caption above and notes below, everything that comes from data escaped.

    Parameters
    ----------
    table : DataFrame or sequence of mappings
        Its rows, of which at most 60 are shown; the index is not.
    caption : str
        What it is: the result's own first line.
    notes : iterable of str, optional
        What to doubt, a line each.
    digits : int, optional
        Significant digits of numbers; what is not known is a dash.

    Returns
    -------
    str
        HTML that belongs inside a page.
    """
    table = pd.DataFrame(table)
    columns = [(str(name), _is_number(table[name])) for name in table.columns]
    rows = [[_cell(value, digits) for value in row] for row in table.head(_MOST_ROWS).itertuples(index=False)]
    more = max(len(table) - _MOST_ROWS, 0)
    return _template().render(caption=caption, columns=columns, rows=rows, more=more, notes=list(notes), zip=zip)


def opening(result: object, lines: int = 1) -> str:
    """First lines of what a result prints: its caption."""
    return "\n".join(line.strip() for line in str(result).splitlines()[:lines])


@cache
def _template() -> Template:
    # Templates take a while to load, and only notebooks need them here.
    from jinja2 import Environment

    return Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(_TEMPLATE)


def _is_number(column: pd.Series) -> bool:
    return bool(pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column))


def _cell(value: Any, digits: int) -> str:
    if value is None or (isinstance(value, float | np.floating) and np.isnan(value)):
        return "\N{EN DASH}"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return f"{value:.{digits}g}"
    return str(value)
