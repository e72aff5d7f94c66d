"""Results as files: what they are called, written and read back."""
