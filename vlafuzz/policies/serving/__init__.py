"""Serves our policies by the protocols of model servers, so that other clients can drive them."""
