"""Fuzzing: mutated USD layers through the command line, and a judge of what comes out."""
