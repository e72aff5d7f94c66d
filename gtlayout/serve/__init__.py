"""Proposals for annotation tools: an auto-annotation function for CVAT, an ML backend for Label Studio."""
