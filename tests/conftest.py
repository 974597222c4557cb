"""What all tests share."""

import os

from hypothesis import settings

# At a desk every run looks for new examples; in CI a change is not to blame for one that it did not make.
settings.register_profile("ci", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("ci")
