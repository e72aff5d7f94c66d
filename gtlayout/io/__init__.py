"""Files: readers and writers of all known formats of cameras, annotations and pixels."""
