"""Comparing frames, sequences and debug layers with a baseline, and saying what differs."""
