"""The environments of Gymnasium: contract, rewards from questions, equal episodes, vectors, and both baselines."""

from __future__ import annotations

import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from mindstage import save
from mindstage.errors import InvalidArgumentError, RobotNotFoundError
from mindstage.gym import OpenEnv, PickEnv, PlaceEnv, PutAwayEnv, RobotTaskEnv, play_randomly, play_skill
from mindstage.gym import success_rate as rate_of
from mindstage.scene import BodyId
from mindstage.scene.edits import SetPoses
from mindstage.scene.transforms import pose_from_array
from mindstage.simulation.state import poses_in
from tests.cases import each_case
from tests.kitchenette import kitchenette

TASKS = {"Open": "Drawer", "Pick": "Mug", "Place": "Mug"}


@pytest.fixture(scope="module")
def map_path(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("maps") / "kitchenette.owl"
    save(kitchenette(), path)
    return str(path)


@pytest.fixture(scope="module")
def open_env(map_path: str) -> Iterator[OpenEnv]:
    env = OpenEnv(map_path)
    yield env
    env.close()


@pytest.fixture(scope="module", params=TASKS)
def env(request: pytest.FixtureRequest, map_path: str) -> Iterator[gymnasium.Env]:
    options = {"on": "Fridge"} if request.param == "Place" else {}
    env = gymnasium.make(f"mindstage/{request.param}-v0", map=map_path, thing=TASKS[request.param], **options)
    yield env
    env.close()


def task_of(env: gymnasium.Env) -> RobotTaskEnv:
    return cast(RobotTaskEnv, env.unwrapped)


IMPORTS = {
    "gymnasium alone": ("import gymnasium", "mindstage:mindstage/Open-v0"),
    "first gymnasium": ("import gymnasium, mindstage", "mindstage/Open-v0"),
    "first mindstage": ("import mindstage, gymnasium", "mindstage/Open-v0"),
    "first mindstage, with a module": ("import mindstage, gymnasium", "mindstage:mindstage/Open-v0"),
    "a submodule of gymnasium": (
        "import mindstage; from gymnasium.envs import registration; import gymnasium",
        "mindstage/Open-v0",
    ),
    "gymnasium in threads": (
        "import mindstage, threading, importlib\n"
        "threads = [threading.Thread(target=importlib.import_module, args=['gymnasium']) for _ in range(4)]\n"
        "for each in threads: each.start()\n"
        "for each in threads: each.join()\n"
        "import gymnasium",
        "mindstage/Open-v0",
    ),
}
"""Statements in a new process, and the id by which the environment is then found."""


@each_case("order", IMPORTS)
def test_an_environment_is_found_by_its_id_in_every_order_of_imports(order: str) -> None:
    statements, id = IMPORTS[order]
    code = (
        f"import sys, warnings; warnings.simplefilter('error')\n{statements}\n"
        "from gymnasium.envs import registration\n"  # `gymnasium.make` begins with `_find_spec`
        f"print(registration._find_spec({id!r}).entry_point, *(type(each).__name__ for each in sys.meta_path))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert run.stdout.startswith("mindstage.gym:OpenEnv ")
    assert "_ImportHook" not in run.stdout, "the hook is removed after the import"


def test_a_fresh_process_makes_an_environment_by_the_module_that_defines_it() -> None:
    code = "import mindstage, gymnasium; gymnasium.make('mindstage.gym:mindstage/Open-v0', thing='nothing')"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert "OpenEnv cannot be about it" in run.stderr, "the environment is found, and refuses its argument"


def test_it_keeps_the_contract_of_gymnasium(env: gymnasium.Env) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)


def test_equal_seeds_and_actions_give_equal_episodes(env: gymnasium.Env) -> None:
    env.action_space.seed(4)
    actions = [env.action_space.sample() for _ in range(4)]

    def play() -> tuple[list[np.ndarray], list[float]]:
        first, _ = env.reset(seed=7)
        steps = [env.step(action)[:2] for action in actions]
        return [first, *(each for each, _ in steps)], [float(reward) for _, reward in steps]

    (before, rewards), (after, again) = play(), play()
    assert rewards == again
    assert np.array_equal(before, after)
    assert not np.array_equal(before[0], env.reset(seed=8)[0]), "another seed is another place"


def test_every_number_has_a_name_and_is_within_its_bounds(env: gymnasium.Env) -> None:
    task, (observation, _) = task_of(env), env.reset(seed=0)
    assert len(task.observation_names) == len(observation) == len(set(task.observation_names))
    assert len(task.action_names) == env.action_space.shape[0] == len(set(task.action_names))  # type: ignore[index]
    values = dict(zip(task.observation_names, observation.tolist(), strict=True))
    for name, position in task.robot.joint_positions().items():
        if f"{name}.position" in values:
            assert values[f"{name}.position"] == pytest.approx(position, abs=1e-5)
    goal = poses_in(task.simulation.state, {task.goal(task.thing)})[task.goal(task.thing)]
    x, y, yaw = task.robot.base_pose()
    dx, dy = goal[0] - x, goal[1] - y
    assert values["base.goal.x"] == pytest.approx(np.cos(yaw) * dx + np.sin(yaw) * dy, abs=1e-4)
    assert values["base.goal.y"] == pytest.approx(-np.sin(yaw) * dx + np.cos(yaw) * dy, abs=1e-4)


def test_an_action_moves_its_joint_and_no_other(open_env: OpenEnv) -> None:
    open_env.reset(seed=0)
    before = open_env.robot.joint_positions()
    for name, sign in (("head_pan_joint", 1.0), ("lift_joint", -1.0)):
        action = np.array([sign if each == name else 0.0 for each in open_env.action_names], np.float32)
        action[open_env.action_names.index("gripper")] = -1.0
        for _ in range(3):
            open_env.step(action)
        after = open_env.robot.joint_positions()
        moved = {each for each in after if abs(after[each] - before[each]) > 0.01}
        assert moved == {name}
        assert np.sign(after[name] - before[name]) == sign
        before = after


def test_the_base_and_the_gripper_follow_their_actions(open_env: OpenEnv) -> None:
    open_env.reset(seed=0)
    x, y, yaw = open_env.robot.base_pose()
    action = np.zeros(len(open_env.action_names), np.float32)
    action[open_env.action_names.index("base.forward")] = -0.5
    action[open_env.action_names.index("gripper")] = 1.0
    for _ in range(8):
        open_env.step(action)
    moved = np.subtract(open_env.robot.base_pose()[:2], (x, y))
    assert moved @ (np.cos(yaw), np.sin(yaw)) < -0.1
    assert open_env.robot.opening() > 0.06


def test_the_reward_is_that_of_the_answers(open_env: OpenEnv) -> None:
    open_env.reset(seed=0, options={"thing": "Drawer"})
    still = np.zeros(len(open_env.action_names), np.float32)
    still[open_env.action_names.index("gripper")] = -1.0
    _, nothing, *_ = open_env.step(still)
    assert abs(nothing) < 0.1
    open_env.robot.set_base_pose(0.0, -2.0, 0.0)  # out of the way of the drawer
    open_env.step(still)
    open_env.simulation.joint("DrawerSlide").open(0.5)
    _, half, terminated, _, info = open_env.step(still)
    (row,) = open_env.simulation.ask("articulated_parts", part="Drawer")
    assert info["progress"] == pytest.approx(row.share / 0.8, abs=0.02)
    assert half > 4.0
    assert not terminated
    open_env.simulation.joint("DrawerSlide").open(0.9)
    _, whole, terminated, _, info = open_env.step(still)
    assert terminated
    assert info["is_success"]
    assert whole > 10.0


def test_a_thing_is_placed_when_it_is_on_the_target_and_released(map_path: str) -> None:
    env = PlaceEnv(map_path, thing="Mug", on="Fridge")
    env.reset(seed=0)
    assert not env.progress().done
    env.simulation.place("Mug", on="Fridge")
    assert env.progress().done
    assert env.simulation.ask("where_is", thing="Mug", relation="on")[0].other.endswith("#Fridge")
    env.close()


def test_resets_put_everything_back(open_env: OpenEnv) -> None:
    open_env.reset(seed=0)
    body = BodyId("Mug")
    before = poses_in(open_env.simulation.state, {body})[body]
    moved = before + np.eye(7)[2]
    open_env.simulation.engine.run(lambda engine: engine.apply(SetPoses({body: pose_from_array(moved)})))
    open_env.simulation.joint("FridgeHinge").open()
    open_env.step(open_env.action_space.sample())
    open_env.reset(seed=0)
    assert np.allclose(poses_in(open_env.simulation.state, {body})[body], before, atol=1e-6)
    assert open_env.simulation.joint("FridgeHinge").openness < 0.01
    assert open_env.robot.controller.goals == ()


def test_without_a_thing_episodes_are_about_all_that_the_task_can_be_about(open_env: OpenEnv) -> None:
    assert {open_env.reset(seed=seed)[1]["thing"] for seed in range(12)} == {"Drawer", "FridgeDoor"}
    assert {open_env.goal(BodyId(thing)) for thing in ("Drawer", "FridgeDoor")} == {"DrawerHandle", "FridgeHandle"}


@pytest.mark.parametrize("thing", ["Drawer", "FridgeDoor"])
def test_a_robot_stands_on_free_floor_in_front_of_the_handle(open_env: OpenEnv, thing: str) -> None:
    open_env.reset(seed=0, options={"thing": thing})
    open_env.simulation.step(0.1)
    handle, own = open_env.goal(BodyId(thing)), open_env.robot.body_ids
    (x, y, yaw), at = open_env.robot.base_pose(), poses_in(open_env.simulation.state, {handle})[handle]
    assert x < at[0]
    assert np.hypot(at[0] - x, at[1] - y) < 1.6
    assert abs(np.arctan2(at[1] - y, at[0] - x) - yaw) < 0.5
    contacts = open_env.simulation.engine.run(lambda engine: engine.contacts())
    touched = {each.b if each.a in own else each.a for each in contacts if {each.a, each.b} & own}
    assert touched - own <= {"Floor", None}


def test_vectors_of_environments_run_in_their_own_processes(map_path: str) -> None:
    envs = gymnasium.make_vec("mindstage/Open-v0", num_envs=2, vectorization_mode="async", map=map_path, thing="Drawer")
    try:
        observations, _ = envs.reset(seed=[1, 2])
        assert observations.shape[0] == 2
        assert not np.array_equal(observations[0], observations[1])
        _, rewards, *_ = envs.step(envs.action_space.sample())
        assert np.isfinite(rewards).all()
    finally:
        envs.close()


def test_vectors_in_one_process_equal_single_environments(map_path: str) -> None:
    envs = gymnasium.make_vec("mindstage/Open-v0", num_envs=2, vectorization_mode="sync", map=map_path, thing="Drawer")
    observations, _ = envs.reset(seed=[5, 6])
    again, _ = envs.reset(seed=[5, 6])
    envs.close()
    single = OpenEnv(map_path, thing="Drawer")
    alone, _ = single.reset(seed=5)
    single.close()
    assert np.array_equal(observations, again)
    assert np.allclose(observations[0], alone, atol=1e-5)
    assert not np.allclose(observations[1], alone, atol=1e-3)


def test_a_random_policy_fails_and_the_skill_succeeds(map_path: str) -> None:
    env = gymnasium.make("mindstage/Open-v0", map=map_path, thing="Drawer", max_episode_steps=15)
    random, scores = rate_of(env, play_randomly, episodes=2)
    assert random == 0.0
    assert all(score.duration_s == pytest.approx(1.5) for score in scores)
    scripted, (score,) = rate_of(env, play_skill, episodes=1)
    assert scripted == 1.0, score.reason
    assert score.duration_s > 1.0
    env.close()


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"thing": "Mug"}, InvalidArgumentError, "Mug"),
        ({"robot": "r2d2"}, RobotNotFoundError, "r2d2"),
        ({"render_mode": "human"}, InvalidArgumentError, "mindstage.view"),
    ],
)
def test_wrong_arguments_are_refused(
    map_path: str, options: dict[str, str], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        OpenEnv(map_path, **options)


def test_a_map_without_a_task_is_refused(tmp_path: Path) -> None:
    world = kitchenette()
    path = tmp_path / "empty.owl"
    save(type(world)(iri=world.iri, name="map", bodies=world.bodies[:1]), path)
    for environment in (OpenEnv, PickEnv):
        with pytest.raises(InvalidArgumentError, match="nothing"):
            environment(str(path))


def test_putting_away_begins_in_the_open_and_ends_in_a_closed_place() -> None:
    env = PutAwayEnv(thing="milk_carton_1")
    _, info = env.reset(seed=0)
    assert "not in fridge" in info["reason"]
    assert not env.progress().done
    fresh = poses_in(env.simulation.state, {BodyId("milk_carton_1")})
    assert np.linalg.norm(fresh[BodyId("milk_carton_1")][:2] - env.robot.base_pose()[:2]) < 1.3, "it stands near it"
    env.reset(seed=1)
    again = poses_in(env.simulation.state, {BodyId("milk_carton_1")})
    assert np.allclose(fresh[BodyId("milk_carton_1")], again[BodyId("milk_carton_1")], atol=1e-6)
    env.simulation.place("milk_carton_1", on="fridge")
    assert not env.progress().done
    assert "milk_carton_1 is not in fridge" in env.progress().why
    env.simulation.place("milk_carton_1", into="fridge")
    assert env.progress().done
    env.robot.set_base_pose(0.8, 0.5, 0.0)  # out of the way of the door
    assert env.simulation.joint("fridge_door").open(0.5)
    assert 0.5 < env.progress().share < 1.0
    env.close()
