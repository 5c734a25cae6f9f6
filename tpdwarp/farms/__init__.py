"""Sequences spread over several processes and machines: Dask clusters, and templates for render farms."""
