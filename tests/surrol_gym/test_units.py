import numpy as np
import pytest

from surrol_gym.units import SCALING, to_metres, to_su


def test_one_scaled_unit_is_0_2_metres():
    """docs/simulator.md#scaled-units."""
    assert SCALING == 5
    assert to_metres(1.0) == pytest.approx(0.2)
    assert to_su(0.001) == pytest.approx(0.005)


@pytest.mark.parametrize("shape", [(), (3,), (2, 4, 3)])
def test_arrays_convert_there_and_back(shape):
    lengths = np.random.default_rng(0).normal(size=shape)
    assert np.shape(to_su(lengths)) == shape
    np.testing.assert_allclose(to_metres(to_su(lengths)), lengths, rtol=1e-15)


def test_lists_convert_too():
    np.testing.assert_allclose(to_su([0.5, -0.05, 0.675]), [2.5, -0.25, 3.375])
