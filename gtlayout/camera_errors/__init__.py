"""Errors that all cameras of a video share: what they are, and which the tracks show."""
