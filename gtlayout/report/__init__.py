"""A solved scene as one HTML page that needs nothing but a browser.

``report_data`` gathers what the page says, ``page`` renders it, ``write_report`` does the reading and writing.
"""

from gtlayout.report.data import report_data
from gtlayout.report.files import write_report
from gtlayout.report.page import page

__all__ = ["page", "report_data", "write_report"]
