"""The GPT backbone: a causal pre-norm transformer over ready-made tokens.

Shapes: B rows, L tokens, W width, H heads. The model adds no positions of its own; who makes the tokens does.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional as F


class KeyValueCache:
    """Keys and values of the tokens so far, for one layer, in a ring of fixed size.

    Attention does not care for the order of its keys, so the oldest ones are simply overwritten.

    Args:
        capacity: How many tokens are kept.
    """

    def __init__(self, capacity: int):
        self._capacity = capacity
        self._count = 0
        self._keys: Tensor | None = None
        self._values: Tensor | None = None

    def append(self, keys: Tensor, values: Tensor) -> tuple[Tensor, Tensor]:
        """Adds keys and values of shape (B, H, L, W / H); returns all that are kept, slot by slot."""
        if self._keys is None or self._values is None:
            b, h, _, d = keys.shape
            self._keys = keys.new_empty(b, h, self._capacity, d)
            self._values = values.new_empty(b, h, self._capacity, d)
        slots = (torch.arange(keys.shape[2], device=keys.device) + self._count) % self._capacity
        self._keys[:, :, slots] = keys
        self._values[:, :, slots] = values
        self._count += keys.shape[2]
        kept = min(self._count, self._capacity)
        return self._keys[:, :, :kept], self._values[:, :, :kept]

    def forget(self, count: int) -> None:
        """Gives the slots of the last tokens free again, as if they had not been added."""
        self._count -= count


def attend(q: Tensor, k: Tensor, v: Tensor, mask: Tensor, dropout: float) -> Tensor:
    """Scaled dot-product attention, spelled out where that is faster.

    On a CPU in bfloat16 the backward pass of PyTorch's fused attention makes a training step 1.3 to 1.9 times as long
    as the plain formula does.
    """
    if q.device.type != "cpu" or mask.dtype == torch.bool:
        return F.scaled_dot_product_attention(q, k, v, attn_mask=mask, dropout_p=dropout)
    scores = (q * q.shape[-1] ** -0.5) @ k.transpose(-1, -2) + mask
    return F.dropout(scores.softmax(-1).to(v.dtype), dropout) @ v


def attention_mask(
    segment: Tensor, kinds: int, context_length: int | None, causal: bool, dtype: torch.dtype = torch.float32
) -> Tensor:
    """Makes the additive mask of pieces that are packed side by side into rows.

    Args:
        segment: Which piece a step belongs to, shape (R, S).
        kinds: Tokens of a step.
        context_length: Steps that a token may attend to, its own included; None for all of its piece.
        causal: Whether a token sees the past and itself only, or all of its piece.
        dtype: Of the attention scores.

    Returns:
        0 where a token may look and minus infinity elsewhere, shape (R, 1, L, L) with L = kinds x S.
    """
    r, s = segment.shape
    segment = segment.repeat_interleave(kinds, dim=1)
    allowed = segment[:, :, None] == segment[:, None, :]
    if causal:
        allowed &= torch.ones(s * kinds, s * kinds, dtype=torch.bool, device=segment.device).tril()
    if context_length is not None:
        step = torch.arange(s, device=segment.device).repeat_interleave(kinds)
        allowed &= step[:, None] - step[None, :] < context_length
    mask = torch.zeros(r, 1, s * kinds, s * kinds, device=segment.device, dtype=dtype)
    return mask.masked_fill(~allowed[:, None], float("-inf"))


class Attention(nn.Module):
    """Multi-head self-attention."""

    def __init__(self, width: int, heads: int, dropout: float):
        super().__init__()
        self.heads = heads
        self.dropout = dropout
        self.query_key_value = nn.Linear(width, 3 * width)
        self.output = nn.Linear(width, width)

    def forward(self, x: Tensor, mask: Tensor, cache: KeyValueCache | None = None) -> Tensor:
        b, n, w = x.shape
        if n == 1 and cache is None:  # a token that is alone attends to itself, whatever queries and keys say
            value = F.linear(x, self.query_key_value.weight[2 * w :], self.query_key_value.bias[2 * w :])
            return F.dropout(self.output(value), self.dropout if self.training else 0.0)
        q, k, v = self.query_key_value(x).view(b, n, 3, self.heads, w // self.heads).permute(2, 0, 3, 1, 4)
        if cache is not None:
            k, v = cache.append(k, v)
        dropout = self.dropout if self.training else 0.0
        y = attend(q, k, v, mask, dropout)  # (B, H, L, W / H)
        return F.dropout(self.output(y.transpose(1, 2).reshape(b, n, w)), dropout)


class Block(nn.Module):
    """Attention and a two-layer perceptron, each behind a layer norm and beside a residual path.

    ReLU is the decision transformer's choice (Chen et al. 2021); GELU makes a training step on a CPU a fifth longer.
    """

    def __init__(self, width: int, inner_width: int, heads: int, dropout: float):
        super().__init__()
        self.attention_norm = nn.LayerNorm(width)
        self.attention = Attention(width, heads, dropout)
        self.mlp_norm = nn.LayerNorm(width)
        self.mlp = nn.Sequential(
            nn.Linear(width, inner_width),
            nn.ReLU(),
            nn.Linear(inner_width, width),
            nn.Dropout(dropout),
        )

    def forward(self, x: Tensor, mask: Tensor, cache: KeyValueCache | None = None) -> Tensor:
        x = x + self.attention(self.attention_norm(x), mask, cache)
        return x + self.mlp(self.mlp_norm(x))


class Transformer(nn.Module):
    """A stack of blocks and, if that is asked for, a last layer norm, initialised like GPT-2.

    Args:
        layers: Number of blocks.
        heads: Attention heads a block.
        width: Size of a token.
        inner_width: Size of the perceptrons' hidden layer.
        dropout: Probability of dropping an attention weight or an output.
        normalised: Whether there is a last layer norm.
    """

    def __init__(
        self, layers: int, heads: int, width: int, inner_width: int, dropout: float = 0.0, normalised: bool = True
    ):
        super().__init__()
        self.blocks = nn.ModuleList(Block(width, inner_width, heads, dropout) for _ in range(layers))
        self.norm = nn.LayerNorm(width) if normalised else nn.Identity()
        for name, parameter in self.named_parameters():
            if name.endswith("bias"):
                nn.init.zeros_(parameter)
            elif parameter.ndim == 2:
                # Outputs onto the residual path shrink with depth, so that its variance does not grow.
                onto_residual = name.endswith(("output.weight", "mlp.2.weight"))
                nn.init.normal_(parameter, std=0.02 / (2 * layers) ** 0.5 if onto_residual else 0.02)

    def forward(self, tokens: Tensor, mask: Tensor, caches: list[KeyValueCache] | None = None) -> Tensor:
        """Transforms tokens.

        Args:
            tokens: Shape (B, L, W).
            mask: What each token may attend to: booleans, or a float tensor added to the attention scores; shape
                (B, 1, L, L) or one that broadcasts to it. With caches the last size is the number of kept tokens.
            caches: One a block, when the tokens follow earlier ones.

        Returns:
            Shape (B, L, W).
        """
        x = tokens
        for i, block in enumerate(self.blocks):
            x = block(x, mask, caches[i] if caches else None)
        return self.norm(x)
