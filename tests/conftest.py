"""Environment variables of all tests, set before any library reads them."""

import os

# Nothing here needs the Hub; a test that would ask it fails at once instead of waiting for the network.
os.environ.setdefault("HF_HUB_OFFLINE", "1")
# The tests run side by side, so each process has one core.
os.environ.setdefault("OMP_NUM_THREADS", "1")
