"""What follows photons through the shutter: keyframes, the trajectories fitted to them, and segments of the shutter."""
