"""The command ``gtlayout``, and ``python -m gtlayout`` where it is not on the path."""

import sys

from gtlayout.signals import end_in_one_line, nothing_left_to_end


def main() -> int:
    """Run the command line in a process of its own, and return its exit status."""
    # Before the imports, which take seconds.
    end_in_one_line("gtlayout")
    from gtlayout.cli.app import main as run
    from gtlayout.cli.console import print_any_sign

    print_any_sign()
    status = run()
    nothing_left_to_end()
    return status


if __name__ == "__main__":
    sys.exit(main())
