"""What moves the simulated arm: motions that are planned, told move by move, or steered, and the frames they run on."""
