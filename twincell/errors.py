"""Errors of the application.

JobError    a job folder that is missing, incomplete, or not as its products say
"""

from __future__ import annotations


class JobError(Exception):
    """A job folder is missing, incomplete, or not as its products say."""
