"""What passes between the process that reads files and the one that asked."""

import io
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from structsel.readers.isolated_worker import receive, send


def passed_on(value):
    stream = io.BytesIO()
    send(stream, value)
    stream.seek(0)
    return receive(stream)


def test_values_of_every_kind_arrive_as_they_were_sent():
    table = np.zeros(3, dtype=[("t", "<f8"), ("raw", "<i2", (4,)), ("name", "S4")])
    table["raw"][1] = 1, 2, 3, 4
    value = {
        "plain": [None, True, 3, 2**70, 0.1, float("inf"), "text \N{GREEK SMALL LETTER ALPHA}", b"\x00\xff", 1 + 2j],
        2: ("a tuple", (1, [2, 3])),
        "arrays": SimpleNamespace(x=np.arange(6.0).reshape(2, 3)[:, ::2], table=table, empty=np.empty((0, 3))),
        "times": np.array(["2024-01-01T00:00:00"], dtype="datetime64[s]"),
        "scalar": np.float32(1.5),
    }
    found = passed_on(value)
    assert found["plain"] == value["plain"]
    assert found[2] == value[2]
    for name, array in vars(value["arrays"]).items():
        assert_array_equal(getattr(found["arrays"], name), array)
        assert getattr(found["arrays"], name).dtype == array.dtype
    assert_array_equal(found["times"], value["times"])
    assert isinstance(found["scalar"], np.float32)


def test_objects_arrive_without_their_values():
    found = passed_on(np.array([print, None], dtype=object))
    assert found.dtype == object
    assert found.tolist() == [None, None]


def test_a_stream_that_ends_early_is_noticed():
    stream = io.BytesIO()
    send(stream, np.arange(10))
    with pytest.raises(EOFError):
        receive(io.BytesIO(stream.getvalue()[:-1]))
