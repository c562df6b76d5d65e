"""The experiments of the VLATest paper on any policy, and what they found there."""
