"""The simulated pump: a drive that is told by Modbus, and the hose behind it."""
