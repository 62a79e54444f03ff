"""What holds for every recording, map and pool, whichever is drawn."""

import json
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from structsel import Candidates, read_recording, select, write_recording
from structsel.nomenclature import find_channel
from structsel.readers.channel_map import load_channel_map
from structsel.readers.units import convert
from structsel.recording import Recording

SPECIAL = (math.nan, 0.0, -0.0, 1e300, -1e-300, 1.0 / 3.0, 123456789.123456789)


def samples(rng, count):
    """Numbers of any size, some of them special."""
    made = rng.standard_normal(count) * 10.0 ** rng.uniform(-6.0, 6.0)
    made[rng.random(count) < 0.2] = rng.choice(SPECIAL)
    return made


NAMES = ("alpha", "q", "de", "V", "tank level", "émoi", "x_2", "load [3]", "a,b", 'in "quotes"', "<script>", "1e5")
UNITS = {"alpha": ("deg", "rad"), "q": ("deg/s", "rad/s"), "V": ("kt", "ft/s", "km/h", "m/s"), "h": ("ft", "km", "m"),
         "qbar": ("psf", "hPa", "Pa"), "az": ("g", "ft/s^2", "m/s^2"), "mass": ("lb", "slug", "kg")}  # fmt: skip


# --- recordings ------------------------------------------------------------------------------------


@st.composite
def recordings(draw):
    count = draw(st.integers(3, 30))
    names = draw(st.lists(st.sampled_from(NAMES), min_size=1, max_size=5, unique=True))
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    channels = {name: samples(rng, count) for name in names}
    t = draw(st.sampled_from([0.0, -7.5, 1.6e9])) + draw(st.sampled_from([0.02, 0.125])) * np.arange(count)
    return Recording("r", t, channels, provenance=tuple(draw(st.lists(st.text(max_size=20), max_size=2))))


@given(recordings(), st.sampled_from(["csv", "parquet"]))
@settings(max_examples=25, deadline=None)
def test_any_recording_written_is_read_again_as_it_was(tmp_path_factory, one, suffix):
    path = tmp_path_factory.mktemp("there") / f"r.{suffix}"
    again = read_recording(write_recording(one, path))
    assert set(again.names) == set(one.names)
    assert_allclose(again.t, one.t, rtol=4e-16)
    for name in one.names:
        assert_allclose(again[name], one[name], rtol=4e-16)
    assert again.provenance[: len(one.provenance)] == one.provenance


@given(recordings(), st.data())
@settings(max_examples=20, deadline=None)
def test_a_segment_holds_the_samples_within_it_and_no_other(one, data):
    first = data.draw(st.integers(0, len(one) - 2))
    last = data.draw(st.integers(first + 1, len(one) - 1))
    part = one.between(float(one.t[first]), float(one.t[last]))
    assert_allclose(part.t, one.t[first : last + 1], rtol=0.0)
    for name in one.names:
        assert_allclose(part[name], one[name][first : last + 1], rtol=0.0)


# --- maps ------------------------------------------------------------------------------------------


@st.composite
def mapped(draw):
    """Channels in SI, and how a file's columns hold them."""
    names = draw(st.lists(st.sampled_from(sorted(UNITS)), min_size=1, max_size=4, unique=True))
    lines = {
        name: {
            "column": f"col {i}",
            "unit": draw(st.sampled_from(UNITS[name])),
            "sign": draw(st.sampled_from([1, -1])),
            "scale": draw(st.sampled_from([1.0, 0.01, 4.0])),
            "offset": draw(st.sampled_from([0.0, 2.5])),
        }
        for i, name in enumerate(names)
    }
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    values = {name: rng.uniform(-50.0, 50.0, 4) for name in names}
    return values, lines


@given(mapped())
@settings(max_examples=25, deadline=None)
def test_what_a_map_undoes_comes_back_in_si(tmp_path_factory, drawn):
    values, lines = drawn
    folder = tmp_path_factory.mktemp("mapped")
    columns = {"t": np.arange(4) * 0.1}
    for name, held in lines.items():
        theirs = convert(values[name], find_channel(name).unit, held["unit"]) / held["sign"]
        columns[held["column"]] = (theirs - held["offset"]) / held["scale"]
    rows = zip(*(column.tolist() for column in columns.values()))
    (folder / "f.csv").write_text("\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]))
    read = read_recording(folder / "f.csv", {"channels": {"t": "t", **lines}})
    for name, wanted in values.items():
        assert_allclose(read[name], wanted, rtol=1e-12, atol=1e-9)


@given(mapped(), st.booleans())
@settings(max_examples=20, deadline=None)
def test_a_map_written_as_toml_is_the_map(tmp_path_factory, drawn, keep):
    _, lines = drawn
    options = {"others": "keep" if keep else "leave", "time_offset": 0.25}
    text = [f"{json.dumps(name)} = {_inline(held)}" for name, held in lines.items()]
    path = tmp_path_factory.mktemp("map") / "map.toml"
    path.write_text("\n".join(["[channels]", *text, "[file]", *(f"{k} = {json.dumps(v)}" for k, v in options.items())]))
    read, meant = load_channel_map(path), load_channel_map({"channels": lines, "file": options})
    assert (read.channels, read.file) == (meant.channels, meant.file)


def _inline(held):
    return "{ " + ", ".join(f"{key} = {json.dumps(value)}" for key, value in held.items()) + " }"


# --- pools and selections --------------------------------------------------------------------------

SIGNALS = ("alpha", "q_hat", "de", "beta")
ASKED = {"bootstrap": 0, "F_in": 10.0}


def flights(seed, count=2, n=300):
    made = []
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        t = 0.04 * np.arange(n)
        channels = {name: np.cumsum(rng.standard_normal(n)) * 0.02 for name in SIGNALS}
        noise = 0.02 * rng.standard_normal(n)
        Cm = 0.1 - 0.6 * channels["alpha"] - 1.9 * channels["de"] + 0.8 * channels["alpha"] * channels["beta"] + noise
        made.append(Recording(f"m{k + 1:02d}", t, {**channels, "Cm": Cm}))
    return made


def values_of(found):
    return dict(zip(("1", *map(str, found.terms)), found.values))


def assert_same(found, expected, factor=None, rtol=1e-8):
    """Terms and values, each expected one times its factor."""
    a, b = values_of(found), values_of(expected)
    assert a.keys() == b.keys()
    for term, value in b.items():
        assert_allclose(a[term], value * (factor(term) if factor else 1.0), rtol=rtol, err_msg=term)


POOL = Candidates.polynomial(SIGNALS, 2)
seeds = st.integers(0, 30)
methods = st.sampled_from([{}, {"noise": "white"}, {"method": "orthogonal"}, {"method": "best_subset", "max_terms": 4}])


@given(seeds, methods, st.permutations(range(len(POOL))))
@settings(max_examples=12, deadline=None)
def test_the_order_of_candidates_does_not_matter(seed, method, order):
    terms = [str(t) for t in POOL]
    manoeuvres = flights(seed)
    other = select(manoeuvres, "Cm", Candidates.parse([terms[i] for i in order]), **{**ASKED, **method})
    assert_same(other, select(manoeuvres, "Cm", POOL, **{**ASKED, **method}))


@given(seeds, methods)
@settings(max_examples=10, deadline=None)
def test_the_order_of_manoeuvres_does_not_matter(seed, method):
    manoeuvres = flights(seed, 3)
    assert_same(
        select(manoeuvres[::-1], "Cm", POOL, **{**ASKED, **method}),
        select(manoeuvres, "Cm", POOL, **{**ASKED, **method}),
    )


@given(seeds, methods, st.sampled_from([1e-3, 0.3, 57.3, 1e4]), st.sampled_from(SIGNALS))
@settings(max_examples=12, deadline=None)
def test_a_signal_in_another_unit_scales_its_coefficients_and_nothing_else(seed, method, scale, name):
    manoeuvres = flights(seed)
    scaled = [r.with_channels(**{name: scale * r[name]}) for r in manoeuvres]

    def factor(term):
        powers = dict(part.split("^") if "^" in part else (part, "1") for part in term.split("*"))
        return scale ** -float(powers.get(name, 0))

    expected = select(manoeuvres, "Cm", POOL, **{**ASKED, **method})
    assert_same(select(scaled, "Cm", POOL, **{**ASKED, **method}), expected, factor, rtol=1e-7)


@given(seeds, methods, st.sampled_from([1e-4, -2.0, 1e3]))
@settings(max_examples=10, deadline=None)
def test_a_response_in_another_unit_scales_every_coefficient(seed, method, scale):
    manoeuvres = flights(seed)
    scaled = [r.with_channels(Cm=scale * r["Cm"]) for r in manoeuvres]
    expected = select(manoeuvres, "Cm", POOL, **{**ASKED, **method})
    assert_same(select(scaled, "Cm", POOL, **{**ASKED, **method}), expected, lambda term: scale, rtol=1e-7)


@given(seeds)
@settings(max_examples=8, deadline=None)
def test_white_residuals_know_no_order_of_samples_within_a_manoeuvre(seed):
    manoeuvres = flights(seed)
    order = np.random.default_rng(seed).permutation(len(manoeuvres[0]))
    mixed = [Recording(r.name, r.t, {name: r[name][order] for name in r.names}) for r in manoeuvres]
    method = {**ASKED, "noise": "white", "constants": "shared"}  # levels of blocks do have an order
    assert_same(select(mixed, "Cm", POOL, **method), select(manoeuvres, "Cm", POOL, **method))


@given(st.lists(st.sampled_from(["alpha", "alpha^2", "alpha*de", "(alpha - 0.1)+", "sin(de)"]), min_size=1, max_size=5))
@settings(max_examples=30, deadline=None)
def test_pools_add_as_sets_do(terms):
    one, other = Candidates.parse(terms), Candidates.parse(terms[::-1])
    assert {str(t) for t in one + other} == {str(t) for t in other + one} == {str(t) for t in one}
    assert len(one + one) == len(one) == len(set(terms))
