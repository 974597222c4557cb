"""Curves in space and the toolpath: wrapped into layers, and unwrapped again."""
