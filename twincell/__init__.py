"""The application: job folders, reports and the command line."""
