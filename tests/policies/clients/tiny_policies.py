"""Tiny policies with random weights, made and saved by lerobot itself. Runs where lerobot is.

``make(kind, folder)``: act, diffusion or smolvla. SmolVLA's language model cannot be fetched in a test: it gets one
that is 32 to 64 wide, with a tokenizer of bytes.
"""

import os
from pathlib import Path
from typing import Any

import torch

os.environ["HF_HUB_OFFLINE"] = "1"
# Beside a torch for CPUs, torchvision has no operators of its own. Declared, they let lerobot be imported; it
# calls none of them.
LIBRARY = torch.library.Library("torchvision", "DEF")
for _name in ("nms", "qnms"):
    LIBRARY.define(f"{_name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")

SIDE, STATE, ACTIONS = 96, 8, 7


def make(kind: str, folder: Path) -> None:
    """A policy with its processors."""
    from lerobot.configs.types import FeatureType, PolicyFeature
    from lerobot.policies.factory import get_policy_class, make_pre_post_processors

    torch.manual_seed(0)
    picture = PolicyFeature(FeatureType.VISUAL, (3, SIDE, SIDE))
    inputs = {f"observation.images.{name}": picture for name in ("image", "image2")}
    inputs["observation.state"] = PolicyFeature(FeatureType.STATE, (STATE,))
    outputs = {"action": PolicyFeature(FeatureType.ACTION, (ACTIONS,))}
    features = {"input_features": inputs, "output_features": outputs, "device": "cpu"}
    config = {"act": _act, "diffusion": _diffusion, "smolvla": _smolvla}[kind](features, folder)
    policy = get_policy_class(kind)(config)
    policy.save_pretrained(folder)
    stats = {
        "observation.state": {"mean": torch.zeros(STATE), "std": torch.ones(STATE)},
        "action": {"mean": torch.zeros(ACTIONS), "std": torch.full((ACTIONS,), 0.1)},
    }
    for name in ("observation.state", "action"):
        size = len(stats[name]["mean"])
        stats[name] |= {"min": -torch.ones(size), "max": torch.ones(size)}
    for key in inputs:
        if "images" in key:
            ones = torch.ones(3, 1, 1)
            stats[key] = {"mean": ones / 2, "std": ones / 4, "min": ones * 0, "max": ones}
    for processor in make_pre_post_processors(config, dataset_stats=stats):
        processor.save_pretrained(folder)


def _act(features: dict, folder: Path) -> Any:
    from lerobot.policies.act.configuration_act import ACTConfig

    layers = dict.fromkeys(("n_encoder_layers", "n_vae_encoder_layers"), 1)
    widths = {"dim_model": 32, "n_heads": 2, "dim_feedforward": 64, "latent_dim": 8}
    steps = {"chunk_size": 10, "n_action_steps": 5}
    return ACTConfig(**features, **layers, **widths, **steps, pretrained_backbone_weights=None)


def _diffusion(features: dict, folder: Path) -> Any:
    from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig

    steps = {"n_obs_steps": 2, "horizon": 8, "n_action_steps": 4}
    noise = {"num_train_timesteps": 10, "num_inference_steps": 2}
    weights = {"crop_shape": None, "pretrained_backbone_weights": None, "down_dims": (32, 64)}
    return DiffusionConfig(**features, **steps, **noise, **weights)


def _smolvla(features: dict, folder: Path) -> Any:
    from lerobot.policies.smolvla.configuration_smolvla import SmolVLAConfig

    steps = {"chunk_size": 10, "n_action_steps": 5, "num_steps": 2}
    sizes = {"resize_imgs_with_padding": (64, 64), "max_state_dim": 8, "max_action_dim": 8}
    model = {"vlm_model_name": str(_language_model(folder / "vlm")), "load_vlm_weights": False}
    layers = {"num_vlm_layers": 2, "num_expert_layers": -1, "self_attn_every_n_layers": 2}
    words = {"tokenizer_max_length": 16, "expert_width_multiplier": 0.5}
    return SmolVLAConfig(**features, **steps, **sizes, **model, **layers, **words)


def _language_model(folder: Path) -> Path:
    """A tiny configuration and processor of SmolVLM."""
    import transformers
    from tokenizers import ByteLevelBPETokenizer

    special = ["<|endoftext|>", "<|im_start|>", "<end_of_utterance>", "<pad>", "<image>"]
    special += ["<fake_token_around_image>", "<global-img>"]
    bytes_alone = ByteLevelBPETokenizer()
    bytes_alone.train_from_iterator(["pick up the apple", "put it on the plate"], 320, special_tokens=special)
    folder.mkdir(parents=True)
    bytes_alone.save_model(str(folder))
    marks = {"image_token": special[4], "fake_image_token": special[5], "global_image_token": special[6]}
    tokenizer = transformers.GPT2TokenizerFast(
        str(folder / "vocab.json"),
        str(folder / "merges.txt"),
        pad_token="<pad>",
        model_max_length=512,
        extra_special_tokens=marks | {"end_of_utterance_token": special[2]},
    )
    pictures = transformers.SmolVLMImageProcessor(size={"longest_edge": 64}, max_image_size={"longest_edge": 64})
    video = transformers.SmolVLMVideoProcessor(size={"longest_edge": 64}, max_image_size={"longest_edge": 64})
    transformers.SmolVLMProcessor(pictures, tokenizer, video, chat_template="x").save_pretrained(folder)
    depth = {"num_hidden_layers": 2, "num_attention_heads": 2}
    eyes = {"hidden_size": 32, "intermediate_size": 64, "image_size": 64, "patch_size": 16}
    text = {"model_type": "llama", "hidden_size": 64, "intermediate_size": 128, "head_dim": 32}
    text |= {"num_key_value_heads": 2, "vocab_size": len(tokenizer), "pad_token_id": tokenizer.pad_token_id}
    transformers.SmolVLMConfig(
        vision_config=eyes | depth | {"num_hidden_layers": 1},
        text_config=text | depth,
        scale_factor=2,
        image_token_id=tokenizer.convert_tokens_to_ids("<image>"),
        pad_token_id=tokenizer.pad_token_id,
    ).save_pretrained(folder)
    return folder
