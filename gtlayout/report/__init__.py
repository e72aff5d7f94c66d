"""A solved scene as one HTML page that needs nothing but a browser.

``report_data`` gathers the content of the page, ``page`` renders it, ``write_report`` does the reading and writing. For
runs of many scenes: ``solved_page`` and ``thumbnail`` of each, and ``plotly_file``, which their pages share.
"""

from gtlayout.report.data import report_data
from gtlayout.report.files import solved_page, write_report
from gtlayout.report.page import PLOTLY_FILE, page, plotly_file
from gtlayout.report.thumbnail import thumbnail

__all__ = ["PLOTLY_FILE", "page", "plotly_file", "report_data", "solved_page", "thumbnail", "write_report"]
