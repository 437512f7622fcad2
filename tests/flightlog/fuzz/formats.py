"""Every format by name, with what makes its logs."""

from collections.abc import Callable

from hypothesis import strategies as st

from tests.flightlog.fuzz import dataflash, mcap, packed, ros, tables, tlog, ulog
from tests.flightlog.fuzz.damage import Log

FORMATS: dict[str, Callable[[], st.SearchStrategy[Log]]] = {
    "dataflash": dataflash.logs,
    "dataflash_text": dataflash.text_logs,
    "tlog": tlog.logs,
    "ulog": ulog.logs,
    "mcap": mcap.logs,
    "ros1": ros.ros1_logs,
    "ros2_sqlite": ros.sqlite_logs,
    "ros2_mcap": ros.ros2_mcap_logs,
    "csv": tables.csv_logs,
    "parquet": tables.parquet_logs,
    "packed": packed.logs,
}
