"""Writes the ACT of docs/repair.md, with random weights, to start/."""

from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.policies.factory import make_pre_post_processors
from lerobot.utils.random_utils import set_seed

set_seed(0)
config = ACTConfig(
    input_features={
        "observation.images.front": PolicyFeature(FeatureType.VISUAL, (3, 96, 96)),
        "observation.state": PolicyFeature(FeatureType.STATE, (7,)),
    },
    output_features={"action": PolicyFeature(FeatureType.ACTION, (7,))},
    chunk_size=8,
    n_action_steps=1,
    dim_model=128,
    n_heads=4,
    dim_feedforward=256,
    n_encoder_layers=2,
    pre_norm=True,
    use_vae=False,
    pretrained_backbone_weights=None,
    push_to_hub=False,
    device="cpu",
    optimizer_lr=1e-4,
    optimizer_lr_backbone=1e-4,
)
policy = ACTPolicy(config)
for name, numbers in policy.named_buffers():  # a ResNet with frozen norms and random weights needs damping
    if name.endswith("bn2.weight"):
        numbers.fill_(0.25)
for part in (policy, *make_pre_post_processors(config)):
    part.save_pretrained("start")
