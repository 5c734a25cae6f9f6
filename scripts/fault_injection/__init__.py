"""Faults injected into renders, and what became of the frames."""
