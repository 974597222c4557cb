"""Overhang: measured on toolpaths and surfaces, and relaxed on surfaces (seed paper, Section 3)."""
