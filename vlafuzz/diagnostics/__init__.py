"""Whether a policy is what it should be before its failures are believed."""
