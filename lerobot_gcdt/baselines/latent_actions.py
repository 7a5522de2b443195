"""The networks of PLAS: a variational autoencoder of actions, a policy in its latent space, and twin critics."""

import itertools

import torch
from torch import Tensor, nn
from torch.func import functional_call


def perceptron(inputs: int, outputs: int, hidden_sizes: tuple[int, ...]) -> nn.Sequential:
    """Returns linear layers with ReLUs between them."""
    sizes = [inputs, *hidden_sizes]
    layers = [(nn.Linear(a, b), nn.ReLU()) for a, b in itertools.pairwise(sizes)]
    return nn.Sequential(*itertools.chain(*layers), nn.Linear(sizes[-1], outputs))


class Encoder(nn.Module):
    """The distribution of latent actions that stand for an action in a state."""

    def __init__(self, inputs: int, actions: int, latents: int, hidden_sizes: tuple[int, ...]):
        super().__init__()
        self.network = perceptron(inputs + actions, 2 * latents, hidden_sizes)

    def forward(self, seen: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """Returns mean and log standard deviation, shape (N, L) each, for ``seen`` (N, I) and ``action`` (N, A)."""
        mean, log_std = self.network(torch.cat([seen, action], dim=-1)).chunk(2, dim=-1)
        return mean, log_std.clamp(-5, 2)


class Decoder(nn.Module):
    """The action that a latent action stands for in a state."""

    def __init__(self, inputs: int, latents: int, actions: int, hidden_sizes: tuple[int, ...]):
        super().__init__()
        self.network = perceptron(inputs + latents, actions, hidden_sizes)

    def forward(self, seen: Tensor, latent: Tensor) -> Tensor:
        """Returns the action, in [-1, 1], shape (N, A), for ``seen`` (N, I) and ``latent`` (N, L)."""
        return self.network(torch.cat([seen, latent], dim=-1)).tanh()


class LatentPolicy(nn.Module):
    """The latent action to take, of which no number exceeds a maximum."""

    def __init__(self, inputs: int, latents: int, max_latent: float, hidden_sizes: tuple[int, ...]):
        super().__init__()
        self.network = perceptron(inputs, latents, hidden_sizes)
        self.max_latent = max_latent

    def forward(self, seen: Tensor) -> Tensor:
        """Returns the latent action, shape (N, L), for ``seen`` (N, I)."""
        return self.max_latent * self.network(seen).tanh()


class Critics(nn.Module):
    """Two estimates of the discounted rewards that follow an action, in steps."""

    def __init__(self, inputs: int, actions: int, hidden_sizes: tuple[int, ...]):
        super().__init__()
        self.networks = nn.ModuleList(perceptron(inputs + actions, 1, hidden_sizes) for _ in range(2))

    def forward(self, seen: Tensor, action: Tensor) -> Tensor:
        """Returns both, shape (2, N, 1), for ``seen`` (N, I) and ``action`` (N, A)."""
        joined = torch.cat([seen, action], dim=-1)
        return torch.stack([network(joined) for network in self.networks])


class SlowWeights(nn.Module):
    """Weights that follow those of a network slowly, in buffers: they are neither trained nor averaged."""

    def __init__(self, network: nn.Module):
        super().__init__()
        for name, weight in network.named_parameters():
            self.register_buffer(name.replace(".", "/"), weight.detach().clone())  # a buffer's name holds no dots

    @torch.no_grad()
    def follow(self, network: nn.Module, rate: float) -> None:
        """Goes a share of the way to the weights of the network."""
        for slow, weight in zip(self.buffers(), network.parameters(), strict=True):
            slow.lerp_(weight, rate)

    def forward(self, network: nn.Module, *inputs: Tensor) -> Tensor:
        """Returns what the network would with these weights."""
        weights = {name.replace("/", "."): slow for name, slow in self.named_buffers()}
        return functional_call(network, weights, inputs)


def held_fixed(network: nn.Module, *inputs: Tensor) -> Tensor:
    """Returns what a network does; gradients pass to its inputs and leave its weights alone."""
    weights = {name: weight.detach() for name, weight in network.named_parameters()}
    return functional_call(network, weights, inputs)
