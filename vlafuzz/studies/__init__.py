"""The experiments of the VLATest paper on any subject, and what they found there."""
