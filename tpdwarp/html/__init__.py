"""Parts of self-contained HTML reports: pages, curves, tables and pictures that need no network."""
