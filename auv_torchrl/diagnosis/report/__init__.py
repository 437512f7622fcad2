"""What a diagnosis leaves for people and programs: the page, the recording, the tables."""

from auv_torchrl.diagnosis.report.files import write_files
from auv_torchrl.diagnosis.report.page import report_page

__all__ = ["report_page", "write_files"]
