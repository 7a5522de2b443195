"""Random numbers by key: known values, uniform, independent of batch and order."""

import torch

from lerobot_gcdt.data.draws import combine, uniform


def test_one_key_gives_the_published_first_number_of_splitmix64():
    first = int(combine(torch.tensor(0))) % 2**64
    assert first == 0xE220A8397B1DCDAF  # seed 0


def test_numbers_are_uniform_and_neighbours_independent():
    numbers = uniform(torch.arange(500)[:, None], torch.arange(500))
    counts = torch.histc(numbers, bins=10, min=0, max=1)
    assert ((counts - 25_000).abs() < 5 * 25_000**0.5).all()
    assert numbers.min() >= 0 and numbers.max() < 1
    pairs = torch.stack([numbers[:-1, :-1], numbers[1:, :-1], numbers[:-1, 1:]]).flatten(1)
    assert (torch.corrcoef(pairs) - torch.eye(3)).abs().max() < 0.01


def test_a_number_follows_from_its_keys_alone():
    together = uniform(torch.arange(10), 7)
    assert torch.equal(uniform(torch.tensor([4]), 7), together[4:5])
    assert len({*together.tolist(), *uniform(torch.arange(10), 8).tolist()}) == 20


def test_keys_are_ordered():
    assert combine(torch.tensor(1), 2) != combine(torch.tensor(2), 1)
