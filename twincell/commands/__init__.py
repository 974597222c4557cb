"""What the commands of the command line take and say; `twincell.cli` gives them their names."""
