"""Settings shared by all tests."""

import os

from hypothesis import settings

# Kernels compile on first use: no deadline per example. A CI run must not depend on the draw of the day;
# everywhere else each run tries new examples.
settings.register_profile("aquaquad", deadline=None, print_blob=True, derandomize=bool(os.environ.get("CI")))
settings.load_profile("aquaquad")
