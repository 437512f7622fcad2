"""Whatever a log of any format holds, reading it gives a result or one printable line, in bounded memory and time."""

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.flightlog.fuzz.contract import read_or_refuse, written
from tests.flightlog.fuzz.formats import FORMATS


@pytest.mark.parametrize("name", FORMATS)
def test_any_log(pytestconfig, name):
    """Logs of a format with fields, records and bytes altered; ``--draws`` makes more of them."""

    @settings(
        max_examples=pytestconfig.getoption("--draws"),
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(st.data())
    def read(data):
        with TemporaryDirectory() as folder:
            read_or_refuse(written(data.draw(FORMATS[name]()), Path(folder)))

    read()
