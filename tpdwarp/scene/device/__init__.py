"""The scene on the device: packed geometry, rays that meet it, and scenes loaded for one shutter."""
