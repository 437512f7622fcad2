"""The package uses TorchRL and torch by what these promise, not by their insides."""

import re

from auv_torchrl.paths import PROJECT

INSIDE = re.compile(r"_new_unsafe|torch\._C\b|(?<!\.)\btype\(\w+\) is\b")
ASKED = {  # files that may, with the reason
    "link/job.py": "a bool is an int for isinstance, and no port",
}


def test_nothing_private_is_called():
    """No ``TensorDict._new_unsafe``, no ``torch._C``, no ``type(x) is``, but where there is no other way."""
    package = PROJECT / "auv_torchrl"
    found = {str(path.relative_to(package)) for path in package.rglob("*.py") if INSIDE.search(path.read_text())}
    assert found == set(ASKED)
