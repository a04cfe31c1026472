"""Settings shared by all tests."""

from hypothesis import settings

# Kernels compile on first use: no deadline per example.
settings.register_profile("aquaquad", deadline=None, print_blob=True)
settings.load_profile("aquaquad")
