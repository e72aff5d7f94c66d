"""Where results go and what their files are called; quick to import."""

FOLDER = "gtlayout"
"""Inside the scene folder."""
LOG_FILE = "log.rrd"
REPORT_FILE = "report.html"
TIMINGS_FILE = "timings.json"
