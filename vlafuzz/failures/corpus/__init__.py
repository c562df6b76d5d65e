"""Whether a policy does worse than another in the scenes of an exported corpus."""
