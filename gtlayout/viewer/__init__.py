"""Every stage in the rerun viewer; the only package that knows rerun."""
