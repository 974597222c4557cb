"""Regions of layers: booleans, offsets, joins, cleaning and edits of toolpaths."""
