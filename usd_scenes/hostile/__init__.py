"""Mutated stages (:mod:`.cases`), and a judge of what the program makes of them (:mod:`.judge`)."""
