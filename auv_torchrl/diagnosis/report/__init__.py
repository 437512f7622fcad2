"""What a diagnosis leaves for people and programs: the page, the recording, the tables."""

from typing import TYPE_CHECKING

from auv_torchrl.diagnosis.report.files import named_files, write_files
from auv_torchrl.diagnosis.report.table import decision_table, summary_table
from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.diagnosis.report.page import report_page

__all__ = ["named_files", "report_page", "decision_table", "summary_table", "write_files"]

__getattr__ = late(__name__, {"page": "report_page"})
