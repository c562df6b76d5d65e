"""Policies of ours behind the protocols of model servers, so that others' clients can drive them."""
