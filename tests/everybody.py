"""How property tests run, for everybody; tests/conftest.py has it loaded."""

from hypothesis import HealthCheck, settings

# The same examples for everybody, on a busy machine as on an idle one: hypothesis would choose others where CI is set,
# and fail by the clock where it is not.
settings.register_profile(
    "everybody",
    deadline=None,
    derandomize=True,
    print_blob=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("everybody")
