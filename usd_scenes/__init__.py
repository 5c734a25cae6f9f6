"""Scenes that tests and benchmarks measure the renderer on, and what light truly does in them."""
