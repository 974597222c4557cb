"""Surfaces reshaped between design and slicing: remeshed, trimmed, split, and stood on their end faces."""
