"""Check a labeling configuration with Label Studio's own parser, print its tags: ``check_label_studio.py FILE.xml``."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from label_studio_sdk.label_interface import LabelInterface


def main() -> None:
    interface = LabelInterface(Path(sys.argv[1]).read_text())
    interface.validate()
    print(json.dumps({control.name: [control.tag, list(control.labels)] for control in interface.controls}))


if __name__ == "__main__":
    main()
