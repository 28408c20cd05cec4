"""Uses what the plug-in of `examples/plugin` adds, from Python and over ports, and prints the results as JSON.

Started by `test_plugins.py` in a process that finds the plug-in and two others: one that cannot be imported, and one
without access classes.
"""

from __future__ import annotations

import json
import sys
from base64 import b64decode
from pathlib import Path
from typing import Any

import mindstage as ms
from mindstage.bridge import LocalNode
from mindstage.engines import make_engine
from mindstage.errors import MindstageError
from mindstage.knowledge.questions import list_questions
from mindstage.registry import problems
from mindstage.robots import add_robot
from mindstage.robots.sensors import measure
from mindstage.robots.skills import start_skill
from mindstage.ros import RosInterface
from tests.viewer.page_client import PageClient, RequestFailedError, connect_page_client
from tests.viewer.waiting import wait_until

MAP = """@prefix knowrob: <http://knowrob.org/kb/knowrob.owl#> .
@prefix : <https://pantry.example/map#> .
:larder a knowrob:SemanticEnvironmentMap .
:carton a knowrob:CowsMilk ; knowrob:describedInMap :larder ; <https://pantry.example/vocabulary#place> "1 2 0.5" .
"""


def error_of(call: Any, *args: Any, **options: Any) -> str:
    try:
        call(*args, **options)
    except (MindstageError, RequestFailedError) as error:
        return str(error)
    raise AssertionError("it was not refused")


def local(sim: ms.Simulation, folder: Path) -> dict[str, Any]:
    """What Python calls give."""
    robot = add_robot(sim, "mobile_manipulator")
    waved = robot.run(start_skill(robot, "wave", {}))
    notes = sim.save(folder / "out.stock")
    (folder / "pantry.ttl").write_text(MAP, encoding="utf-8")
    engine = make_engine("conveyor")
    with ms.open(folder / "out.stock", engine=engine) as moved:
        first = moved.snapshot().body("milk_carton_1").pose.position[0]
        moved.step(1.0)
        distance = moved.snapshot().body("milk_carton_1").pose.position[0] - first
    carton = ms.load(folder / "pantry.ttl").body("carton")
    return {
        "asked": [row.days for row in sim.ask("shelf_life", "milk_carton_1")],
        "sentence": [row.days for row in sim.ask("how long does the milk_carton_1 keep?")],
        "secret": [row.thing for row in sim.ask("secret")],
        "waved": [waved.outcome, [step.name for step in waved.steps]],
        "measured": measure(robot, "scale"),
        "notes": notes,
        "distance": round(distance, 3),
        "carton": [carton.pose.position, carton.cls],
        "names": [each.name for each in list_questions() if not each.module.startswith("mindstage.")],
        "broken": error_of(sim.ask, "broken_question"),
    }


def over_page(sim: ms.Simulation, page: PageClient, folder: Path) -> dict[str, Any]:
    """What a client of the page gets."""
    offered = [each["name"] for each in page.ask("ask.questions")]
    asked = page.ask("ask", question="shelf_life", args={"thing": "milk_carton_1"})
    understood = page.ask("ask", question="how long does the milk_carton_1 keep?", args={})
    sim.play()
    page.ask("robots.skill", robot="mobile_manipulator", skill="wave", args={})

    def outcome() -> Any:
        states = page.latest_value("robot_states") or {}
        return ((states.get("mobile_manipulator") or {}).get("skill") or {}).get("outcome") == "succeeded"

    wait_until(outcome, "the robot has waved")
    sim.pause()
    saved = page.ask("save", format="stock")
    found = {
        "offered": offered,
        "rows": asked["rows"],
        "understood": understood["rows"] == asked["rows"],
        "secret": error_of(page.ask, "ask", question="secret", args={}),
        "secret sentence": error_of(page.ask, "ask", question="what is the secret of milk_carton_1?", args={}),
        "skills": [each["name"] for each in page.ask("robots.offer")["skills"]],
        "measured": page.ask("robots.measure", robot="mobile_manipulator", sensor="scale"),
        "formats": page.ask("formats"),
        "saved": [saved["name"], b64decode(saved["base64"]) != b""],
    }
    loaded = page.ask("load", name="pantry.ttl", text=MAP)
    found["dialect"] = [loaded["bodies"], sim.snapshot().body("carton").pose.position]
    loaded = page.ask("load", name="one.stock", text="box http://x.org/o#Box 0 0 1\n")
    found["format"] = [loaded["name"], loaded["bodies"]]
    return found


def main() -> None:
    """Prints everything."""
    folder = Path(sys.argv[1])
    with ms.open("bundled:kitchen") as sim:
        found = {"local": local(sim, folder)}
        with LocalNode() as node, RosInterface(sim, node) as ros:
            found["ros"] = {
                "services": [name for name in ros.service_names if name.endswith(("shelf_life", "secret"))],
                "actions": [each.name for each in node.graph_info().actions if each.name.endswith(("wave", "salute"))],
            }
        with ms.view(sim, port=0) as viewer, connect_page_client(viewer.url) as page:
            found["page"] = over_page(sim, page, folder)
    found["problems"] = problems()
    print(json.dumps(found))


if __name__ == "__main__":
    main()
