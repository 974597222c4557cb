"""Simulated pumps without a robot, for the tests of their drives."""
