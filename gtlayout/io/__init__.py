"""Files: every format of cameras, annotations and pixels that people have, read and written."""
