"""Images, depth maps and frames of videos."""
