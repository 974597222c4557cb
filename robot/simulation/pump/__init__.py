"""The simulated pump: hopper, pump and hose, the drive that turns them, and the Modbus server that it is told by."""
