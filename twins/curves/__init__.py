"""Curves of a toolpath: resampled, smoothed, moved apart, and given widths (seed paper, Section 4)."""
