"""Frames: what stays from frame to frame, one frame's exposure, and the choice of photons for a wanted error."""
