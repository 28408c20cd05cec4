#!/usr/bin/env bash
# Takes the screenshots of the viewer for the documentation; needs Chromium, and some minutes without a GPU.
set -euo pipefail
cd "$(dirname "$0")/.."

python=${PYTHON:-.venv/bin/python}
mindstage=${MINDSTAGE:-.venv/bin/mindstage}
pictures=docs/images

"$mindstage" shot bundled:kitchen --page --panel details --open fridge_door --select fridge -o "$pictures/kitchen.png"
"$mindstage" shot bundled:kitchen --size 1000x640 --highlight "storage_place_in_environment item=CowsMilk" -o "$pictures/kitchen-answer.png"
"$mindstage" shot bundled:kitchen --size 1000x640 --top --section 1.3 -o "$pictures/kitchen-plan.png"
"$mindstage" shot bundled:kitchen --size 840x520 --for 2 -o "$pictures/imagine.png" --plan '{
  "steps": [{"do": "move", "thing": "milk_carton_1", "to": {"position": [-0.1, -0.155, 0.85]}},
            {"do": "wait", "duration_s": 1}],
  "uncertainty": [{"thing": "milk_carton_1", "position_m": 0.01}]}'
"$python" scripts/photograph_replay.py "$pictures/replay.png"
