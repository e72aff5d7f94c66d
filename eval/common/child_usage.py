"""Run a command and print, as JSON on the last line, its seconds, peak memory and exit status.

    python child_usage.py COMMAND [ARGUMENT ...]

Stays small: what Linux calls the peak memory of a process begins with that of the process it was forked from.
"""

import json
import os
import sys
import time

if __name__ == "__main__":
    start = time.perf_counter()
    child = os.posix_spawnp(sys.argv[1], sys.argv[1:], os.environ)
    _, status, usage = os.wait4(child, 0)
    seconds = time.perf_counter() - start
    # KiB, on macOS bytes.
    peak_bytes = usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    print(json.dumps({"seconds": seconds, "peak_bytes": peak_bytes, "status": os.waitstatus_to_exitcode(status)}))
