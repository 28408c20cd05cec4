"""`mindstage do`: skills, plans and designators in a map, with results as text, JSON and exit codes."""

from __future__ import annotations

import json
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

from mindstage.access.policies import Access
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.cli.options import ExitCode
from mindstage.engines.mujoco import MujocoEngine
from mindstage.episodes import Episode
from mindstage.knowledge import KnowledgeBase
from mindstage.registry import Group, added
from mindstage.robots import add_robot
from mindstage.robots.skill_declaration import ThingName, skill
from mindstage.robots.skill_task import SkillTask
from mindstage.ros import RosInterface
from mindstage.simulation import Simulation
from tests.cli.runner import Run, WriteMap, json_output
from tests.engines.scenes import body, world

MUG = '{"the": "object", "name": "Mug1"}'


@skill(needs=())
def pick(task: SkillTask, thing: ThingName) -> Generator[float, None, None]:
    """Succeeds for the first mug only.

    Args:
        thing: what is picked.
    """
    with task.step("grasp", f"close the gripper around {thing}"):
        yield 0.2
    if thing != "Mug1":
        raise task.failure(f"{thing} slipped", "try Mug1")
    task.assume(f"{thing} is empty")


@skill(needs=())
def doubt(task: SkillTask) -> Generator[float, None, None]:
    """Ends with an unknown outcome."""
    yield 0.1
    raise task.failure("nothing was seen", "look again", is_known=False)


@pytest.fixture(autouse=True)
def fake_skills() -> Iterator[None]:
    """Two skills of known behavior beside the real ones."""
    with added(Group.SKILLS, "pick", pick), added(Group.SKILLS, "doubt", doubt, access=Access.ACT):
        yield


def test_a_robot_drives_to_a_place_and_says_where_it_stands(run: Run, write_map: WriteMap) -> None:
    result = run("do", "go_to x=0.5 y=-0.5 yaw=1.0", write_map(), "--pose", "0,0")
    assert result.exit_code == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[0] == "mobile_manipulator stands at (0.00, 0.00), facing 0°"
    assert any(line.startswith("drive: ") for line in lines)
    assert "the robot stands at (0.50, -0.50)" in lines[-1]


def test_without_a_place_it_stands_where_nothing_else_is(run: Run, write_map: WriteMap) -> None:
    content = json_output(run("do", "doubt", write_map(), "--json"))
    x, y, _ = content["result"]["skills"][0]["state"]["base"]
    assert min((x - 1.0) ** 2 + (y - 2.0) ** 2, (x - 3.0) ** 2 + (y - 2.0) ** 2) > 0.4**2


def test_steps_assumptions_and_the_state_are_printed(run: Run, write_map: WriteMap) -> None:
    result = run("do", "pick Mug1", write_map())
    assert result.exit_code == 0, result.stderr
    assert "grasp: close the gripper around Mug1 (0.2 s)" in result.stdout
    assert "succeeded after " in result.stdout
    assert "assumed: Mug1 is empty" in result.stderr


def test_a_failed_skill_exits_with_1_and_says_what_to_try(run: Run, write_map: WriteMap) -> None:
    result = run("do", "pick Mug1; pick Mug2", write_map())
    assert result.exit_code == 1
    assert "failed to pick Mug2: Mug2 slipped" in result.stdout
    assert "to try: try Mug1" in result.stdout


def test_an_unknown_outcome_exits_with_3(run: Run, write_map: WriteMap) -> None:
    result = run("do", "doubt", write_map())
    assert result.exit_code == ExitCode.UNKNOWN
    assert "may not have done doubt: nothing was seen" in result.stdout


def test_json_has_the_skills_the_robot_and_what_was_spawned(run: Run, write_map: WriteMap) -> None:
    result = run("do", "pick thing=Mug2", write_map(), "--json")
    assert result.exit_code == 1
    content = json_output(result)
    assert content["robot"] == {"name": "mobile_manipulator", "model": "mobile_manipulator"}
    assert (content["done"], content["outcome"]) == (True, "failed")
    (done,) = content["result"]["skills"]
    assert (done["skill"], done["args"], done["suggestion"]) == ("pick", {"thing": "Mug2"}, "try Mug1")
    assert content["result"]["cause"]["kind"] == "skill"


def test_what_is_improbable_is_not_done(run: Run, write_map: WriteMap) -> None:
    refused = run("do", "pick Mug2", write_map(), "--try-first", 0.9, "--json")
    assert refused.exit_code == 1
    content = json_output(refused)
    assert (content["done"], content["outcome"], content["result"]) == (False, None, None)
    assert "at least 0.90 is required" in content["try_first"]["reason"]
    assert content["try_first"]["verdict"]["outcome"] == "failed"
    allowed = run("do", "pick Mug1", write_map(), "--try-first", 0.9)
    assert allowed.exit_code == 0
    assert "tried: succeeded: 1 of 1 samples succeeded" in allowed.stdout


def test_a_plan_is_done_from_a_file_or_text(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    plan = tmp_path / "plan.yaml"
    plan.write_text("steps:\n  - {do: perform, skill: pick, args: {thing: Mug1}}\n  - {do: wait, duration_s: 0.1}\n")
    for arguments in (("--plan", plan, write_map()), (plan, write_map())):
        assert run("do", *arguments).exit_code == 0
    text = '{"do": "perform", "skill": "pick", "args": {"thing": "Mug2"}}'
    assert run("do", text, write_map()).exit_code == 1
    plan.write_text("steps:\n  - {do: perform, skill: pik, args: {thing: Mug1}}\n")
    wrong = run("do", "--plan", plan, write_map())
    assert wrong.exit_code == 2
    assert "plan.yaml:2: steps[0].skill: there is no skill 'pik'" in wrong.stderr


def test_a_designator_is_done_and_explained(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    text = json.dumps({"an": "action", "type": "picking-up", "object": {"an": "object", "type": "Mug"}, "arm": "left"})
    result = run("do", text, write_map())
    assert result.exit_code == 0, result.stderr
    assert "the designator is pick thing=Mug1" in result.stderr
    assert "thing: Mug1 was taken, Mug2 would fit too" in result.stderr
    assert "arm is not used" in result.stderr
    file = tmp_path / "action.json"
    file.write_text(text)
    assert run("do", file, write_map()).exit_code == 0


def test_an_episode_and_the_world_afterwards_are_written(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    episode, world = tmp_path / "run.mcap", tmp_path / "after.owl"
    result = run("do", "pick Mug1", write_map(), "--record", episode, "--out", world)
    assert result.exit_code == 0, result.stderr
    assert f"episode → {episode}" in result.stdout.replace("\n", "")
    with Episode.open(episode) as recorded:
        assert "base_link" in {body.id for body in recorded.state_at(0.1).world.bodies}
    knowledge = KnowledgeBase()
    knowledge.load(world)
    assert {body.id for body in knowledge.world().bodies} == {"Mug1", "Mug2"}  # without the robot
    again = run("do", "pick Mug1", write_map(), "--record", episode)
    assert (again.exit_code, "it exists" in again.stderr) == (2, True)


@pytest.mark.parametrize(
    ("arguments", "cause"),
    [
        (("do",), "there is nothing to do"),
        (("do", "pick Mug1"), "there is no map"),
        (("do", "fly Mug1", "MAP"), "there is no skill 'fly'"),
        (("do", "pick", "MAP"), "thing is missing"),
        (("do", "pick Nonsense", "MAP"), "Nonsense"),
        (("do", "pick Mug1", "MAP", "--pose", "here"), "give X,Y or X,Y,YAW"),
        (("do", "pick Mug1", "MAP", "--robot", "r2d2"), "no robot 'r2d2'"),
        (("do", "{", "MAP"), "neither JSON nor YAML"),
        (("do", '{"an": "action", "type": "flying"}', "MAP"), "'flying' is unknown"),
    ],
)
def test_what_cannot_be_done_exits_with_2_and_the_cause(
    run: Run, write_map: WriteMap, arguments: tuple[str, ...], cause: str
) -> None:
    result = run(*(write_map() if each == "MAP" else each for each in arguments))
    assert result.exit_code == 2, result.stdout
    assert cause in result.stderr


# -- running simulations -----------------------------------------------------------------------------------------------


@pytest.fixture
def address() -> Iterator[str]:
    """The address of a playing simulation with a robot."""
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as simulation:
        simulation.spawn(world(body("floor", (0.0, 0.0, -0.05), (9.0, 9.0, 0.1))))
        add_robot(simulation, "mobile_manipulator")
        with LocalNode() as node, RosInterface(simulation, node), RosbridgeServer(node, port=0) as server:
            simulation.play(speed=4.0)
            yield f"ros://127.0.0.1:{server.port}"
            simulation.pause()


def test_a_running_robot_performs_skills_and_reports_its_steps(run: Run, address: str) -> None:
    result = run("do", "go_to x=0.4 y=0.0; doubt", "--running", address)
    assert result.exit_code == ExitCode.UNKNOWN, result.stderr
    assert "drive" in result.stdout, result.stderr
    assert "go_to succeeded after " in result.stdout
    assert "doubt unknown after " in result.stdout
    content = json_output(run("do", "go_to x=0.0 y=0.0", address, "--json"))
    (done,) = content["skills"]
    assert (done["outcome"], json.loads(done["args"])) == ("succeeded", {"x": 0.0, "y": 0.0})


def test_a_running_robot_refuses_what_is_no_skill(run: Run, address: str) -> None:
    for command, cause in (("fly", "there is no skill 'fly'"), ('{"an": "action"}', "skills only")):
        result = run("do", command, "--running", address)
        assert (result.exit_code, cause in result.stderr) == (2, True), result.stderr
    options = run("do", "park", "--running", address, "--try-first", 0.5)
    assert (options.exit_code, "--try-first" in options.stderr) == (2, True)
