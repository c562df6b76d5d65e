"""Whether a subject is what it should be before its failures are believed."""
