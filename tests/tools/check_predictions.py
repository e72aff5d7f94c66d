"""Judge predictions by Label Studio's own SDK: ``check_predictions.py CONFIG.xml RESULTS.json TASKS.json FOLDER``.

Prints, as JSON, what is wrong with each of the ``results`` of /predict for these tasks; FOLDER/result.json is the COCO
file that the SDK's converter makes of them, as if they were submitted.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from label_studio_sdk.converter import Converter
from label_studio_sdk.label_interface import LabelInterface
from label_studio_sdk.label_interface.objects import PredictionValue


def main() -> None:
    config, results, tasks = (Path(path).read_text() for path in sys.argv[1:4])
    interface = LabelInterface(config)
    predictions = json.loads(results)["results"]
    wrong = [interface.validate_prediction(each, return_errors=True) for each in predictions]
    for each in predictions:
        PredictionValue(**each)
    submitted = [
        {**task, "id": i, "annotations": [{"id": i, "result": each["result"], "was_cancelled": False}]}
        for i, (task, each) in enumerate(zip(json.loads(tasks), predictions, strict=True), 1)
    ]
    export = Path(sys.argv[4]) / "export.json"
    export.write_text(json.dumps(submitted))
    Converter(config, sys.argv[4], download_resources=False).convert(str(export), sys.argv[4], "COCO", is_dir=False)
    print(json.dumps(wrong))


if __name__ == "__main__":
    main()
