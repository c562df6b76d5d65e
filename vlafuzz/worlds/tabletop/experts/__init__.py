"""Scripted controllers of the tabletop: experts, and a policy that sees outlines."""
