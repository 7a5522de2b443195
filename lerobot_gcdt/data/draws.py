"""Random numbers that follow from what they are drawn for.

The same keys give the same number in any process, batch and order, on any device. So a training that was resumed, or
spread over several processes, draws what one that ran through alone would have drawn.
"""

import torch
from torch import Tensor

# The constants of the mixing function of SplitMix64 (Steele, Lea, Flood 2014), as signed integers.
_INCREMENT, _FACTORS = -0x61C8864680B583EB, (-0x40A7B892E31B1A47, -0x6B2FB644ECCEEE15)
_SHIFTS = (30, 27, 31)


def combine(*keys: Tensor | int) -> Tensor:
    """Combines integers into one well-mixed integer.

    Args:
        *keys: Integers, or int64 tensors whose shapes broadcast; one tensor at least.

    Returns:
        An int64 tensor of the broadcast shape.
    """
    first, *others = map(torch.as_tensor, keys)
    mixed = _mix(first)
    for key in others:
        mixed = _mix(mixed + key)
    return mixed


def uniform(*keys: Tensor | int) -> Tensor:
    """Draws a number in [0, 1) for each combination of keys, float32; see ``combine``."""
    return _shift(combine(*keys), 40).float() * 2.0**-24


def _mix(x: Tensor) -> Tensor:
    x = x + _INCREMENT
    x = (x ^ _shift(x, _SHIFTS[0])) * _FACTORS[0]
    x = (x ^ _shift(x, _SHIFTS[1])) * _FACTORS[1]
    return x ^ _shift(x, _SHIFTS[2])


def _shift(x: Tensor, bits: int) -> Tensor:
    """Shifts to the right and fills with zeros."""
    return (x >> bits) & ((1 << (64 - bits)) - 1)
