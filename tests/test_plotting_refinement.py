import matplotlib.pyplot as plt
import numpy as np
import pytest

from structsel.plotting.refinement import plot_comparison
from structsel.refinement import compare_estimates


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


def test_each_parameter_has_its_axes_with_a_bar_for_each_method_that_knows_it():
    table = compare_estimates(
        {"equation error": {"mw": (-0.05, 0.001), "mq": (-1.6, 0.1)}, "output error": {"mw": (-0.048, 0.0005)}},
        truth={"mw": -0.0479},
    )
    first, second = plot_comparison(table)
    assert first.get_title() == "mw"
    assert len(first.containers) == 2
    assert len(second.containers) == 1
    # Half of a 95 % interval is 1.96 standard deviations.
    low, high = first.containers[0].lines[1][0].get_ydata(), first.containers[0].lines[1][1].get_ydata()
    np.testing.assert_allclose([low[0], high[0]], [-0.05 - 0.00196, -0.05 + 0.00196], rtol=1e-4)
    assert any(np.allclose(line.get_ydata(), -0.0479) for line in first.get_lines())
