"""Where results go and what their files are called; quick to import."""

FOLDER = "gtlayout"
"""Inside the scene folder."""
LOG_FILE = "log.rrd"
REPORT_FILE = "report.html"
REVIEW_FILE = "review.json"
EVIDENCE_FILE = "evidence.json"
TIMINGS_FILE = "timings.json"
