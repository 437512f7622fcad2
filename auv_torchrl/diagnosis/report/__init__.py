"""What a diagnosis leaves for people and programs: the page, the recording, the tables."""

from auv_torchrl.diagnosis.report.files import named_files, write_files
from auv_torchrl.diagnosis.report.page import report_page
from auv_torchrl.diagnosis.report.table import decision_table, summary_table

__all__ = ["named_files", "report_page", "decision_table", "summary_table", "write_files"]
