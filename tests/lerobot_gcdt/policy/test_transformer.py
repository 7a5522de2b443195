"""The backbone: equal to GPT-2, causal, and the same with and without its cache."""

import pytest
import torch
from torch import nn

from lerobot_gcdt.policy.transformer import KeyValueCache, Transformer

LAYERS, HEADS, WIDTH, INNER = 3, 2, 16, 24


def make_transformer(seed=0):
    torch.manual_seed(seed)
    transformer = Transformer(LAYERS, HEADS, WIDTH, INNER).eval()
    for parameter in transformer.parameters():
        nn.init.normal_(parameter, std=0.3)  # biases and norms that matter
    return transformer


def causal_mask(length):
    return torch.full((1, 1, length, length), float("-inf")).triu(1)


def test_equals_hugging_face_gpt2_with_copied_weights():
    transformers = pytest.importorskip("transformers")
    ours = make_transformer()
    config = transformers.GPT2Config(
        vocab_size=1, n_positions=16, n_embd=WIDTH, n_layer=LAYERS, n_head=HEADS, n_inner=INNER,
        resid_pdrop=0, embd_pdrop=0, attn_pdrop=0, activation_function="relu",
    )  # fmt: skip
    reference = transformers.GPT2Model(config).eval()
    with torch.no_grad():
        reference.wpe.weight.zero_()  # our tokens bring their own positions
        reference.ln_f.load_state_dict(ours.norm.state_dict())
        for theirs, block in zip(reference.h, ours.blocks, strict=True):
            theirs.ln_1.load_state_dict(block.attention_norm.state_dict())
            theirs.ln_2.load_state_dict(block.mlp_norm.state_dict())
            for conv, linear in (
                (theirs.attn.c_attn, block.attention.query_key_value),
                (theirs.attn.c_proj, block.attention.output),
                (theirs.mlp.c_fc, block.mlp[0]),
                (theirs.mlp.c_proj, block.mlp[2]),
            ):
                conv.weight.copy_(linear.weight.T)
                conv.bias.copy_(linear.bias)
    tokens = torch.randn(4, 11, WIDTH)
    with torch.no_grad():
        torch.testing.assert_close(
            ours(tokens, causal_mask(11)),
            reference(inputs_embeds=tokens).last_hidden_state,
            atol=1e-5,
            rtol=1e-5,
        )


def test_boolean_and_additive_masks_agree():
    transformer, tokens, mask = make_transformer(), torch.randn(2, 9, WIDTH), causal_mask(9)
    torch.testing.assert_close(transformer(tokens, mask), transformer(tokens, mask == 0), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("t", [0, 4, 7])
def test_a_change_after_t_changes_nothing_up_to_t(t):
    transformer, tokens = make_transformer(), torch.randn(1, 9, WIDTH)
    changed = tokens.clone()
    changed[:, t + 1 :] += 1
    before, after = transformer(tokens, causal_mask(9)), transformer(changed, causal_mask(9))
    assert torch.equal(before[:, : t + 1], after[:, : t + 1])
    assert not torch.equal(before[:, t + 1 :], after[:, t + 1 :])


@pytest.mark.parametrize("chunks", [[1] * 9, [4, 1, 3, 1], [9]])
def test_cached_chunks_equal_one_pass(chunks):
    transformer, tokens = make_transformer(), torch.randn(2, 9, WIDTH)
    caches = [KeyValueCache(16) for _ in range(LAYERS)]
    outputs, start = [], 0
    for size in chunks:
        mask = causal_mask(9)[..., start : start + size, : start + size]
        outputs.append(transformer(tokens[:, start : start + size], mask, caches))
        start += size
    torch.testing.assert_close(torch.cat(outputs, 1), transformer(tokens, causal_mask(9)), atol=1e-5, rtol=1e-5)


def test_a_full_cache_overwrites_its_oldest_tokens():
    cache = KeyValueCache(4)
    for i in range(6):
        keys, values = cache.append(torch.full((1, 1, 1, 1), float(i)), torch.full((1, 1, 1, 1), -float(i)))
    assert sorted(keys.flatten().tolist()) == [2, 3, 4, 5]
    assert torch.equal(values, -keys)


def test_dropout_acts_in_training_only():
    torch.manual_seed(0)
    transformer = Transformer(LAYERS, HEADS, WIDTH, INNER, dropout=0.5)
    tokens = torch.randn(1, 5, WIDTH)
    assert not torch.equal(transformer(tokens, causal_mask(5)), transformer(tokens, causal_mask(5)))
    transformer.eval()
    assert torch.equal(transformer(tokens, causal_mask(5)), transformer(tokens, causal_mask(5)))
