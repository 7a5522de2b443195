"""The arithmetic of training that is fastest on the device at hand.

bfloat16 takes half the time of float32 on processors with matrix units for it (AMX) and on GPUs, and more than ten
times as long on others, which emulate it. What a processor says of itself does not settle it, so both are tried.
"""

import functools
import logging
import time

import torch

DTYPES = ("auto", "bfloat16", "float32")
"""What ``training_precision`` knows."""

ROWS, INPUTS, OUTPUTS = 1024, 128, 512
"""Of the products that are timed: those of GCDT's perceptrons."""

CLEARLY = 0.9
"""Share of the time of float32 below which bfloat16 is worth its rounding."""


def training_precision(dtype: str, device: str) -> torch.autocast:
    """Returns the context in which a network trains.

    Args:
        dtype: ``"bfloat16"``, ``"float32"``, or ``"auto"`` for the faster of the two.
        device: Type of the device, such as ``"cpu"``.
    """
    chosen = faster_precision(device) if dtype == "auto" else getattr(torch, dtype)
    return torch.autocast(device, torch.bfloat16, enabled=chosen == torch.bfloat16)


def autocast_dtype(device: str) -> torch.dtype:
    """Returns the type that products on a device are computed in at the moment."""
    return torch.get_autocast_dtype(device) if torch.is_autocast_enabled(device) else torch.float32


@functools.cache
def faster_precision(device: str) -> torch.dtype:
    """Returns the faster type for training on a device, ``torch.bfloat16`` or ``torch.float32``, and logs the choice.

    Both are timed once a process. Single trials are short, on one thread, and the fastest of each type counts, so other
    processes hardly disturb the comparison.

    Args:
        device: Type of the device, such as ``"cpu"``.
    """
    times = step_times(device)
    ratio = times[torch.bfloat16] / times[torch.float32]
    faster = torch.bfloat16 if ratio < CLEARLY else torch.float32
    logging.info(
        f"policy.dtype=auto: training in {str(faster).removeprefix('torch.')}, because bfloat16 takes {ratio:.2g} "
        f"times as long as float32 on this {device}."
    )
    return faster


def step_times(device: str, trials: int = 3) -> dict[torch.dtype, float]:
    """Times a linear layer forward and backward in both precisions.

    Args:
        device: Type of the device.
        trials: Repetitions of each, after one to warm up.

    Returns:
        The fastest time of each, seconds.
    """
    # Zeros, because random weights would use up random numbers of the training.
    weight = torch.zeros(OUTPUTS, INPUTS, device=device, requires_grad=True)
    inputs = torch.zeros(ROWS, INPUTS, device=device, requires_grad=True)
    best = {torch.float32: float("inf"), torch.bfloat16: float("inf")}
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        for trial in range(trials + 1):
            for dtype in best:
                start = time.perf_counter()
                with torch.enable_grad(), torch.autocast(device, torch.bfloat16, enabled=dtype == torch.bfloat16):
                    torch.nn.functional.linear(inputs, weight).sum().backward()
                if device != "cpu":
                    torch.accelerator.synchronize()
                if trial:
                    best[dtype] = min(best[dtype], time.perf_counter() - start)
    finally:
        torch.set_num_threads(threads)
    return best
