"""The one exception gtlayout raises for problems a user can understand and mend."""


class GtlayoutError(Exception):
    """A known problem. The message says what is wrong, where (file, frame or element), and what to do.

    The command line prints it as one line and exits with 1; everything else is a bug and shows its traceback.
    """
