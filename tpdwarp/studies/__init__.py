"""Measuring error against time: methods and settings swept over a stage, beside a converged accumulation of it."""
