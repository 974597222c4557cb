"""The ports of the simulated controller, as a real one has them."""
