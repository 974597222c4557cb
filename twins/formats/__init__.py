"""Formats that designers use: each reader gives the polygons of a file as they stand there, and its unit."""
