"""Programs of the simulated controller: what URScript's functions do to its machine."""
