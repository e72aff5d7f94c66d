"""The command ``gtlayout``, and ``python -m gtlayout`` where it is not on the path."""

import os
import signal
import sys


def main() -> int:
    """Run the command line in a process of its own, and return its exit status."""
    # Before the imports: the first takes a hundredth of a second, and the others take seconds.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    from gtlayout.signals import end_in_one_line, nothing_left_to_end

    end_in_one_line("gtlayout")
    from gtlayout.cli.app import main as run
    from gtlayout.cli.console import print_any_sign

    print_any_sign()
    status = run()
    nothing_left_to_end()
    return status


def _leave(number: int, _: object) -> None:
    """As ``gtlayout.signals.leave``, which is not imported yet."""
    os.write(2, b"gtlayout: interrupted\n")
    os._exit(128 + number)


if __name__ == "__main__":
    sys.exit(main())
