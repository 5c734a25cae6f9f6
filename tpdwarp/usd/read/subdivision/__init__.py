"""Subdivision surfaces: Catmull-Clark and Loop, refined and then moved to their limit."""
