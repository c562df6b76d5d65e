"""Exports: scenes of stores as files, and demonstrations as a LeRobot dataset."""
