"""Measures training and inference: ``python -m lerobot_gcdt.benchmark.speed [--root datasets/needle_pick]``.

Look at the ratios: they are taken within one run, while milliseconds depend on the machine and on what else it does.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import torch
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_gcdt.keys import ACHIEVED_GOAL, GOAL, REQUIRED_KEYS, STATE
from lerobot_gcdt.policy.configuration_gcdt import GCDTConfig
from lerobot_gcdt.policy.modeling_gcdt import GCDTPolicy
from lerobot_gcdt.policy.tokens import ORDER
from lerobot_gcdt.policy.transformer import attention_mask
from lerobot_gcdt.precision import autocast_dtype, faster_precision, training_precision
from lerobot_gcdt.recording import record
from lerobot_gcdt.training.windows import RowsInMemory

BATCH, WINDOW = 8, 50
"""Episodes of a training step; steps of context in the comparison with LeRobot's loader."""


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, help="folder of a dataset; by default ten episodes are recorded")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--context_length", type=int, default=GCDTConfig.context_length)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = options.root or record("NeedlePick", 10, 0, Path(folder) / "needle_pick")
        for line in measure(root, options.device, options.context_length):
            print(line)


def measure(root: Path, device: str, context_length: int, rounds: int = 10) -> list[str]:
    """Measures the default model on a dataset.

    Args:
        root: Folder of the dataset.
        device: Where to compute.
        context_length: Steps that the policy looks back on.
        rounds: Repetitions; the fastest counts.

    Returns:
        A line a figure.
    """
    kind = torch.device(device).type
    meta = LeRobotDatasetMetadata(f"local/{root.name}", root=root)
    config = GCDTConfig(context_length=context_length, device=device, push_to_hub=False)
    policy = GCDTPolicy(config, dataset_meta=meta).train()
    policy.to(device)
    optimizer = torch.optim.AdamW(policy.get_optim_params(), lr=1e-4)
    index = torch.randint(len(policy.bank), (BATCH,), generator=torch.Generator().manual_seed(0))
    sequences = policy.bank.sequences(policy.bank.draw_pieces(index.to(device), context_length, step=0))
    kinds = 1 if config.one_token else len(ORDER) if context_length > 1 else len(ORDER) - 1
    r, s = sequences.segment.shape
    mask = attention_mask(sequences.segment, kinds, context_length, causal=True)

    def step(loss: Callable[[], torch.Tensor], dtype: str = "auto") -> Callable[[], None]:
        def run() -> None:
            config.dtype = dtype
            loss().backward()
            optimizer.step()
            optimizer.zero_grad(set_to_none=False)

        return run

    def bare() -> torch.Tensor:
        tokens = torch.randn(r, s * kinds, config.width, device=device)
        with training_precision(config.dtype, kind):
            return policy.transformer(tokens, mask.to(autocast_dtype(kind))).square().mean()

    def whole() -> torch.Tensor:
        return policy.forward({"index": index})[0]

    windows, from_memory = _windows(root, meta, device), _windows(root, meta, device, in_memory=True)
    times = _alternate(
        {
            "step": step(whole),
            "bare": step(bare),
            "data": lambda: policy._draw(index.to(device), context_length),
            "windows": step(lambda: policy.forward(next(windows))[0]),
            "from files": lambda: next(windows),
            "from memory": lambda: next(from_memory),
        },
        device,
        rounds,
    )
    # Where bfloat16 is emulated, a step takes seconds.
    both = {dtype: step(whole, dtype) for dtype in ("float32", "bfloat16")}
    precisions = _alternate(both, device, min(rounds, 3))
    chosen = str(faster_precision(kind)).removeprefix("torch.")
    first, last = _inference(policy.eval(), device, min(rounds, 5))
    real = sequences.real.float().mean().item()
    return [
        f"training step of {BATCH} episodes ({int(sequences.real.sum())} steps): {1e3 * times['step']:.0f} ms",
        f"training step in bfloat16 / in float32: {precisions['bfloat16'] / precisions['float32']:.2f} "
        f"({1e3 * precisions['bfloat16']:.0f} ms / {1e3 * precisions['float32']:.0f} ms); "
        f"policy.dtype=auto chooses {chosen}",
        f"training step / transformer alone on the same tokens: {times['step'] / times['bare']:.2f}",
        f"data and relabelling / training step: {times['data'] / times['step']:.4f}",
        f"real tokens / computed tokens: {real:.2f}",
        f"training step with LeRobot's windows of {WINDOW} steps / with the bank: "
        f"{times['windows'] / times['step']:.1f}",
        f"LeRobot's windows / the same from memory: {times['from files'] / times['from memory']:.1f}",
        f"select_action at step 100: {1e3 * last:.1f} ms; over step 1: {last / first:.2f}",
    ]


def _windows(root: Path, meta: LeRobotDatasetMetadata, device: str, in_memory: bool = False) -> Iterator[dict]:
    """Batches from LeRobot's own loader, of as many steps as the bank's."""
    offsets = [i / meta.fps for i in range(1 - WINDOW, 1)]
    keys = (*REQUIRED_KEYS, "frame_index")
    dataset = LeRobotDataset(
        meta.repo_id, root=root, delta_timestamps=dict.fromkeys(keys, offsets), video_backend="pyav"
    )
    if in_memory:
        dataset.reader.hf_dataset = RowsInMemory(dataset.hf_dataset)
    while True:
        for batch in torch.utils.data.DataLoader(dataset, batch_size=BATCH, shuffle=True, drop_last=True):
            yield {key: value.to(device) if isinstance(value, torch.Tensor) else value for key, value in batch.items()}


def _alternate(actions: dict[str, Callable], device: str, rounds: int) -> dict[str, float]:
    """Fastest time of each action, seconds; they take turns, so that a busy machine slows them all."""
    best = dict.fromkeys(actions, float("inf"))
    for _ in range(rounds):
        for name, action in actions.items():
            best[name] = min(best[name], _once(action, device))
    return best


def _once(action: Callable, device: str = "cpu") -> float:
    start = time.perf_counter()
    action()
    if device != "cpu":
        torch.accelerator.synchronize()
    return time.perf_counter() - start


def _inference(policy: GCDTPolicy, device: str, rounds: int) -> tuple[float, float]:
    """Fastest times of ``select_action`` at steps 1 and 100 of one episode, seconds, on one core."""
    sentence, (state, goal, _) = next(iter(policy.config.task_dims.items()))
    batch: dict[str, Any] = {
        STATE: torch.zeros(1, state, device=device),
        GOAL: torch.zeros(1, goal, device=device),
        ACHIEVED_GOAL: torch.zeros(1, goal, device=device),
        "task": [sentence],
    }
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    times = []
    for _ in range(rounds):
        policy.reset()
        times.append([_once(lambda: policy.select_action(batch), device) for _ in range(100)])
    torch.set_num_threads(threads)
    # The very first step of an episode has no action to remember yet.
    return min(row[1] for row in times), min(row[-1] for row in times)


if __name__ == "__main__":
    main()
