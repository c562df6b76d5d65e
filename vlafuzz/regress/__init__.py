"""Whether a subject does worse than another in the scenes of an exported corpus."""
