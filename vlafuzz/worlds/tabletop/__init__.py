"""The tabletop: VLATest's tasks on ManiSkill."""
