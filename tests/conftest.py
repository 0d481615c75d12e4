"""Settings of all tests: hypothesis draws the same examples every time, and no test fails because a machine is busy."""

from hypothesis import HealthCheck, settings

settings.register_profile("morphlet", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("morphlet")
